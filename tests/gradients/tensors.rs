//! One law, a list of operations. Every core operation keeps the laws of `bokashi-check`, over shapes
//! of all kinds and values close to where the operation is not smooth. The check catches every wrong
//! adjoint made from it.

use std::fs;
use std::sync::Arc;

use bokashi_check::strategy::{
    around, broadcasting_shapes, non_zero, number, shape as any_shape, tensor,
};
use bokashi_check::{Case, Check, Input, Outcome, Subject, sides, subject};
use bokashi_core::{Mask, Padding, Scalar, SparseMatrix, Tensor, Var};
use proptest::prelude::*;
use proptest::sample;

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

/// What a law is checked on, besides its cases.
#[derive(Default)]
struct Also {
    large: Option<Inputs>,
    refused: Vec<(&'static str, Vec<&'static [usize]>)>,
}

fn check(name: &str, subject: impl Subject + Copy, inputs: Inputs, also: Also) {
    let case = move |inputs: Vec<Input>| Case::new(subject, inputs);
    let mut check = Check::new(name, subject, inputs).cases(CASES);
    if let Some(large) = also.large {
        check = check.large(1, large.prop_map(case));
    }
    for (what, shapes) in also.refused {
        let inputs = shapes.into_iter().map(|axes| Input::leaf(Tensor::full(axes, 0.5))).collect();
        check = check.refuses(what, case(inputs));
    }
    check.assert();
    let kills = check.kills().unwrap_or_else(|failure| panic!("{failure}"));
    println!("{kills}");
    assert!(kills.tried > 0 && kills.survivors.is_empty(), "{kills}");
}

/// The law for one operation: its name, a strategy for its inputs, and the operation; then shapes
/// of inputs that are worked on in pieces, and shapes that it must refuse.
macro_rules! law {
    (
        $name:ident, $inputs:expr, |$x:ident| $output:expr
        $(, large $large:expr)? $(, refuses $what:literal $refused:expr)*
    ) => {
        #[test]
        fn $name() {
            subject!(Operation: |$x| $output);
            #[allow(unused_mut, reason = "not every operation has more")]
            let mut also = Also::default();
            $(also.large = Some(large(&$large));)?
            $(also.refused.push(($what, $refused.to_vec()));)*
            check(stringify!($name), Operation, $inputs, also);
        }
    };
}

/// An output with kinks at these values of `x`.
fn kinked<'t, T: Scalar>(output: Var<'t, T>, x: Var<'t, T>, kinks: &[f64]) -> Outcome<'t, T> {
    Outcome::from(output).with_state(sides(x, kinks))
}

const MANY: &[usize] = &[5, 9001];
const ROW: &[usize] = &[9001];

law!(add, pair(number(), number()), |x| x[0].try_add(x[1])?, large [MANY, ROW],
    refuses "extents that differ" [&[2, 3][..], &[2, 4]]);
law!(sub, pair(number(), number()), |x| x[0].try_sub(x[1])?, large [ROW, MANY],
    refuses "extents that differ" [&[2][..], &[3]]);
law!(mul, pair(number(), number()), |x| x[0].try_mul(x[1])?, large [MANY, MANY],
    refuses "extents that differ" [&[4, 1][..], &[3, 3]]);
law!(div, pair(number(), non_zero()), |x| x[0].try_div(x[1])?, large [MANY, &[5, 1]],
    refuses "extents that differ" [&[2][..], &[0]]);
law!(div_by_a_number, one(number()), |x| x[0] / T::from_f64(3.0));
law!(square_by_one_input_twice, one(number()), |x| x[0].try_mul(x[0])?);
law!(minimum, pair(around(&[0.5], -2.0..2.0), around(&[0.5], -2.0..2.0)),
    |x| kinked(x[0].minimum(x[1])?, x[0].try_sub(x[1])?, &[0.0]), large [MANY, ROW],
    refuses "extents that differ" [&[2][..], &[3]]);
law!(maximum, pair(around(&[0.5], -2.0..2.0), around(&[0.5], -2.0..2.0)),
    |x| kinked(x[0].maximum(x[1])?, x[0].try_sub(x[1])?, &[0.0]), large [MANY, MANY],
    refuses "extents that differ" [&[2][..], &[3]]);

law!(pow, pair(within(0.1..3.0), number()), |x| x[0].pow(x[1])?, large [MANY, ROW],
    refuses "extents that differ" [&[2][..], &[3]]);
