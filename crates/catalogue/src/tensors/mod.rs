//! Operations on tensors, a row or a few for each: over shapes of all kinds, and values close to where
//! the operation is not smooth.

mod extremes;

use std::sync::Arc;

use bokashi_check::strategy::{
    around, broadcasting_shapes, non_zero, number, shape as any_shape, tensor,
};
use bokashi_check::{Case, Check, Input, Outcome, Subject, sides, subject};
use bokashi_core::{Mask, Padding, Scalar, SparseMatrix, Tensor, TensorError, Var};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::setting::WIDTH;

/// How many cases are drawn: they are small.
const CASES: u32 = 64;

type Inputs = BoxedStrategy<Vec<Input>>;

/// Numbers in a range.
fn within(range: std::ops::Range<f64>) -> BoxedStrategy<f64> {
    range.boxed()
}

fn input(tensor: Tensor<f64>, differentiable: bool) -> Input {
    if differentiable { Input::leaf(tensor) } else { Input::constant(tensor) }
}

/// One leaf of any shape.
fn one(entries: BoxedStrategy<f64>) -> Inputs {
    let tensors = any_shape().prop_flat_map(move |shape| tensor(shape, entries.clone()));
    tensors.prop_map(|x| vec![Input::leaf(x)]).boxed()
}

/// Two inputs whose shapes broadcast, one of them perhaps a constant.
fn pair(left: BoxedStrategy<f64>, right: BoxedStrategy<f64>) -> Inputs {
    let masks = sample::select(&[[true, true], [true, true], [true, false], [false, true]][..]);
    let inputs = (broadcasting_shapes(), masks).prop_flat_map(move |([x, y], [x_leaf, y_leaf])| {
        (tensor(x, left.clone()), tensor(y, right.clone()))
            .prop_map(move |(x, y)| vec![input(x, x_leaf), input(y, y_leaf)])
    });
    inputs.boxed()
}

/// One leaf of one shape.
fn of_shape(axes: &[usize]) -> Inputs {
    tensor(axes, number()).prop_map(|x| vec![Input::leaf(x)]).boxed()
}

/// One leaf of one shape with vectors along each axis that are far from 0.
fn vectors(axes: &[usize]) -> Inputs {
    tensor(axes, non_zero()).prop_map(|x| vec![Input::leaf(x)]).boxed()
}

/// Leaves of several shapes.
fn parts(shapes: &[&[usize]]) -> Inputs {
    let parts: Vec<_> = shapes.iter().map(|&axes| tensor(axes, number())).collect();
    parts.prop_map(|parts| parts.into_iter().map(Input::leaf).collect()).boxed()
}

fn not_empty() -> Inputs {
    one(number()).prop_filter("a mean needs entries", |x| x[0].tensor.size() > 0).boxed()
}

/// `[m, k]` and `[k, n]`, inner loops shorter and longer than a vector register.
fn matrices() -> Inputs {
    let extent = || prop_oneof![Just(0_usize), 1..5_usize, Just(18)];
    let masks = sample::select(&[[true, true], [true, false], [false, true]][..]);
    let inputs = ([extent(), extent(), extent()], masks).prop_flat_map(|([m, k, n], leaf)| {
        let matrices = (tensor([m, k], number()), tensor([k, n], number()));
        matrices.prop_map(move |(x, y)| vec![input(x, leaf[0]), input(y, leaf[1])])
    });
    inputs.boxed()
}

/// Inputs of these shapes that are worked on in several pieces, all leaves.
fn large(shapes: &[&[usize]]) -> Inputs {
    let entry = |k: usize| 0.2 + ((k * 7919 + 13) % 1009) as f64 / 1009.0;
    let tensors: Vec<_> = shapes.iter().map(|&axes| Tensor::from_flat_fn(axes, entry)).collect();
    Just(tensors.into_iter().map(Input::leaf).collect()).boxed()
}

/// An output with kinks at these values of `x`.
fn kinked<'t, T: Scalar>(output: Var<'t, T>, x: Var<'t, T>, kinks: &[f64]) -> Outcome<'t, T> {
    Outcome::from(output).with_state(sides(x, kinks))
}

const MANY: &[usize] = &[5, 9001];

