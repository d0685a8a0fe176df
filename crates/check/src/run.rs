//! Runs of a subject: forward, backward, and along a direction.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use bokashi_core::{Dual, Scalar, Tape, Tensor, Var};

use crate::subject::{AnySubject, Case, Input, Number, Refusal};

/// The values of a run's inputs, and which inputs have a gradient.
pub(crate) type Point<T> = Vec<(Tensor<T>, bool)>;

/// What a run gave.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Run<T> {
    pub(crate) outputs: Vec<Tensor<T>>,
    pub(crate) state: u64,
    /// Per input; `None` for inputs without a gradient.
    pub(crate) gradients: Vec<Option<Tensor<T>>>,
}

/// The inputs in the precision of `T`.
pub(crate) fn point<T: Scalar>(inputs: &[Input]) -> Point<T> {
    inputs.iter().map(|input| (input.tensor.cast(), input.differentiable)).collect()
}

/// Puts a point on `tape`.
pub(crate) fn record<'t, T: Scalar>(tape: &'t Tape<T>, point: &Point<T>) -> Vec<Var<'t, T>> {
    let record_one = |(tensor, needs): &(Tensor<T>, bool)| {
        if *needs { tape.leaf(tensor) } else { tape.constant(tensor) }
    };
    point.iter().map(record_one).collect()
}

/// The outputs and the discrete state at `point`, without gradients.
pub(crate) fn forward<T: Number>(
    subject: &dyn AnySubject,
    point: &Point<T>,
) -> Result<(Vec<Tensor<T>>, u64), Refusal> {
    let tape = Tape::new();
    let constants: Vec<_> = point.iter().map(|(tensor, _)| tape.constant(tensor)).collect();
    let outcome = T::apply(subject, &tape, &constants)?;
    Ok((outcome.outputs.iter().map(|y| y.value()).collect(), outcome.state))
}

/// A step on `tape`: outputs, and gradients for the upstream gradients that `upstream` makes from
/// the outputs.
pub(crate) fn step<T: Number>(
    tape: &Tape<T>,
    subject: &dyn AnySubject,
    point: &Point<T>,
    upstream: &[Option<Tensor<T>>],
) -> Result<Run<T>, Refusal> {
    let inputs = record(tape, point);
    let outcome = T::apply(subject, tape, &inputs)?;
    let outputs: Vec<_> = outcome.outputs.iter().map(|y| y.value()).collect();
    let seeds: Vec<_> = outcome
        .outputs
        .iter()
        .zip(upstream)
        .filter_map(|(&y, upstream)| upstream.as_ref().map(|upstream| (y, upstream)))
        .collect();
    let gradients = tape.vjp(&seeds)?;
    // Zeros where nothing arrived: an input that no output depends on.
    let gradient = |(&x, (_, needs)): (&Var<'_, T>, &(Tensor<T>, bool))| {
        if *needs { Some(gradients.get_or_zeros(x)) } else { gradients.get(x).cloned() }
    };
    let gradients = inputs.iter().zip(point).map(gradient).collect();
    Ok(Run { outputs, state: outcome.state, gradients })
}

/// [`step`] on a tape of its own, with an upstream gradient for every output.
pub(crate) fn run<T: Number>(
    subject: &dyn AnySubject,
    point: &Point<T>,
    upstream: &[Tensor<T>],
) -> Result<Run<T>, Refusal> {
    let upstream: Vec<_> = upstream.iter().cloned().map(Some).collect();
    step(&Tape::new(), subject, point, &upstream)
}

/// What a run over dual numbers gave: values and derivatives along a direction.
pub(crate) type DualRun = Run<Dual<f64>>;

/// Outputs, `J v`, gradients and Hessian-vector products along `direction`, which has a tensor for
/// every input.
pub(crate) fn along(
    case: &Case,
    upstream: &[Tensor<f64>],
    direction: &[Tensor<f64>],
) -> Result<DualRun, Refusal> {
    let dual = |(input, v): (&Input, &Tensor<f64>)| {
        let entry = |k: usize| Dual::new(input.tensor.data()[k], v.data()[k]);
        (Tensor::from_flat_fn(input.tensor.shape(), entry), input.differentiable)
    };
    let point: Point<_> = case.inputs.iter().zip(direction).map(dual).collect();
    let upstream: Vec<_> = upstream.iter().map(Tensor::cast).collect();
    run(&*case.subject, &point, &upstream)
}

/// `f()`, or what it panicked with.
pub(crate) fn caught<R>(f: impl FnOnce() -> R) -> Result<R, String> {
    catch_unwind(AssertUnwindSafe(f)).map_err(|panic| panic_message(&*panic))
}

fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("something").to_owned()
}

/// Numbers of both signs between 1/4 and 1 in size, in the shape of `like`.
pub(crate) fn noise<T: Scalar>(like: &Tensor<T>, stream: u64) -> Tensor<f64> {
    Tensor::from_flat_fn(like.shape(), |k| {
        let mut bits = (stream << 32 | k as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        bits = (bits ^ bits >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits ^= bits >> 31;
        let size = 0.25 + 0.75 * (bits >> 11) as f64 / (1_u64 << 53) as f64;
        if bits & 1 == 1 { -size } else { size }
    })
}

/// `<x, y>` and `sum |x y|`, over lists of tensors of the same shapes.
pub(crate) fn dot<'a>(
    xs: impl IntoIterator<Item = &'a Tensor<f64>>,
    ys: impl IntoIterator<Item = &'a Tensor<f64>>,
) -> (f64, f64) {
    let pairs = xs.into_iter().zip(ys).flat_map(|(x, y)| x.data().iter().zip(y.data()));
    pairs.fold((0.0, 0.0), |(sum, size), (x, y)| (sum + x * y, size + (x * y).abs()))
}

/// The largest size of an entry.
pub(crate) fn largest(x: &Tensor<f64>) -> f64 {
    x.data().iter().fold(0.0, |largest: f64, entry| largest.max(entry.abs()))
}

/// The first entry that differs in its bits.
pub(crate) fn first_difference<T: Scalar>(x: &Tensor<T>, y: &Tensor<T>) -> Option<usize> {
    let bits = |x: &T| x.to_f64().to_bits();
    x.data().iter().zip(y.data()).position(|(x, y)| bits(x) != bits(y))
}