law!(select, pair(number(), number()), |x| {
    Mask::from_flat_fn(x[0].shape(), |k| k % 3 > 0).select(x[0], x[1])?
}, large [MANY, ROW], refuses "extents that differ" [&[2, 3][..], &[2, 4]]);
law!(select_by_a_mask_of_another_shape, parts(&[&[2, 1], &[3]]), |x| {
    Mask::from_fn([4, 1, 3], |[i, _, k]| (i + k) % 3 == 0).select(x[0], x[1])?
}, large [&[9001, 1], &[3]]);
law!(select_by_comparison, pair(around(&[0.5], -2.0..2.0), around(&[0.5], -2.0..2.0)), |x| {
    let smaller = x[0].is_less(x[1])?.select(x[0], x[1])?;
    kinked(smaller, x[0].try_sub(x[1])?, &[0.0])
}, large [MANY, ROW]);
law!(select_beside_a_nan, one(around(&[0.5], -2.0..2.0)), |x| {
    let number = |number| x[0].tape().constant_scalar(T::from_f64(number));
    let is_large = x[0].is_greater(number(0.5))?;
    let chosen = is_large.select(is_large.select(x[0], number(1.0))?.ln(), x[0])?;
    kinked(chosen, x[0], &[0.5])
});

law!(affine, one(number()), |x| x[0].affine(T::from_f64(-1.5), T::from_f64(0.25)), large[MANY]);
law!(neg, one(number()), |x| -x[0]);
law!(numbers, one(number()), |x| (x[0] * T::from_f64(0.5) + T::from_f64(2.0)) * T::from_f64(3.0)
    - T::from_f64(1.0));
law!(exp, one(within(-5.0..5.0)), |x| x[0].exp(), large[MANY]);
law!(ln, one(within(0.05..9.0)), |x| x[0].ln(), large[MANY]);
law!(sqrt, one(within(0.05..9.0)), |x| x[0].sqrt(), large[MANY]);
law!(sin, one(within(-9.0..9.0)), |x| x[0].sin(), large[MANY]);
law!(cos, one(within(-9.0..9.0)), |x| x[0].cos(), large[MANY]);
law!(tanh, one(within(-9.0..9.0)), |x| x[0].tanh(), large[MANY]);
law!(sigmoid, one(within(-20.0..20.0)), |x| x[0].sigmoid(), large[MANY]);
law!(softplus, one(within(-20.0..20.0)), |x| x[0].softplus(), large[MANY]);
law!(square, one(number()), |x| x[0].square());
law!(powi_of_one, one(number()), |x| x[0].powi(1));
law!(powi_of_five, one(number()), |x| x[0].powi(5), large[MANY]);
law!(powi_of_minus_two, one(non_zero()), |x| x[0].powi(-2));
law!(powf, one(within(0.05..9.0)), |x| x[0].powf(T::from_f64(2.2)), large[MANY]);
law!(powf_of_three, one(number()), |x| x[0].powf(T::from_f64(3.0)));
law!(powf_of_minus_a_half, one(within(0.1..9.0)), |x| x[0].powf(T::from_f64(-0.5)));
law!(relu, one(around(&[0.0], -2.0..2.0)), |x| kinked(x[0].relu(), x[0], &[0.0]), large[MANY]);
law!(abs, one(around(&[0.0], -2.0..2.0)), |x| kinked(x[0].abs(), x[0], &[0.0]), large[MANY]);
law!(
    clamp,
    one(around(&[-1.0, 0.5], -2.0..2.0)),
    |x| kinked(x[0].clamp(T::from_f64(-1.0), T::from_f64(0.5))?, x[0], &[-1.0, 0.5]),
    large[MANY]
);

law!(sum, one(number()), |x| x[0].sum(), large[MANY]);
law!(mean, not_empty(), |x| x[0].mean()?, large [MANY], refuses "no entries" [&[0][..]]);
law!(sum_axis_0, of_shape(&[3, 2, 4]), |x| x[0].sum_axis(0)?, large [MANY],
    refuses "no such axis" [&[][..]]);
law!(sum_axis_1, of_shape(&[3, 2, 4]), |x| x[0].sum_axis(1)?, large [MANY],
    refuses "no such axis" [&[3][..]]);
law!(sum_axis_2, of_shape(&[3, 2, 4]), |x| x[0].sum_axis(2)?);
law!(mean_axis_0, of_shape(&[3, 9]), |x| x[0].mean_axis(0)?, large [MANY],
    refuses "no entries along the axis" [&[0, 2][..]]);
law!(mean_axis_1, of_shape(&[3, 9]), |x| x[0].mean_axis(1)?, large[MANY]);
law!(mean_axis_of_extent_1, of_shape(&[3, 1, 2]), |x| x[0].mean_axis(1)?);

law!(dot, parts(&[&[4, 3], &[4, 3]]), |x| x[0].dot(x[1])?, large [&[9001, 3], &[9001, 3]],
    refuses "extents that differ" [&[2, 3][..], &[2, 4]],
    refuses "axes that do not broadcast" [&[2, 3][..], &[4, 3]],
    refuses "scalars" [&[][..], &[]]);