const ROW: &[usize] = &[9001];

/// A case of leaves of these shapes, all entries 1/2.
fn halves(subject: impl Subject, shapes: &[&[usize]]) -> Case {
    let leaf = |&axes: &&[usize]| Input::leaf(Tensor::full(axes, 0.5));
    Case::new(subject, shapes.iter().map(leaf).collect::<Vec<_>>())
}

/// The entry of an operation. For each subject: its name, a strategy for its inputs, and the subject;
/// then shapes of inputs that are worked on in pieces, and shapes that it must refuse. At last its benchmarks:
/// their labels, their inputs in a setting, and what is recorded.
macro_rules! operation {
    ($name:ident $(with $extremes:path)? $({
        $law:ident: $inputs:expr, |$x:ident| $output:expr
        $(, large $large:expr)? $(, refuses $message:literal $refused:expr)*
        $(, otherwise |$w:ident| $other:expr, refuses $said:literal $shapes:expr)*
    })+ $($label:literal: |$s:ident| $given:tt, |$v:ident| $recorded:expr;)*) => {
        pub(crate) mod $name {
            #[allow(unused_imports, reason = "not every row names everything")]
            use super::*;

            pub(crate) fn entry() -> Entry {
                let mut entry = Entry::new(stringify!($name)).cases(CASES);
                $(entry = entry.with_extremes($extremes);)?
                $({
                    subject!(Operation: |$x| $output);
                    let check = Check::new(stringify!($law), Operation, $inputs);
                    $(
                        let many = large(&$large).prop_map(|inputs| Case::new(Operation, inputs));
                        let check = check.large(1, many);
                    )?
                    $(let check = check.refuses($message, halves(Operation, &$refused));)*
                    $(
                        let check = {
                            subject!(Other: |$w| $other);
                            check.refuses($said, halves(Other, &$shapes))
                        };
                    )*
                    entry.check(check);
                })+
                $(benchmark!(entry, $label, |$s| $given, |$v| $recorded);)*
                entry
            }
        }
    };
}

operation!(add
    { add: pair(number(), number()), |x| x[0].try_add(x[1])?, large [MANY, ROW],
        refuses "add needs shapes that broadcast, got [2, 3] and [2, 4]" [&[2, 3][..], &[2, 4]] }
    "add": |s| [s.signed, s.positive], |x| x[0].try_add(x[1])?;
);

operation!(sub
    { sub: pair(number(), number()), |x| x[0].try_sub(x[1])?, large [ROW, MANY],
        refuses "sub needs shapes that broadcast, got [2] and [3]" [&[2][..], &[3]] }
    "sub": |s| [s.signed, s.positive], |x| x[0].try_sub(x[1])?;
);

operation!(mul
    { mul: pair(number(), number()), |x| x[0].try_mul(x[1])?, large [MANY, MANY],
        refuses "mul needs shapes that broadcast, got [4, 1] and [3, 3]" [&[4, 1][..], &[3, 3]] }
    { mul_of_a_number_and_many: pair(number(), number()), |x| x[0].try_mul(x[1])?, large [&[], MANY] }
    { square_by_one_input_twice: one(number()), |x| x[0].try_mul(x[0])? }
    "mul": |s| [s.signed, s.positive], |x| x[0].try_mul(x[1])?;
);

operation!(div
    { div: pair(number(), non_zero()), |x| x[0].try_div(x[1])?, large [MANY, &[5, 1]],
        refuses "div needs shapes that broadcast, got [2] and [0]" [&[2][..], &[0]] }
    { div_by_a_number: one(number()), |x| x[0] / T::from_f64(3.0) }
    "div": |s| [s.signed, s.positive], |x| x[0].try_div(x[1])?;
);

operation!(minimum
    { minimum: pair(around(&[0.5], -2.0..2.0), around(&[0.5], -2.0..2.0)),
        |x| kinked(x[0].minimum(x[1])?, x[0].try_sub(x[1])?, &[0.0]), large [MANY, ROW],
        refuses "minimum needs shapes that broadcast, got [2] and [3]" [&[2][..], &[3]] }
    "minimum": |s| [s.signed, s.positive], |x| x[0].minimum(x[1])?;
);

