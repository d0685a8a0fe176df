//! One law, a list of operations: the gradient of every core operation agrees with difference
//! quotients, over shapes of all kinds and values close to where the operation is not smooth.

#[path = "support/difference.rs"]
mod difference;

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Shape, Tensor, TensorError, Var};
use difference::{Input, assert_gradients};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

const CASES: u32 = 64;

/// Shapes of every rank up to 3, with extents of 0 and 1 among them.
fn any_shape() -> impl Strategy<Value = Shape> {
    vec(prop_oneof![1 => Just(0_usize), 9 => 1..4_usize], 0..=3).prop_map(|axes| axes[..].into())
}

/// A tensor of `shape` with entries from `entries`.
fn tensor(shape: &Shape, entries: BoxedStrategy<f64>) -> BoxedStrategy<Tensor<f64>> {
    let shape = shape.clone();
    let data = vec(entries, shape.size());
    data.prop_map(move |data| Tensor::new(&shape, data).unwrap()).boxed()
}

/// Numbers in `range`.
fn within(range: Range<f64>) -> BoxedStrategy<f64> {
    range.boxed()
}

/// Numbers in `range`, some of them right beside a kink, few enough of them on it.
fn around(kinks: &'static [f64], range: Range<f64>) -> BoxedStrategy<f64> {
    let beside = (select(kinks), select(&[-2e-3, 2e-3, -1e-2, 1e-2, 0.0][..]));
    prop_oneof![3 => range, 1 => beside.prop_map(|(kink, offset)| kink + offset)].boxed()
}

fn input(tensor: Tensor<f64>, differentiable: bool) -> Input {
    if differentiable { Input::leaf(tensor) } else { Input::constant(tensor) }
}

/// One leaf of any shape.
fn one(entries: BoxedStrategy<f64>) -> BoxedStrategy<Vec<Input>> {
    let tensors = any_shape().prop_flat_map(move |shape| tensor(&shape, entries.clone()));
    tensors.prop_map(|x| vec![Input::leaf(x)]).boxed()
}

/// Two inputs whose shapes broadcast, one of them perhaps a constant.
fn pair(left: BoxedStrategy<f64>, right: BoxedStrategy<f64>) -> BoxedStrategy<Vec<Input>> {
    let shapes = (any_shape(), vec(any::<[bool; 2]>(), 3), 0..=3_usize, any::<bool>());
    let shapes = shapes.prop_map(|(full, repeats, shortened, left_is_short)| {
        let mut sides: [Vec<usize>; 2] = [full.to_vec(), full.to_vec()];
        for (axis, repeat) in repeats.iter().enumerate().take(full.len()) {
            match repeat {
                [true, true] => {}
                [left, right] => {
                    for (side, &repeats) in sides.iter_mut().zip([left, right]) {
                        side[axis] = if repeats { 1 } else { side[axis] };
                    }
                }
            }
        }
        let [left, right] = &mut sides;
        let short = if left_is_short { left } else { right };
        short.drain(..shortened.min(short.len()));
        sides.map(|side| Shape::from(&side[..]))
    });
    let masks = select(&[[true, true], [true, true], [true, false], [false, true]][..]);
    let inputs = (shapes, masks).prop_flat_map(move |([x, y], [x_leaf, y_leaf])| {
        (tensor(&x, left.clone()), tensor(&y, right.clone()))
            .prop_map(move |(x, y)| vec![input(x, x_leaf), input(y, y_leaf)])
    });
    inputs.boxed()
}

fn sign(x: f64) -> i8 {
    i8::from(x > 0.0) - i8::from(x < 0.0)
}

/// On which side of each of `kinks` the entries of `x` lie.
fn sides(x: Var<'_, f64>, kinks: &[f64]) -> Vec<i8> {
    let x = x.value();
    x.data().iter().flat_map(|x| kinks.iter().map(move |kink| sign(x - kink))).collect()
}

/// The law for one operation: a name, a strategy for its inputs, and the operation; its discrete
/// state after a semicolon where it has one.
macro_rules! law {
    ($name:ident, $inputs:expr, |$x:ident| $output:expr) => {
        law!($name, $inputs, |$x| $output; ());
    };
    ($name:ident, $inputs:expr, |$x:ident| $output:expr; $state:expr) => {
        #[test]
        fn $name() {
            assert_gradients(stringify!($name), CASES, $inputs, |_, $x| {
                let output: Result<Var<'_, f64>, TensorError> = $output;
                Ok::<_, TensorError>((vec![output?], $state))
            });
        }
    };
}

fn any_number() -> BoxedStrategy<f64> {
    within(-3.0..3.0)
}

/// Away from 0 on both sides, but close to it.
fn non_zero() -> BoxedStrategy<f64> {
    prop_oneof![0.1..3.0, -3.0..-0.1].boxed()
}

law!(add, pair(any_number(), any_number()), |x| x[0].try_add(x[1]));
law!(sub, pair(any_number(), any_number()), |x| x[0].try_sub(x[1]));
law!(mul, pair(any_number(), any_number()), |x| x[0].try_mul(x[1]));
law!(div, pair(any_number(), non_zero()), |x| x[0].try_div(x[1]));
law!(div_by_a_number, one(any_number()), |x| Ok(x[0] / 3.0));
law!(number_divided, one(non_zero()), |x| Ok(2.0 / x[0]));
law!(square_by_one_input_twice, one(any_number()), |x| x[0].try_mul(x[0]));
law!(minimum, pair(around(&[0.5], -2.0..2.0), around(&[0.5], -2.0..2.0)),
    |x| x[0].minimum(x[1]); sides(x[0] - x[1], &[0.0]));