law!(dot_with_a_row, parts(&[&[5, 3], &[3]]), |x| x[0].dot(x[1])?, large [&[9001, 3], &[3]]);
law!(dot_of_columns, parts(&[&[3, 4], &[3, 1]]), |x| x[0].transpose()?.dot(x[1].transpose()?)?,
    large [&[3, 20_000], &[3, 1]]);
law!(dot_of_long_lists, parts(&[&[11], &[11]]), |x| x[0].dot(x[1])?, large [&[50_000], &[50_000]]);
law!(dot_of_shapes_that_broadcast, parts(&[&[2, 1, 3], &[4, 3]]), |x| x[0].dot(x[1])?,
    large [&[20, 1, 300], &[40, 300]]);
law!(dot_with_itself, of_shape(&[4, 3]), |x| x[0].dot(x[0])?);
law!(cross, parts(&[&[4, 3], &[4, 3]]), |x| x[0].cross(x[1])?, large [&[9001, 3], &[9001, 3]],
    refuses "two components" [&[2, 2][..], &[2, 2]],
    refuses "extents that differ" [&[2, 3][..], &[5, 3]]);
law!(cross_with_a_row, parts(&[&[3], &[5, 3]]), |x| x[0].cross(x[1])?, large [&[3], &[9001, 3]]);
law!(cross_of_shapes_that_broadcast, parts(&[&[2, 1, 3], &[4, 3]]), |x| x[0].cross(x[1])?,
    large [&[70, 1, 3], &[90, 3]]);
law!(norm, vectors(&[4, 3]), |x| x[0].norm()?, large [&[9001, 3]], refuses "a scalar" [&[][..]]);
law!(norm_of_columns, vectors(&[3, 4]), |x| x[0].transpose()?.norm()?, large[&[3, 20_000]]);
law!(norm_of_a_long_list, vectors(&[11]), |x| x[0].norm()?, large[&[50_000]]);
law!(norm_of_one, one(non_zero()), |x| x[0].keepdim(x[0].shape().rank())?.norm()?);
law!(normalize, vectors(&[4, 3]), |x| x[0].normalize()?, large [&[9001, 3]],
    refuses "a scalar" [&[][..]]);
law!(normalize_a_long_list, vectors(&[11]), |x| x[0].normalize()?, large[&[50_000]]);

law!(matmul, matrices(), |x| x[0].matmul(x[1])?, large [&[150, 130], &[130, 140]],
    refuses "inner extents that differ" [&[2, 3][..], &[2, 3]],
    refuses "a vector" [&[3][..], &[3, 3]]);
law!(matmul_with_itself, of_shape(&[3, 3]), |x| x[0].matmul(x[0])?);
law!(reshape, of_shape(&[2, 3]), |x| x[0].reshape([3, 1, 2])?,
    refuses "another number of entries" [&[7][..]]);
law!(keepdim, of_shape(&[2, 3]), |x| x[0].keepdim(1)?, refuses "beyond the rank" [&[][..]]);
law!(transpose, of_shape(&[2, 3]), |x| x[0].transpose()?, refuses "a vector" [&[7][..]]);
law!(permute, of_shape(&[2, 3, 4]), |x| x[0].permute(&[2, 0, 1])?, large [&[20, 30, 70]],
    refuses "another number of axes" [&[2, 3][..]]);
law!(slice_of_rows, of_shape(&[4, 3]), |x| x[0].slice(0, 1..3)?, large [MANY],
    refuses "beyond the extent" [&[2, 9][..]]);
law!(slice_of_columns, of_shape(&[2, 4, 3]), |x| x[0].slice(1, 1..4)?,
    refuses "no such axis" [&[9][..]]);
law!(pad, of_shape(&[2, 3, 2]), |x| x[0].pad(1, [4, 8], Padding::Mirror)?, large [&[7, 90, 60]],
    refuses "nothing to repeat" [&[2, 0][..]]);
law!(
    pad_with_a_constant,
    of_shape(&[3]),
    |x| x[0].pad(0, [2, 1], Padding::Constant(T::ONE))?,
    large[&[50_000]]
);
law!(pad_by_clamping, of_shape(&[3, 2]), |x| x[0].pad(0, [3, 2], Padding::Clamp)?, large[MANY]);
law!(pad_by_wrapping, of_shape(&[2, 3]), |x| x[0].pad(1, [5, 4], Padding::Wrap)?, large[MANY]);
law!(stack, parts(&[&[2, 3], &[2, 3], &[2, 3]]), |x| Var::stack(x, 2)?, large [MANY, MANY],
    refuses "shapes that differ" [&[2, 3][..], &[3, 2]],
    refuses "an axis beyond the rank" [&[2][..]]);
