//! Gradients against difference quotients, for one operation or a whole pipeline in `f64`.
//!
//! A pipeline maps leaves to outputs `y_j`. With random upstream gradients `u_j` it becomes the
//! number `F = sum_j <u_j, y_j>`, whose gradient the tape computes in one pass. Per entry `x` of
//! a differentiable input, with `D(h) = (F(x + h) - F(x - h)) / (2 h)` and `h = STEP max(1, |x|)`:
//!
//! - the reference is Richardson's `R = (4 D(h/2) - D(h)) / 3`, in error by `O(h^4)`;
//! - its error bar is `|R - D(h/2)|` plus the rounding of `F`, `ROUNDING sum |u y| / h`;
//! - the law is `|gradient - R| <= TOLERANCE scale + bar`, where `scale` is the largest entry of
//!   the gradient with respect to the same input, by either reckoning, or `NEGLIGIBLE sum |u y|`
//!   if that is larger.
//!
//! An entry is left out where the pipeline's discrete state (ids, edge choices, which side of a
//! clamp) or an output's shape changes within the stencil, and where the bar exceeds `VAGUE scale`:
//! the quotient then says nothing. At most `MOST_LEFT_OUT` of all entries may be.
//!
//! Every point also checks three identities of the engine: a pass to one input alone gives the same
//! bits; a pass that finds a sum already begun adds to it; no gradient comes back for a constant.

use std::cell::Cell;
use std::fmt::Debug;

use bokashi_core::{Tape, Tensor, Var};
use proptest::strategy::Strategy;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestRng, TestRunner};

/// Where the errors of a Richardson pair balance: `h^4` against `eps / h`.
const STEP: f64 = 1e-3;
/// Of the largest entry of the gradient.
const TOLERANCE: f64 = 1e-6;
/// A few dozen roundings between the inputs and `F`.
const ROUNDING: f64 = 32.0 * f64::EPSILON;
/// Three digits of a derivative are worth having, fewer are not.
const VAGUE: f64 = 1e-3;
/// A step changes `F` by less than the rounding of `F` in `f32`: then the gradient counts as zero.
const NEGLIGIBLE: f64 = 1e-6;
/// The share of entries that may be left out.
const MOST_LEFT_OUT: f64 = 0.1;

/// An input of a pipeline under test.
#[derive(Debug, Clone)]
pub(crate) struct Input {
    pub(crate) tensor: Tensor<f64>,
    pub(crate) differentiable: bool,
}

impl Input {
    pub(crate) fn leaf(tensor: Tensor<f64>) -> Self {
        Self { tensor, differentiable: true }
    }

    pub(crate) fn constant(tensor: Tensor<f64>) -> Self {
        Self { tensor, differentiable: false }
    }
}

/// Outputs of a pipeline and its discrete state: anything that tells on which smooth piece of the
/// pipeline the inputs lie; `()` where there is one piece.
pub(crate) type Outcome<'t, S> = (Vec<Var<'t, f64>>, S);