operation!(maximum
    { maximum: pair(around(&[0.5], -2.0..2.0), around(&[0.5], -2.0..2.0)),
        |x| kinked(x[0].maximum(x[1])?, x[0].try_sub(x[1])?, &[0.0]), large [&[16_461, 3], &[1, 3]],
        refuses "maximum needs shapes that broadcast, got [2] and [3]" [&[2][..], &[3]] }
    "maximum": |s| [s.signed, s.positive], |x| x[0].maximum(x[1])?;
);

operation!(pow
    with extremes::POW
    { pow: pair(within(0.1..3.0), number()), |x| x[0].pow(x[1])?, large [MANY, ROW],
        refuses "pow needs shapes that broadcast, got [2] and [3]" [&[2][..], &[3]] }
    "pow": |s| [s.positive, s.signed], |x| x[0].pow(x[1])?;
);

operation!(select
    with extremes::SELECT
    { select: pair(number(), number()), |x| {
        Mask::from_flat_fn(x[0].shape(), |k| k % 3 > 0).select(x[0], x[1])?
}, large [MANY, ROW],
        refuses "select needs shapes that broadcast, got [2, 3] and [2, 4]" [&[2, 3][..], &[2, 4]] }
    { select_by_a_mask_of_another_shape: parts(&[&[2, 1], &[3]]), |x| {
        Mask::from_fn([4, 1, 3], |[i, _, k]| (i + k) % 3 == 0).select(x[0], x[1])?
}, large [&[9001, 1], &[3]] }
    { select_by_comparison: pair(around(&[0.5], -2.0..2.0), around(&[0.5], -2.0..2.0)), |x| {
        let smaller = x[0].is_less(x[1])?.select(x[0], x[1])?;
        kinked(smaller, x[0].try_sub(x[1])?, &[0.0])
}, large [MANY, ROW] }
    { select_beside_a_nan: one(around(&[0.5], -2.0..2.0)), |x| {
        let number = |number| x[0].tape().constant_scalar(T::from_f64(number));
        let is_large = x[0].is_greater(number(0.5))?;
        let chosen = is_large.select(is_large.select(x[0], number(1.0))?.ln(), x[0])?;
        kinked(chosen, x[0], &[0.5])
} }
    "select": |s| [s.signed, s.positive], |x| s.mask.select(x[0], x[1])?;
);

operation!(affine
    { affine: one(number()), |x| x[0].affine(T::from_f64(-1.5), T::from_f64(0.25)), large [MANY] }
    { neg: one(number()), |x| -x[0] }
    { numbers: one(number()), |x| (x[0] * T::from_f64(0.5) + T::from_f64(2.0)) * T::from_f64(3.0)
        - T::from_f64(1.0) }
    "affine": |s| [s.signed], |x| x[0].affine(T::from_f64(0.7), T::from_f64(0.1));
);

operation!(exp
    { exp: one(within(-5.0..5.0)), |x| x[0].exp(), large [MANY] }
    "exp": |s| [s.signed], |x| x[0].exp();
);

operation!(ln
    { ln: one(within(0.05..9.0)), |x| x[0].ln(), large [MANY] }
    "ln": |s| [s.positive], |x| x[0].ln();
);

operation!(sqrt
    { sqrt: one(within(0.05..9.0)), |x| x[0].sqrt(), large [MANY] }
    "sqrt": |s| [s.positive], |x| x[0].sqrt();
);

operation!(sin
    { sin: one(within(-9.0..9.0)), |x| x[0].sin(), large [MANY] }
    "sin": |s| [s.signed], |x| x[0].sin();
);

operation!(cos
    { cos: one(within(-9.0..9.0)), |x| x[0].cos(), large [MANY] }
    "cos": |s| [s.signed], |x| x[0].cos();
);

operation!(tanh
    { tanh: one(within(-9.0..9.0)), |x| x[0].tanh(), large [MANY] }
    "tanh": |s| [s.signed], |x| x[0].tanh();
);

operation!(sigmoid
    { sigmoid: one(within(-20.0..20.0)), |x| x[0].sigmoid(), large [MANY] }
    "sigmoid": |s| [s.signed], |x| x[0].sigmoid();
);

