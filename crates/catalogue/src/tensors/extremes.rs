//! Operations on tensors at the ends of what they are defined for.

use std::sync::Arc;

use bokashi_core::{Mask, Padding, Scalar, SparseMatrix, Tape, Tensor, Var};
use bokashi_fit::{Fit, FitError, FitSettings, Parameter, Parameters, from_fn};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{difference, largest, motley, numbers, rounding, tensor};

pub(crate) static NORMALIZE: &[Extreme] = extremes! {
    101 "vectors of 0: norm, normalize", "0, gradient 0", vectors_of_zero;
    102 "vectors of every size", "length and direction", vectors_of_every_size;
};

pub(crate) static POW: &[Extreme] = extremes! {
    103 "powers at 0, below, of 1e30", "the limits, or an error", powers_at_zero;
};

pub(crate) static SELECT: &[Extreme] = extremes! {
    104 "select beside NaN and infinity", "nothing of what is masked", masked_numbers;
};

pub(crate) static SUM: &[Extreme] = extremes! {
    105 "empty axes", "empty, or sums of 0", empty_axes;
    106 "sums that cancel", "every digit of the rest", sums_that_cancel;
};

pub(crate) static CROSS: &[Extreme] = extremes! {
    107 "nearly parallel vectors: cross", "their small product", nearly_parallel_vectors;
};

pub(crate) static PAD: &[Extreme] = extremes! {
    108 "padding far beyond the axis", "again and again", far_beyond_an_axis;
};

/// Whether the numbers are those of `f32`.
fn is_single<T: Scalar>() -> bool {
    rounding::<T>() > 1e-10
}

fn vectors_of_zero<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let mut wrong = Vec::new();
    // Every other vector is 0, as rows and as columns.
    for (shape, axis) in [([6, 3], 1), ([3, 6], 0)] {
        let vector = |k: usize| if axis == 1 { k / 3 } else { k % 6 };
        let x = tape.leaf(&tensor(&shape, |k| if vector(k) % 2 == 0 { 0.0 } else { motley(k) }));
        let rows = if axis == 1 { x } else { x.transpose()? };
        let directions =
            if axis == 1 { rows.normalize()? } else { rows.normalize()?.transpose()? };
        for y in [directions, rows.norm()?.keepdim(axis)?.try_mul(x)?] {
            let upstream = tensor(&shape, |k| 1.0 + motley(3 * k));
            let gradients = tape.vjp(&[(y, &upstream)])?;
            let found = [numbers(&y.value()), numbers(&gradients.get_or_zeros(x))];
            for found in found {
                for (k, number) in found.into_iter().enumerate() {
                    let is_zero = vector(k) % 2 == 0;
                    wrong.push(if is_zero { number != 0.0 } else { !number.is_finite() });
                }
            }
        }
    }
    let wrong = wrong.into_iter().filter(|wrong| *wrong).count();
    Ok(Verdict::exactly("0 with gradient 0, and its neighbours finite", wrong))
}

fn vectors_of_every_size<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let exponents: &[i32] =
        if is_single::<T>() { &[-120, -80, 0, 80, 120] } else { &[-1010, -600, 0, 600, 1010] };
    let (vector, upstream) = ([2.0, -3.0, 6.0], [1.0, 2.0, -1.0]);
    // <y, y_bar> = -10 / 7 for the direction y.
    let across: Vec<_> =
        vector.iter().zip(upstream).map(|(x, bar)| (bar + x / 7.0 * (10.0 / 7.0)) / 7.0).collect();
    let mut error = 0.0_f64;
    for &exponent in exponents {
        let factor = f64::powi(2.0, exponent);
        let x = tape.leaf(&tensor(&[3], |k| vector[k] * factor));
        let (length, direction) = (x.norm()?, x.normalize()?);
        error = error.maximum_or_nan(length.item().to_f64() / factor / 7.0 - 1.0);
        let direction_bar = tape.vjp(&[(direction, &tensor(&[3], |k| upstream[k]))])?;
        let direction_bar = numbers(&direction_bar.get_or_zeros(x));
        let of_length = numbers(&length.backward()?.get_or_zeros(x));
        let unit = vector.map(|x| x / 7.0);
        let scaled: Vec<_> = direction_bar.iter().map(|bar| bar * factor).collect();
        for (found, expected) in [
            (&numbers(&direction.value()), &unit[..]),
            (&of_length, &unit[..]),
            (&scaled, &across[..]),
        ] {
            error = error.maximum_or_nan(difference(found, expected));
        }
    }
    Ok(Verdict::within("lengths, directions and gradients of 2^0", error, 4.0 * rounding::<T>()))
}