law!(stack_of_rows, parts(&[&[2, 3], &[2, 3]]), |x| Var::stack(x, 0)?, large [MANY, MANY]);
law!(stack_of_one_with_itself, of_shape(&[3]), |x| Var::stack(&[x[0], x[0]], 1)?);
law!(concat_of_rows, parts(&[&[1, 3], &[0, 3], &[2, 3]]), |x| Var::concat(x, 0)?,
    refuses "other extents that differ" [&[2, 3][..], &[2, 4]]);
law!(concat_of_columns, parts(&[&[2, 1, 2], &[2, 3, 2]]), |x| Var::concat(x, 1)?,
    large [&[4000, 5, 2], &[4000, 1, 2]], refuses "ranks that differ" [&[2, 3][..], &[3]]);
law!(concat_with_itself, of_shape(&[2, 2]), |x| Var::concat(&[x[0], x[0], x[0]], 1)?);
law!(gather_rows, of_shape(&[4, 2]), |x| x[0].gather_rows(&Arc::from([3, 0, 3, 3, 1]))?,
    large [MANY], refuses "an index beyond the rows" [&[3, 2][..]]);
law!(gather_entries, of_shape(&[3]), |x| x[0].gather_rows(&Arc::from([2, 2]))?,
    refuses "a scalar" [&[][..]]);

law!(
    scatter_add_rows,
    of_shape(&[5, 2]),
    |x| {
        let rows: Arc<[u32]> = (0..x[0].shape()[0]).map(|r| (r * r % 4) as u32).collect();
        x[0].scatter_add_rows(&rows, 4)?
    },
    large[&[20_000, 3]]
);
law!(scatter_add_entries, of_shape(&[3]), |x| x[0].scatter_add_rows(&Arc::from([1, 1, 0]), 3)?,
    refuses "a row too many" [&[4][..]], refuses "a scalar" [&[][..]]);
law!(
    sparse_product,
    of_shape(&[5, 3]),
    |x| {
        let (columns, entry) = (x[0].shape()[0] as u32, |k: u32| f64::from(k % 7) - 3.0);
        let entries = (0..4 * columns).map(|k| (k * k % 6, k * 31 % columns, entry(k)));
        SparseMatrix::new(6, columns as usize, entries)?.cast::<T>().product(x[0])?
    },
    large[&[9001, 3]]
);
law!(sparse_product_with_a_list, of_shape(&[3]), |x| {
    let entries = [(0, 0, 2.0), (0, 2, -1.0), (3, 1, 0.5)];
    SparseMatrix::new(4, 3, entries)?.cast::<T>().product(x[0])?
}, refuses "another extent" [&[4][..]], refuses "three axes" [&[3, 1, 1][..]]);

law!(squared_error, parts(&[&[5, 3], &[5, 3]]), |x| {
    [bokashi_core::squared_error(x[0], x[1])?, bokashi_core::mean_squared_error(x[0], x[1])?]
}, large [MANY, MANY], refuses "another shape" [&[2, 3][..], &[3, 2]]);
law!(a_network_of_two_layers, parts(&[&[5, 3], &[3, 4], &[4], &[4, 2]]), |x| {
    let hidden = x[0].matmul(x[1])?.try_add(x[2])?.tanh();
    hidden.matmul(x[3])?.square().mean()?
});
law!(two_outputs_that_share_a_node, parts(&[&[3], &[3]]), |x| {
    let product = x[0].try_mul(x[1])?;
    [product.exp(), product.sum()]
});

/// Operations without a gradient worth a control: it is zero, or has no entry.
#[test]
fn gradients_that_vanish() {
    subject!(Constant: |x| x[0].powi(0));
    subject!(NoRows: |x| x[0].gather_rows(&Arc::from([]))?);
    subject!(NoColumns: |x| x[0].slice(1, 2..2)?);
    subject!(Unit: |x| x[0].powf(T::ZERO));
    Check::new("powf of zero", Unit, one(number())).assert();
    Check::new("powi of zero", Constant, one(number())).assert();
    Check::new("gather of no rows", NoRows, of_shape(&[4, 2])).assert();
    Check::new("slice of no columns", NoColumns, of_shape(&[2, 4])).assert();
}

#[test]
fn no_operation_is_forgotten() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../crates/core/src/ops");
    let laws: String = include_str!("tensors.rs").split_whitespace().collect();
    let mut count = 0;
    for file in fs::read_dir(folder).unwrap() {
        let name = file.unwrap().file_name().into_string().unwrap();
        let operation = name.trim_end_matches(".rs");
        if operation != "mod" {
            assert!(laws.contains(&format!("law!({operation}")), "{operation} has no law");
            count += 1;
        }
    }
    assert!(count > 20);
}