operation!(softplus
    { softplus: one(within(-20.0..20.0)), |x| x[0].softplus(), large [MANY] }
    "softplus": |s| [s.signed], |x| x[0].softplus();
);

operation!(powi
    { square: one(number()), |x| x[0].square() }
    { powi_of_one: one(number()), |x| x[0].powi(1) }
    { powi_of_five: one(number()), |x| x[0].powi(5), large [MANY] }
    { powi_of_minus_two: one(non_zero()), |x| x[0].powi(-2) }
    "powi": |s| [s.signed], |x| x[0].powi(3);
);

operation!(powf
    { powf: one(within(0.05..9.0)), |x| x[0].powf(T::from_f64(2.2)), large [MANY] }
    { powf_of_three: one(number()), |x| x[0].powf(T::from_f64(3.0)) }
    { powf_of_minus_a_half: one(within(0.1..9.0)), |x| x[0].powf(T::from_f64(-0.5)) }
    "powf": |s| [s.positive], |x| x[0].powf(T::from_f64(2.25));
);

operation!(relu
    { relu: one(around(&[0.0], -2.0..2.0)), |x| kinked(x[0].relu(), x[0], &[0.0]), large [MANY] }
    "relu": |s| [s.signed], |x| x[0].relu();
);

operation!(abs
    { abs: one(around(&[0.0], -2.0..2.0)), |x| kinked(x[0].abs(), x[0], &[0.0]), large [MANY] }
    "abs": |s| [s.signed], |x| x[0].abs();
);

operation!(clamp
    { clamp: one(around(&[-1.0, 0.5], -2.0..2.0)),
        |x| kinked(x[0].clamp(T::from_f64(-1.0), T::from_f64(0.5))?, x[0], &[-1.0, 0.5]),
        large [MANY],
        otherwise |x| x[0].clamp(T::from_f64(2.0), T::ONE)?,
            refuses "clamp needs bounds with low <= high, got 2 and 1" [&[][..]],
        otherwise |x| x[0].clamp(T::from_f64(f64::NAN), T::ONE)?,
            refuses "clamp needs bounds with low <= high, got NaN and 1" [&[][..]],
        otherwise |x| x[0].clamp(T::ZERO, T::from_f64(f64::NAN))?,
            refuses "clamp needs bounds with low <= high, got 0 and NaN" [&[][..]] }
    "clamp": |s| [s.signed], |x| x[0].clamp(-T::ONE, T::ONE)?;
);

operation!(sum
    with extremes::SUM
    { sum: one(number()), |x| x[0].sum(), large [MANY] }
    { sum_axis_0: of_shape(&[3, 2, 4]), |x| x[0].sum_axis(0)?, large [MANY],
        refuses "sum needs an axis below the rank 0, got axis 0 of shape []" [&[][..]],
        refuses "shape [1099511627776, 1099511627776] needs more entries than fit an index, got 0"
            [&[0, 1 << 40, 1 << 40][..]] }
    { sum_axis_1: of_shape(&[3, 2, 4]), |x| x[0].sum_axis(1)?, large [MANY],
        refuses "sum needs an axis below the rank 1, got axis 1 of shape [3]" [&[3][..]] }
    { sum_axis_2: of_shape(&[3, 2, 4]), |x| x[0].sum_axis(2)? }
    "sum": |s| [s.positive], |x| x[0].sum();
);

operation!(mean
    { mean: not_empty(), |x| x[0].mean()?, large [MANY],
        refuses "mean needs at least one entry to take the mean of, got shape [0]" [&[0][..]] }
    { mean_axis_0: of_shape(&[3, 9]), |x| x[0].mean_axis(0)?, large [MANY],
        refuses "mean needs at least one entry to take the mean of, got shape [0, 2]" [&[0, 2][..]],
        otherwise |x| x[0].mean_axis(2)?,
        refuses "mean needs an axis below the rank 2, got axis 2 of shape [2, 0]" [&[2, 0][..]] }
    { mean_axis_1: of_shape(&[3, 9]), |x| x[0].mean_axis(1)?, large [MANY] }
    { mean_axis_of_extent_1: of_shape(&[3, 1, 2]), |x| x[0].mean_axis(1)? }
    "mean": |s| [s.positive], |x| x[0].mean()?;
);