fn powers_at_zero<T: Scalar>() -> Outcome {
    let infinite = f64::INFINITY;
    // x, y: x^y, and the slopes to both.
    let cases = [
        (0.0, 2.5, [0.0, 0.0, 0.0]),
        (0.0, 1.0, [0.0, 1.0, 0.0]),
        (0.0, 0.5, [0.0, infinite, 0.0]),
        (0.0, 0.0, [1.0, 0.0, 0.0]),
        (0.0, -1.0, [infinite, -infinite, -infinite]),
        (1.0, 1e30, [1.0, 1e30, 0.0]),
        (1e30, 1e30, [infinite, infinite, infinite]),
        (1e-30, 1e30, [0.0, 0.0, 0.0]),
    ];
    let mut wrong = 0;
    for (x, y, expected) in cases {
        let tape = Tape::<T>::new();
        let [x, y] = [x, y].map(|number| tape.leaf_scalar(T::from_f64(number)));
        let z = x.pow(y)?;
        let gradients = z.backward()?;
        let found = [z.item(), gradients.get_or_zeros(x).item(), gradients.get_or_zeros(y).item()];
        let expected = expected.map(|number| T::from_f64(number).to_f64());
        wrong += usize::from(found.map(T::to_f64) != expected);
    }
    // Below 0: a constant whole exponent does no harm, and a fit refuses any other.
    let tape = Tape::<T>::new();
    let x = tape.leaf_scalar(T::from_f64(-2.0));
    let cube = x.pow(tape.constant_scalar(T::from_f64(3.0)))?;
    let slope = cube.backward()?.get_or_zeros(x).item().to_f64();
    wrong += usize::from((cube.item().to_f64(), slope) != (-8.0, 12.0));
    let start = Parameters::new().with(Parameter::new("x", Tensor::scalar(T::from_f64(-2.0))))?;
    let said: Result<_, FitError> =
        Fit::new(start, FitSettings::default())?.step(&mut from_fn(|_: &Tape<T>, variables| {
            Ok(variables.get("x")?.powf(T::from_f64(0.5)))
        }));
    let message = "the loss needs to be finite, got NaN at step 0, \
                   first in the output of powf of \"x\"";
    Ok(Verdict::exactly("the limits, slope 0 to exponents of 0 and above", wrong).and(
        said.map_err(|error| error.to_string()).err().as_deref() == Some(message),
        "a fit says something else",
    ))
}

fn masked_numbers<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let tape = Tape::<T>::new();
        let is_bad = Mask::from_flat_fn([40, 3], |k| k % 7 == 2);
        let truth = |k: usize| is_bad.data()[k];
        let x = tape.leaf(&tensor(&[40, 3], |k| if truth(k) { bad } else { motley(k) }));
        let zero = tape.leaf_scalar(T::ZERO);
        let z = is_bad.select(zero, x)?;
        let upstream = tensor(&[40, 3], |k| if truth(k) { 1.0 } else { motley(5 * k) });
        let gradients = tape.vjp(&[(z, &upstream)])?;
        let expected: [Vec<f64>; 2] = [motley, |k| motley(5 * k)].map(|entry| {
            let entry = |k: usize| if truth(k) { 0.0 } else { T::from_f64(entry(k)).to_f64() };
            (0..120).map(entry).collect()
        });
        wrong += usize::from(numbers(&z.value()) != expected[0]);
        wrong += usize::from(numbers(&gradients.get_or_zeros(x)) != expected[1]);
        wrong += usize::from(gradients.get_or_zeros(zero).item().to_f64() != is_bad.count() as f64);
        // The same mask by looking, and of numbers that compare with nothing.
        let finite = x.is_finite();
        wrong += usize::from(finite != !&is_bad || x.is_less(x)?.count() > 0);
        let beyond = z.is_at_most(x)?.or(&z.is_greater(x)?)?;
        wrong += usize::from(bad.is_nan() && beyond != finite);
    }
    Ok(Verdict::exactly("nothing of what is masked in value or gradient", wrong))
}

