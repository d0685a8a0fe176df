//! Numbers of extreme cases: leaves that are made of them, and how far they are from others.

use bokashi_core::{Scalar, Tape, Tensor, Var};

use crate::extreme::Failure;

/// Numbers of which no two are alike.
pub(crate) fn motley(k: usize) -> f64 {
    ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.4
}

/// Half the distance between neighbouring numbers at 1: 2^-24 in `f32`.
pub(crate) fn rounding<T: Scalar>() -> f64 {
    let small = T::ONE + T::from_f64(f64::powi(2.0, -40)) == T::ONE;
    f64::powi(2.0, if small { -24 } else { -53 })
}

/// The largest of some numbers by size, and NaN where one is.
pub(crate) fn largest(numbers: impl IntoIterator<Item = f64>) -> f64 {
    numbers.into_iter().fold(0.0, |largest, number| number.abs().maximum_or_nan(largest))
}

/// The largest difference between two lists.
pub(crate) fn difference(found: &[f64], expected: &[f64]) -> f64 {
    if found.len() != expected.len() {
        return f64::INFINITY;
    }
    largest(found.iter().zip(expected).map(|(found, expected)| found - expected))
}

/// The entries in `f64`.
pub(crate) fn numbers<T: Scalar>(tensor: &Tensor<T>) -> Vec<f64> {
    tensor.data().iter().map(|entry| entry.to_f64()).collect()
}

/// Whether all numbers of all lists are finite.
pub(crate) fn is_finite(lists: &[Vec<f64>]) -> bool {
    lists.iter().flatten().all(|entry| entry.is_finite())
}

/// A tensor of these numbers.
pub(crate) fn tensor<T: Scalar>(shape: &[usize], entry: impl Fn(usize) -> f64) -> Tensor<T> {
    Tensor::from_flat_fn(shape, |k| T::from_f64(entry(k)))
}

pub(crate) fn leaf<'t, T: Scalar>(
    tape: &'t Tape<T>,
    shape: &[usize],
    entries: &[f64],
) -> Var<'t, T> {
    tape.leaf(&tensor(shape, |k| entries[k]))
}

/// A leaf of motley numbers.
pub(crate) fn motley_leaf<'t, T: Scalar>(tape: &'t Tape<T>, shape: &[usize]) -> Var<'t, T> {
    tape.leaf(&tensor(shape, motley))
}

pub(crate) fn vector<T: Scalar>(tape: &Tape<T>, entries: impl AsRef<[f64]>) -> Var<'_, T> {
    let entries = entries.as_ref();
    leaf(tape, &[entries.len()], entries)
}

pub(crate) fn number<T: Scalar>(tape: &Tape<T>, entry: f64) -> Var<'_, T> {
    tape.leaf_scalar(T::from_f64(entry))
}

/// Rows of `K` entries.
pub(crate) fn rows<'t, T: Scalar, const K: usize>(
    tape: &'t Tape<T>,
    rows: &[[f64; K]],
) -> Var<'t, T> {
    leaf(tape, &[rows.len(), K], rows.as_flattened())
}

/// `out`, and then the gradients of these leaves, for a motley gradient of `out`.
pub(crate) fn values_and_gradients<'t, T: Scalar>(
    out: Var<'t, T>,
    leaves: &[Var<'t, T>],
) -> Result<Vec<Vec<f64>>, Failure> {
    let upstream = tensor(&out.shape(), |k| motley(5 * k + 2));
    let gradients = out.tape().vjp(&[(out, &upstream)])?;
    let bars = leaves.iter().map(|&leaf| numbers(&gradients.get_or_zeros(leaf)));
    Ok(std::iter::once(numbers(&out.value())).chain(bars).collect())
}

/// Whether a motley gradient of `out` gives finite gradients of `leaves`.
pub(crate) fn has_finite_gradients<'t, T: Scalar>(
    out: Var<'t, T>,
    leaves: &[Var<'t, T>],
) -> Result<bool, Failure> {
    Ok(is_finite(&values_and_gradients(out, leaves)?[1..]))
}

/// A loss, and its gradients by these variables, one after the other.
pub(crate) fn loss_and_gradients<T: Scalar>(
    loss: Var<'_, T>,
    by: &[Var<'_, T>],
) -> Result<(f64, Vec<f64>), Failure> {
    let gradients = loss.backward()?;
    let all = by.iter().flat_map(|&x| numbers(&gradients.get_or_zeros(x)));
    Ok((loss.item().to_f64(), all.collect()))
}