operation!(dot
    { dot: parts(&[&[4, 3], &[4, 3]]), |x| x[0].dot(x[1])?, large [&[9001, 3], &[9001, 3]],
        refuses "dot needs vectors of as many components along the last axes, got shapes [2, 3] and [2, 4]"
            [&[2, 3][..], &[2, 4]],
        refuses "dot needs shapes that broadcast, got [2, 3] and [4, 3]" [&[2, 3][..], &[4, 3]],
        refuses "dot needs vectors of as many components along the last axes, got shapes [] and []"
            [&[][..], &[]],
        refuses "shape [1099511627776, 1099511627776] needs more entries than fit an index, got 0"
            [&[1 << 40, 1 << 40, 0][..], &[1 << 40, 1 << 40, 0]] }
    { dot_with_a_row: parts(&[&[5, 3], &[3]]), |x| x[0].dot(x[1])?, large [&[9001, 3], &[3]] }
    { dot_of_columns: parts(&[&[3, 4], &[3, 1]]), |x| x[0].transpose()?.dot(x[1].transpose()?)?,
        large [&[3, 20_000], &[3, 1]] }
    { dot_of_long_lists: parts(&[&[11], &[11]]), |x| x[0].dot(x[1])?, large [&[50_000], &[50_000]] }
    { dot_of_shapes_that_broadcast: parts(&[&[2, 1, 3], &[4, 3]]), |x| x[0].dot(x[1])?,
        large [&[20, 1, 300], &[40, 300]] }
    { dot_with_itself: of_shape(&[4, 3]), |x| x[0].dot(x[0])? }
    "dot": |s| [s.signed, s.positive], |x| x[0].dot(x[1])?;
    "dot, three and a row": |s| [s.vectors[0], s.row], |x| x[0].dot(x[1])?;
);

operation!(cross
    with extremes::CROSS
    { cross: parts(&[&[4, 3], &[4, 3]]), |x| x[0].cross(x[1])?, large [&[9001, 3], &[9001, 3]],
        refuses "cross needs vectors of three components along the last axes, got shapes [2, 2] and [2, 2]"
            [&[2, 2][..], &[2, 2]],
        refuses "cross needs shapes that broadcast, got [2, 3] and [5, 3]" [&[2, 3][..], &[5, 3]],
        refuses "cross needs vectors of as many components along the last axes, got shapes [2, 3] and [2, 1]"
            [&[2, 3][..], &[2, 1]],
        refuses "cross needs vectors of as many components along the last axes, got shapes [2, 3] and []"
            [&[2, 3][..], &[]] }
    { cross_with_a_row: parts(&[&[3], &[5, 3]]), |x| x[0].cross(x[1])?, large [&[3], &[9001, 3]] }
    { cross_of_shapes_that_broadcast: parts(&[&[2, 1, 3], &[4, 3]]), |x| x[0].cross(x[1])?,
        large [&[70, 1, 3], &[90, 3]] }
    "cross": |s| [s.vectors[0], s.vectors[1]], |x| x[0].cross(x[1])?;
);

operation!(norm
    { norm: vectors(&[4, 3]), |x| x[0].norm()?, large [&[9001, 3]],
        refuses "norm needs vectors along a last axis, got shape []" [&[][..]],
        refuses "shape [1099511627776, 1099511627776] needs more entries than fit an index, got 0"
            [&[1 << 40, 1 << 40, 0][..]] }
    { norm_of_columns: vectors(&[3, 4]), |x| x[0].transpose()?.norm()?, large [&[3, 20_000]] }
    { norm_of_a_long_list: vectors(&[11]), |x| x[0].norm()?, large [&[50_000]] }
    { norm_of_one: one(non_zero()), |x| x[0].keepdim(x[0].shape().rank())?.norm()? }
    "norm": |s| [s.vectors[0]], |x| x[0].norm()?;
);