fn empty_axes<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let mut wrong = 0;
    let mut check = |y: Var<'_, T>, shape: &[usize]| -> Result<(), Failure> {
        wrong += usize::from(*y.shape() != *shape);
        wrong += y.value().data().iter().filter(|entry| **entry != T::ZERO).count();
        let gradients = y.sum().backward()?;
        let is_zero = |of: Var<'_, T>| largest(numbers(&gradients.get_or_zeros(of))) == 0.0;
        wrong += tape.variables().filter(|of| of.operation().is_none() && !is_zero(*of)).count();
        Ok(())
    };
    let leaf = |shape: &[usize]| tape.leaf(&Tensor::zeros(shape));
    let (rows, columns, vectors) = (leaf(&[0, 3]), leaf(&[3, 0]), leaf(&[0, 3]));
    check(columns.dot(columns)?, &[3])?;
    check(columns.dot(leaf(&[0]))?, &[3])?;
    check(columns.dot(leaf(&[1, 0]))?, &[3])?;
    check(rows.cross(vectors)?, &[0, 3])?;
    check(rows.cross(leaf(&[3]))?, &[0, 3])?;
    check(rows.norm()?, &[0])?;
    check(columns.norm()?, &[3])?;
    check(rows.normalize()?, &[0, 3])?;
    check(columns.normalize()?, &[3, 0])?;
    check(rows.pow(leaf(&[3]))?, &[0, 3])?;
    check(rows.keepdim(1)?, &[0, 1, 3])?;
    check(Var::stack(&[rows, vectors], 2)?, &[0, 3, 2])?;
    check(rows.pad(0, [2, 1], Padding::Constant(T::ZERO))?, &[3, 3])?;
    check(rows.pad(1, [9, 1], Padding::Mirror)?, &[0, 13])?;
    check(Mask::full([0, 1], true).select(rows, leaf(&[3]))?, &[0, 3])?;
    check(rows.scatter_add_rows(&Arc::from([]), 2)?, &[2, 3])?;
    check(columns.scatter_add_rows(&Arc::from([1, 1, 0]), 2)?, &[2, 0])?;
    check(leaf(&[2, 3]).gather_rows(&Arc::from([]))?, &[0, 3])?;
    let matrix = |m, n| SparseMatrix::<T>::new(m, n, []);
    check(matrix(4, 0)?.product(rows)?, &[4, 3])?;
    check(matrix(0, 3)?.product(columns)?, &[0, 0])?;
    check(matrix(0, 3)?.product(leaf(&[3]))?, &[0])?;
    // More entries than fit an index, were there any.
    let huge = 1_usize << 40;
    let hollow = leaf(&[0, huge, huge]);
    check(hollow.norm()?, &[0, huge])?;
    check(hollow.dot(hollow)?, &[0, huge])?;
    check(hollow.normalize()?, &[0, huge, huge])?;
    check(hollow.permute(&[1, 2, 0])?.normalize()?, &[huge, huge, 0])?;
    check(hollow.keepdim(0)?, &[1, 0, huge, huge])?;
    check(Var::stack(&[hollow, hollow], 1)?, &[0, 2, huge, huge])?;
    check(Var::concat(&[hollow, hollow], 1)?, &[0, 2 * huge, huge])?;
    check(hollow.pad(2, [1, 1], Padding::Wrap)?, &[0, huge, huge + 2])?;
    check(hollow.is_less(hollow)?.select(hollow, hollow)?, &[0, huge, huge])?;
    check(hollow.gather_rows(&Arc::from([]))?, &[0, huge, huge])?;
    check(hollow.scatter_add_rows(&Arc::from([]), 0)?, &[0, huge, huge])?;
    Ok(Verdict::exactly("empty, or sums of 0, and gradients of 0", wrong))
}