law!(maximum, pair(around(&[0.5], -2.0..2.0), around(&[0.5], -2.0..2.0)),
    |x| x[0].maximum(x[1]); sides(x[0] - x[1], &[0.0]));

law!(affine, one(any_number()), |x| Ok(x[0].affine(-1.5, 0.25)));
law!(neg, one(any_number()), |x| Ok(-x[0]));
law!(numbers_on_both_sides, one(any_number()), |x| Ok(1.0 - (0.5 * x[0] + 2.0) * 3.0 - 1.0));
law!(exp, one(within(-5.0..5.0)), |x| Ok(x[0].exp()));
law!(ln, one(within(0.05..9.0)), |x| Ok(x[0].ln()));
law!(sqrt, one(within(0.05..9.0)), |x| Ok(x[0].sqrt()));
law!(sin, one(within(-9.0..9.0)), |x| Ok(x[0].sin()));
law!(cos, one(within(-9.0..9.0)), |x| Ok(x[0].cos()));
law!(tanh, one(within(-9.0..9.0)), |x| Ok(x[0].tanh()));
law!(sigmoid, one(within(-20.0..20.0)), |x| Ok(x[0].sigmoid()));
law!(softplus, one(within(-20.0..20.0)), |x| Ok(x[0].softplus()));
law!(square, one(any_number()), |x| Ok(x[0].square()));
law!(powi_of_zero, one(any_number()), |x| Ok(x[0].powi(0)));
law!(powi_of_one, one(any_number()), |x| Ok(x[0].powi(1)));
law!(powi_of_five, one(any_number()), |x| Ok(x[0].powi(5)));
law!(powi_of_minus_two, one(non_zero()), |x| Ok(x[0].powi(-2)));
law!(abs, one(around(&[0.0], -2.0..2.0)), |x| Ok(x[0].abs()); sides(x[0], &[0.0]));
law!(clamp, one(around(&[-1.0, 0.5], -2.0..2.0)),
    |x| x[0].clamp(-1.0, 0.5); sides(x[0], &[-1.0, 0.5]));

law!(sum, one(any_number()), |x| Ok(x[0].sum()));
law!(mean, not_empty(), |x| x[0].mean());
law!(sum_axis_0, of_shape(&[3, 2, 4]), |x| x[0].sum_axis(0));
law!(sum_axis_1, of_shape(&[3, 2, 4]), |x| x[0].sum_axis(1));
law!(sum_axis_2, of_shape(&[3, 2, 4]), |x| x[0].sum_axis(2));
law!(mean_axis_0, of_shape(&[3, 9]), |x| x[0].mean_axis(0));
law!(mean_axis_1, of_shape(&[3, 9]), |x| x[0].mean_axis(1));
law!(mean_axis_of_extent_1, of_shape(&[3, 1, 2]), |x| x[0].mean_axis(1));

law!(matmul, matrices(), |x| x[0].matmul(x[1]));
law!(matmul_with_itself, of_shape(&[3, 3]), |x| x[0].matmul(x[0]));
law!(reshape, of_shape(&[2, 3]), |x| x[0].reshape([3, 1, 2]));
law!(transpose, of_shape(&[2, 3]), |x| x[0].transpose());
law!(permute, of_shape(&[2, 3, 4]), |x| x[0].permute(&[2, 0, 1]));
law!(slice_of_rows, of_shape(&[4, 3]), |x| x[0].slice(0, 1..3));
law!(slice_of_columns, of_shape(&[2, 4, 3]), |x| x[0].slice(1, 1..4));
law!(slice_of_nothing, of_shape(&[2, 4]), |x| x[0].slice(1, 2..2));
law!(concat_of_rows, parts(&[&[1, 3], &[0, 3], &[2, 3]]), |x| Var::concat(x, 0));
law!(concat_of_columns, parts(&[&[2, 1, 2], &[2, 3, 2]]), |x| Var::concat(x, 1));
law!(concat_with_itself, of_shape(&[2, 2]), |x| Var::concat(&[x[0], x[0], x[0]], 1));
law!(gather_rows, of_shape(&[4, 2]), |x| x[0].gather_rows(&Arc::from([3, 0, 3, 3, 1])));
law!(gather_no_rows, of_shape(&[4, 2]), |x| x[0].gather_rows(&Arc::from([])));
law!(gather_entries, of_shape(&[3]), |x| x[0].gather_rows(&Arc::from([2, 2])));

fn of_shape(axes: &[usize]) -> BoxedStrategy<Vec<Input>> {
    tensor(&axes.into(), any_number()).prop_map(|x| vec![Input::leaf(x)]).boxed()
}

fn not_empty() -> BoxedStrategy<Vec<Input>> {
    one(any_number()).prop_filter("a mean needs entries", |x| x[0].tensor.size() > 0).boxed()
}

fn parts(shapes: &[&[usize]]) -> BoxedStrategy<Vec<Input>> {
    let parts: Vec<_> = shapes.iter().map(|&axes| tensor(&axes.into(), any_number())).collect();
    parts.prop_map(|parts| parts.into_iter().map(Input::leaf).collect()).boxed()
}

/// `[m, k]` and `[k, n]`, inner loops shorter and longer than a vector register.
fn matrices() -> BoxedStrategy<Vec<Input>> {
    let extent = || prop_oneof![Just(0_usize), 1..5_usize, Just(18)];
    let masks = select(&[[true, true], [true, false], [false, true]][..]);
    let inputs = ([extent(), extent(), extent()], masks).prop_flat_map(|([m, k, n], leaf)| {
        let matrices = (tensor(&[m, k].into(), any_number()), tensor(&[k, n].into(), any_number()));
        matrices.prop_map(move |(x, y)| vec![input(x, leaf[0]), input(y, leaf[1])])
    });
    inputs.boxed()
}