operation!(normalize
    with extremes::NORMALIZE
    { normalize: vectors(&[4, 3]), |x| x[0].normalize()?, large [&[9001, 3]],
        refuses "normalize needs vectors along a last axis, got shape []" [&[][..]] }
    { normalize_a_long_list: vectors(&[11]), |x| x[0].normalize()?, large [&[50_000]] }
    "normalize": |s| [s.vectors[0]], |x| x[0].normalize()?;
);

operation!(matmul
    { matmul: matrices(), |x| x[0].matmul(x[1])?, large [&[150, 130], &[130, 140]],
        refuses "matmul needs shapes [m, k] and [k, n], got shapes [2, 3] and [2, 3]"
            [&[2, 3][..], &[2, 3]],
        refuses "matmul needs shapes [m, k] and [k, n], got shapes [3] and [3, 3]" [&[3][..], &[3, 3]] }
    { matmul_with_itself: of_shape(&[3, 3]), |x| x[0].matmul(x[0])? }
    "matmul": |s| [s.signed, s.square], |x| x[0].matmul(x[1])?;
);

operation!(reshape
    { reshape: of_shape(&[2, 3]), |x| x[0].reshape([3, 1, 2])?,
        refuses "shape [3, 1, 2] needs 6 entries, got 7" [&[7][..]],
        otherwise |w| w[0].reshape([1_usize << 33, 1 << 31])?,
        refuses "shape [8589934592, 2147483648] needs more entries than fit an index, got 2" [&[2][..]] }
    "reshape": |s| [s.signed], |x| x[0].reshape([x[0].shape().size()])?;
);

operation!(keepdim
    { keepdim: of_shape(&[2, 3]), |x| x[0].keepdim(1)?,
        refuses "keepdim needs a new axis up to the rank 0, got 1" [&[][..]] }
    "keepdim": |s| [s.signed], |x| x[0].keepdim(1)?;
);

operation!(permute
    { transpose: of_shape(&[2, 3]), |x| x[0].transpose()?,
        refuses "transpose needs each axis of shape [7] once, got axes [1, 0]" [&[7][..]] }
    { permute: of_shape(&[2, 3, 4]), |x| x[0].permute(&[2, 0, 1])?, large [&[20, 30, 70]],
        refuses "permute needs each axis of shape [2, 3] once, got axes [2, 0, 1]" [&[2, 3][..]],
        otherwise |x| x[0].permute(&[0, 0])?,
            refuses "permute needs each axis of shape [2, 3] once, got axes [0, 0]" [&[2, 3][..]],
        otherwise |x| x[0].permute(&[0])?,
            refuses "permute needs each axis of shape [2, 3] once, got axes [0]" [&[2, 3][..]],
        otherwise |x| x[0].permute(&[0, 2])?,
            refuses "permute needs each axis of shape [2, 3] once, got axes [0, 2]" [&[2, 3][..]] }
    "permute": |s| [s.signed], |x| x[0].permute(&[1, 0])?;
);

operation!(slice
    { slice_of_rows: of_shape(&[4, 3]), |x| x[0].slice(0, 1..3)?, large [MANY],
        refuses "slice needs a range within an axis of extent 2, got 1..3" [&[2, 9][..]],
        otherwise |x| x[0].slice(1, 1..4)?,
            refuses "slice needs a range within an axis of extent 3, got 1..4" [&[2, 3][..]],
        otherwise |x| x[0].slice(1, std::ops::Range { start: 2, end: 1 })?,
            refuses "slice needs a range within an axis of extent 3, got 2..1" [&[2, 3][..]] }
    { slice_of_columns: of_shape(&[2, 4, 3]), |x| x[0].slice(1, 1..4)?,
        refuses "slice needs an axis below the rank 1, got axis 1 of shape [9]" [&[9][..]] }
    "slice": |s| [s.signed], |x| x[0].slice(1, 1..WIDTH - 1)?;
);