fn sums_that_cancel<T: Scalar>() -> Outcome {
    // Large numbers in pairs that cancel, and a small one between each pair.
    let (large, small, n) = (f64::powi(2.0, 30), 1.0, 30_000);
    let entry = |k: usize| [large, small, -large][k % 3];
    let tape = Tape::<T>::new();
    let list = tape.leaf(&tensor(&[n], entry));
    let rows = tape.leaf(&tensor(&[n, 2], |k| entry(k / 2)));
    let ones = tape.leaf_full([n], T::ONE);
    let all: Arc<[u32]> = vec![0; n].into();
    let sum = SparseMatrix::new(1, n, (0..n as u32).map(|k| (0, k, T::ONE)))?;
    let exact = n as f64 / 3.0 * small;
    let sums =
        [list.dot(ones)?, rows.scatter_add_rows(&all, 2)?.slice(0, 0..1)?, sum.product(rows)?];
    // The adjoints sum, too: of an entry that was repeated, padded, gathered, chosen.
    let one = tape.leaf_full([1], T::ONE);
    let repeated = [
        one.dot(tape.constant_full([n, 1], T::ONE))?,
        one.pad(0, [0, n - 1], Padding::Clamp)?,
        one.gather_rows(&all)?,
        Mask::full([n], false).select(tape.constant_scalar(T::ZERO), one)?,
    ];
    let mut found: Vec<_> = sums.iter().flat_map(|sum| numbers(&sum.value())).collect();
    for output in repeated {
        found.push(tape.vjp(&[(output, &list.value())])?.get_or_zeros(one).item().to_f64());
    }
    let expected = vec![exact; found.len()];
    Ok(Verdict::within("the small numbers' sum", difference(&found, &expected), 0.0))
}

fn nearly_parallel_vectors<T: Scalar>() -> Outcome {
    // (1 + a e) (1 - b e) - 1 = (a - b) e - a b e^2, for whole a and b.
    let tape = Tape::<T>::new();
    let e = 2.0 * rounding::<T>();
    let pairs: Vec<[f64; 2]> = (0..64).map(|k| [(k % 8) as f64, (k / 8) as f64 + 1.0]).collect();
    let x = tape.leaf(&tensor(&[64, 3], |k| [1.0 + pairs[k / 3][0] * e, 1.0, 0.0][k % 3]));
    let y = tape.leaf(&tensor(&[64, 3], |k| [1.0, 1.0 - pairs[k / 3][1] * e, 0.0][k % 3]));
    let z = x.cross(y)?.value();
    let exact = |[a, b]: [f64; 2]| (a - b) * e - a * b * e * e;
    let off = (0..64).map(|k| z[[k, 2]].to_f64() - exact(pairs[k]));
    let aside = (0..64).flat_map(|k| [z[[k, 0]].to_f64(), z[[k, 1]].to_f64()]);
    // Of f32 each product is exact; of f64 it is rounded, to a share of itself.
    let bound = if is_single::<T>() { rounding::<T>() * 16.0 * e } else { e };
    Ok(Verdict::within("their small product", largest(off), bound)
        .and(largest(aside) == 0.0, "other components are not 0"))
}

fn far_beyond_an_axis<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let mut wrong = 0;
    for padding in [Padding::Clamp, Padding::Mirror, Padding::Wrap] {
        for extent in [1, 2, 3] {
            let x = tape.leaf(&tensor(&[extent], |k| k as f64));
            let beyond = [99_999, 100_000];
            let y = x.pad(0, beyond, padding)?;
            let all = numbers(&y.value());
            let bars = numbers(&y.sum().backward()?.get_or_zeros(x));
            for (source, bar) in bars.into_iter().enumerate() {
                let shown = all.iter().filter(|entry| **entry == source as f64).count();
                wrong += usize::from(bar != shown as f64);
            }
            let shift = if padding == Padding::Mirror { 2 * extent } else { extent };
            let ends = beyond[0]..beyond[0] + extent;
            wrong += usize::from(!all[ends].iter().enumerate().all(|(k, x)| *x == k as f64));
            let repeats = (0..all.len() - shift).all(|p| all[p] == all[p + shift]);
            wrong += usize::from(padding != Padding::Clamp && !repeats);
            let sides = [&all[..beyond[0]], &all[beyond[0] + extent..]];
            let is_flat = sides.iter().all(|side| side.iter().all(|entry| *entry == side[0]));
            wrong += usize::from(padding == Padding::Clamp && !is_flat);
        }
    }
    Ok(Verdict::exactly("again and again, each entry's gradient its count", wrong))
}