/// Asserts the law at `cases` points of `strategy` (always the same ones), prints what was left
/// out, and asserts that it was little.
///
/// # Panics
/// With the smallest point found at which the law does not hold.
pub(crate) fn assert_gradients<S: PartialEq, E: Debug>(
    name: &str,
    cases: u32,
    strategy: impl Strategy<Value = Vec<Input>>,
    pipeline: impl for<'t> Fn(&'t Tape<f64>, &[Var<'t, f64>]) -> Result<Outcome<'t, S>, E>,
) {
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let tally = Tally::default();
    let mut points = TestRunner::new_with_rng(config, rng);
    let result = points.run(&strategy, |inputs| {
        check_gradients(&inputs, &pipeline, &tally).map_err(TestCaseError::fail)
    });
    if let Err(error) = result {
        panic!("{name}: {error}");
    }
    let (entries, left_out) = (tally.entries.get(), tally.left_out.get());
    println!("{name}: {entries} entries, {left_out} left out");
    assert!(entries > 0, "{name}: no entry was checked");
    let share = left_out as f64 / entries as f64;
    assert!(share <= MOST_LEFT_OUT, "{name}: {left_out} of {entries} entries were left out");
}

/// How many entries were looked at, and how many of them told nothing.
#[derive(Debug, Default)]
struct Tally {
    entries: Cell<u64>,
    left_out: Cell<u64>,
}

/// Checks the law at one point.
///
/// # Errors
/// Which entry of which input breaks it, and by how much.
fn check_gradients<S: PartialEq, E: Debug>(
    inputs: &[Input],
    pipeline: &impl for<'t> Fn(&'t Tape<f64>, &[Var<'t, f64>]) -> Result<Outcome<'t, S>, E>,
    tally: &Tally,
) -> Result<(), String> {
    let tape = Tape::new();
    let leaves: Vec<_> = inputs.iter().map(|input| place(&tape, input)).collect();
    let (outputs, state) = pipeline(&tape, &leaves).map_err(|error| format!("{error:?}"))?;
    let upstream: Vec<_> = outputs.iter().zip(1..).map(|(y, j)| noise(&y.value(), j)).collect();
    let seeds: Vec<_> = outputs.iter().copied().zip(&upstream).collect();
    let gradients = tape.vjp(&seeds).map_err(|error| error.to_string())?;

    let value = |inputs: &[Input]| -> Option<f64> {
        let tape = Tape::new();
        let leaves: Vec<_> = inputs.iter().map(|input| place(&tape, input)).collect();
        let (ys, ends_in) = pipeline(&tape, &leaves).ok()?;
        let ys: Vec<_> = ys.iter().map(|y| y.value()).collect();
        let same_shapes = ys.len() == upstream.len()
            && ys.iter().zip(&upstream).all(|(y, u)| y.shape() == u.shape());
        (ends_in == state && same_shapes).then(|| ys.iter().zip(&upstream).map(dot).sum())
    };
    let size: f64 = outputs.iter().zip(&upstream).map(|(y, u)| dot_of_sizes(&y.value(), u)).sum();
    if !size.is_finite() {
        return Err(format!("the outputs are not finite: {outputs:?}"));
    }

    for (i, (&leaf, input)) in leaves.iter().zip(inputs).enumerate() {
        if !input.differentiable {
            if gradients.get(leaf).is_some() {
                return Err(format!("input {i} is a constant and got a gradient"));
            }
            continue;
        }
        let gradient = gradients.get_or_zeros(leaf);
        check_identities(&tape, &seeds, i, leaf, &gradient)?;

        let quotients: Vec<_> =
            (0..gradient.size()).map(|k| quotient(inputs, i, k, ROUNDING * size, value)).collect();
        let references = quotients.iter().flatten().map(|&(reference, _)| reference);
        let sizes = gradient.data().iter().copied().chain(references).map(f64::abs);
        let scale = sizes.fold(NEGLIGIBLE * size, f64::max);
        for (k, (&entry, quotient)) in gradient.data().iter().zip(quotients).enumerate() {
            tally.entries.set(tally.entries.get() + 1);
            let Some((reference, bar)) = quotient.filter(|&(_, bar)| bar <= VAGUE * scale) else {
                tally.left_out.set(tally.left_out.get() + 1);
                continue;
            };
            let difference = (entry - reference).abs();
            if difference.is_nan() || difference > TOLERANCE * scale + bar {
                return Err(format!(
                    "input {i}, entry {k}: gradient {entry:e}, difference quotient {reference:e} \
                     +- {bar:e}, at scale {scale:e}"
                ));
            }
        }
    }
    Ok(())
}

/// Richardson's quotient for entry `k` of input `i` and its error bar, unless `value` is undefined
/// somewhere on the stencil.
fn quotient(
    inputs: &[Input],
    i: usize,
    k: usize,
    rounding: f64,
    value: impl Fn(&[Input]) -> Option<f64>,
) -> Option<(f64, f64)> {
    let x = inputs[i].tensor.data()[k];
    let step = STEP * x.abs().max(1.0);
    let mut moved = inputs.to_vec();
    let mut at = |x: f64| {
        moved[i].tensor.data_mut()[k] = x;
        value(&moved)
    };
    let mut central = |h: f64| {
        let (above, below) = (x + h, x - h);
        // The step that was taken, after rounding.
        Some((at(above)? - at(below)?) / (above - below))
    };
    let (wide, narrow) = (central(step)?, central(0.5 * step)?);
    let reference = (4.0 * narrow - wide) / 3.0;
    Some((reference, (reference - narrow).abs() + rounding / step))
}

/// The identities that need no difference quotient.
fn check_identities<'t>(
    tape: &'t Tape<f64>,
    seeds: &[(Var<'t, f64>, &Tensor<f64>)],
    i: usize,
    leaf: Var<'t, f64>,
    gradient: &Tensor<f64>,
) -> Result<(), String> {
    if *gradient.shape() != leaf.shape() {
        let (got, needed) = (gradient.shape(), leaf.shape());
        return Err(format!("input {i}: shape {needed}, its gradient's shape {got}"));
    }
    let alone = tape.vjp_to(seeds, &[leaf]).map_err(|error| error.to_string())?;
    if alone.get_or_zeros(leaf) != *gradient {
        return Err(format!("input {i}: a pass to it alone gives another gradient"));
    }
    let begun = noise(gradient, 99);
    let seeds: Vec<_> = seeds.iter().copied().chain([(leaf, &begun)]).collect();
    let more = tape.vjp(&seeds).map_err(|error| error.to_string())?.get_or_zeros(leaf);
    // The terms of the sums are not known here, only the order of their size.
    let bound = 1e-10 * gradient.data().iter().fold(1.0, |size: f64, entry| size.max(entry.abs()));
    let entries = more.data().iter().zip(gradient.data()).zip(begun.data());
    for (k, ((&more, &gradient), &begun)) in entries.enumerate() {
        let difference = (more - gradient - begun).abs();
        if difference.is_nan() || difference > bound {
            return Err(format!(
                "input {i}, entry {k}: a sum of {begun:e} already begun became {more:e}, not \
                 larger by the gradient {gradient:e}"
            ));
        }
    }
    Ok(())
}

fn place<'t>(tape: &'t Tape<f64>, input: &Input) -> Var<'t, f64> {
    if input.differentiable { tape.leaf(&input.tensor) } else { tape.constant(&input.tensor) }
}

/// Numbers of both signs between 1/4 and 1 in size, in the shape of `like`.
fn noise(like: &Tensor<f64>, stream: u64) -> Tensor<f64> {
    Tensor::from_fn(like.shape(), |k| {
        let mut bits = (stream << 32 | k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits ^= bits >> 31;
        let size = 0.25 + 0.75 * (bits >> 11) as f64 / (1_u64 << 53) as f64;
        if bits & 1 == 1 { -size } else { size }
    })
}

fn dot((x, y): (&Tensor<f64>, &Tensor<f64>)) -> f64 {
    x.data().iter().zip(y.data()).map(|(x, y)| x * y).sum()
}

fn dot_of_sizes(x: &Tensor<f64>, y: &Tensor<f64>) -> f64 {
    x.data().iter().zip(y.data()).map(|(x, y)| (x * y).abs()).sum()
}