operation!(pad
    with extremes::PAD
    { pad: of_shape(&[2, 3, 2]), |x| x[0].pad(1, [4, 8], Padding::Mirror)?, large [&[7, 90, 60]],
        refuses "pad needs an entry along the axis to repeat, got shape [2, 0]" [&[2, 0][..]] }
    { pad_with_a_constant: of_shape(&[3]),
        |x| x[0].pad(0, [2, 1], Padding::Constant(T::ONE))?,
        large [&[50_000]],
        refuses "pad needs fewer entries than fit an index, got 3" [&[0, 1 << 40, 1 << 40][..]] }
    { pad_by_clamping: of_shape(&[3, 2]), |x| x[0].pad(0, [3, 2], Padding::Clamp)?, large [MANY] }
    { pad_by_wrapping: of_shape(&[2, 3]), |x| x[0].pad(1, [5, 4], Padding::Wrap)?, large [MANY] }
    "pad": |s| [s.signed], |x| x[0].pad(1, [2, 2], Padding::Mirror)?;
);

operation!(stack
    { stack: parts(&[&[2, 3], &[2, 3], &[2, 3]]), |x| Var::stack(x, 2)?, large [MANY, MANY],
        refuses "stack needs parts of one shape, got shapes [2, 3] and [3, 2]" [&[2, 3][..], &[3, 2]],
        refuses "stack needs a new axis up to the rank 1, got 2" [&[2][..]],
        otherwise |x| Var::stack(&x[..0], 0)?,
            refuses "stack needs at least one part, got 0 inputs" [&[][..]] }
    { stack_of_rows: parts(&[&[2, 3], &[2, 3]]), |x| Var::stack(x, 0)?, large [MANY, MANY] }
    { stack_of_one_with_itself: of_shape(&[3]), |x| Var::stack(&[x[0], x[0]], 1)? }
    "stack": |s| [s.signed, s.positive], |x| Var::stack(x, 1)?;
);

operation!(concat
    { concat_of_rows: parts(&[&[1, 3], &[0, 3], &[2, 3]]), |x| Var::concat(x, 0)?,
        refuses "concat needs shapes that agree outside the joined axis, got shapes [2, 3] and [2, 4]"
            [&[2, 3][..], &[2, 4]] }
    { concat_of_columns: parts(&[&[2, 1, 2], &[2, 3, 2]]), |x| Var::concat(x, 1)?,
        large [&[4000, 5, 2], &[4000, 1, 2]],
        refuses "concat needs shapes that agree outside the joined axis, got shapes [2, 3] and [3]"
            [&[2, 3][..], &[3]],
        refuses "concat needs an axis below the rank 1, got axis 1 of shape [3]" [&[3][..], &[2, 3]],
        otherwise |x| Var::concat(x, 2)?,
        refuses "concat needs an axis below the rank 2, got axis 2 of shape [2, 3]" [&[2, 3][..]],
        otherwise |x| Var::concat(&x[..0], 0)?,
            refuses "concat needs at least one part, got 0 inputs" [&[][..]] }
    { concat_with_itself: of_shape(&[2, 2]), |x| Var::concat(&[x[0], x[0], x[0]], 1)? }
    "concat": |s| [s.signed, s.positive], |x| Var::concat(x, 0)?;
);

operation!(gather_rows
    { gather_rows: of_shape(&[4, 2]), |x| x[0].gather_rows(&Arc::from([3, 0, 3, 3, 1]))?,
        large [MANY],
        refuses "gather_rows needs indices within an axis of extent 3, got 3" [&[3, 2][..]] }
    { gather_entries: of_shape(&[3]), |x| x[0].gather_rows(&Arc::from([2, 2]))?,
        refuses "gather_rows needs an axis below the rank 0, got axis 0 of shape []" [&[][..]] }
    "gather_rows": |s| [s.signed], |x| x[0].gather_rows(&s.backwards)?;
);

operation!(scatter_add_rows
    { scatter_add_rows: of_shape(&[5, 2]),
        |x| {
            let rows: Arc<[u32]> = (0..x[0].shape()[0]).map(|r| (r * r % 4) as u32).collect();
            x[0].scatter_add_rows(&rows, 4)?
        },
        large [&[20_000, 3]] }
    { scatter_add_entries: of_shape(&[3]), |x| x[0].scatter_add_rows(&Arc::from([1, 1, 0]), 3)?,
        refuses "scatter_add_rows needs 3 rows, one per index, got shape [4]" [&[4][..]],
        refuses "scatter_add_rows needs an axis below the rank 0, got axis 0 of shape []" [&[][..]] }
    "scatter_add_rows": |s| [s.signed], |x| x[0].scatter_add_rows(&s.spread, x[0].shape()[0] / 6 + 1)?;
);

operation!(sparse_product
    { sparse_product: of_shape(&[5, 3]),
        |x| {
            let (columns, entry) = (x[0].shape()[0] as u32, |k: u32| f64::from(k % 7) - 3.0);
            let entries = (0..4 * columns).map(|k| (k * k % 6, k * 31 % columns, entry(k)));
            SparseMatrix::new(6, columns as usize, entries)?.cast::<T>().product(x[0])?
        },
        large [&[9001, 3]] }
    { sparse_product_with_a_list: of_shape(&[3]), |x| {
        let entries = [(0, 0, 2.0), (0, 2, -1.0), (3, 1, 0.5)];
        SparseMatrix::new(4, 3, entries)?.cast::<T>().product(x[0])?
},
        refuses "sparse_product needs shape [3] or [3, C], got shape [4]" [&[4][..]],
        refuses "sparse_product needs shape [3] or [3, C], got shape [3, 1, 1]" [&[3, 1, 1][..]],
    refuses "sparse_product needs shape [3] or [3, C], got shape []" [&[][..]],
    refuses "sparse_product needs shape [3] or [3, C], got shape [2, 3]" [&[2, 3][..]] }
    "sparse_product": |s| [s.vectors[0]], |x| {
        // Each row beside the next five of a ring.
        let rows = x[0].shape()[0];
        let entry = |k: usize| ((k / 5) as u32, ((k / 5 + k % 5) % rows) as u32, T::ONE);
        SparseMatrix::new(rows, rows, (0..5 * rows).map(entry))?.product(x[0])?
    };
);

operation!(squared_error
    { squared_error: parts(&[&[5, 3], &[5, 3]]), |x| {
        [bokashi_core::squared_error(x[0], x[1])?, bokashi_core::mean_squared_error(x[0], x[1])?]
}, large [MANY, MANY],
        refuses "squared_error needs an image and a reference of one shape, got shapes [2, 3] and [3, 2]"
            [&[2, 3][..], &[3, 2]],
        otherwise |x| bokashi_core::mean_squared_error(x[0], x[1])?,
        refuses "mean_squared_error needs at least one entry, got shape [0, 3]" [&[0, 3][..], &[0, 3]] }
    "squared_error": |s| [s.image, s.aliased], |x| bokashi_core::squared_error(x[0], x[1])?;
);

operation!(compositions
    { a_network_of_two_layers: parts(&[&[5, 3], &[3, 4], &[4], &[4, 2]]), |x| {
        let hidden = x[0].matmul(x[1])?.try_add(x[2])?.tanh();
        hidden.matmul(x[3])?.square().mean()?
} }
    { two_outputs_that_share_a_node: parts(&[&[3], &[3]]), |x| {
        let product = x[0].try_mul(x[1])?;
        [product.exp(), product.sum()]
} }
);

/// Sums over parts: of sines that cancel, so that more cases than these ask more of rounding than the laws know.
pub(crate) mod sum_over {
    use super::*;

    pub(crate) fn entry() -> Entry {
        subject!(SumOver: |x| {
            x[0].tape().sum_over(5, x, |k, _, x| {
                let scaled = x[0].try_mul(x[1])? * T::from_f64(0.3 + k as f64);
                Ok::<_, TensorError>(scaled.sin().sum())
            })?
        });
        let lists = (1..4_usize).prop_flat_map(|n| vec(tensor([n], number()), 2));
        let lists = lists.prop_map(|lists| lists.into_iter().map(Input::leaf).collect::<Vec<_>>());
        let mut entry = Entry::new("sum_over");
        entry.check(Check::new("sum_over", SumOver, lists).refuses(
            "mul needs shapes that broadcast, got [2] and [3]",
            halves(SumOver, &[&[2], &[3]]),
        ));
        benchmark!(entry, "sum_over", |s| [s.positive], |x| {
            x[0].tape().sum_over(4, &x[..1], |k, _, part| {
                Ok::<_, TensorError>(part[0].slice(1, 4 * k..4 * (k + 1))?.square().sum())
            })?
        });
        entry
    }
}
