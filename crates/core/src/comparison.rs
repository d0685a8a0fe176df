//! The same pipeline in two precisions, value by value.
//!
//! A pipeline that is generic over its numbers is recorded on two tapes, a rough and an exact tape.
//! Their values are compared in the order of recording. A backward pass to every value
//! ([`Tape::variables`]) compares the gradients, too.
//!
//! The relative error of an array is `max_k |rough_k - exact_k| / max_k |exact_k|`.

use crate::backward::Gradients;
use crate::error::TensorError;
use crate::report::ValueError;
use crate::scalar::Scalar;
use crate::tape::{Inner, Tape};
use crate::tensor::Tensor;

/// The relative errors of the values on `rough`, against those on `exact`, in the order of
/// recording.
///
/// # Errors
/// [`TensorError::Recordings`] unless both tapes hold the values of the same operations.
pub fn value_errors<T: Scalar, U: Scalar>(
    rough: &Tape<T>,
    exact: &Tape<U>,
) -> Result<Vec<ValueError>, TensorError> {
    let (rough, exact) = (rough.inner.borrow(), exact.inner.borrow());
    let compare = |index| {
        let operation = same_operation(&rough, &exact, index)?;
        let (rough, exact) = (&rough.values[index], &exact.values[index]);
        let error = (rough.shape == exact.shape).then(|| {
            let (rough, exact) = (rough.data(), exact.data());
            relative_error(rough.len(), |k| rough[k].to_f64(), |k| exact[k].to_f64())
        });
        Ok(ValueError { index, operation, error })
    };
    (0..rough.live.max(exact.live)).map(compare).collect()
}

/// The relative errors of the gradients `rough`, against `exact`, of two passes to the same
/// variables, in the order of recording; a gradient that there is none of counts as zero.
///
/// # Errors
/// [`TensorError::Recordings`] unless both passes were asked for the same variables, and they are
/// of the same operations.
pub fn gradient_errors<T: Scalar, U: Scalar>(
    rough: &Gradients<'_, T>,
    exact: &Gradients<'_, U>,
) -> Result<Vec<ValueError>, TensorError> {
    let tapes = (rough.tape.inner.borrow(), exact.tape.inner.borrow());
    let (rough, exact) = (&rough.results, &exact.results);
    let compare = |k: usize| {
        let variables = [rough.get(k).map(|result| result.0), exact.get(k).map(|result| result.0)];
        let index = variables[0].or(variables[1]).unwrap_or_default() as usize;
        if variables[0] != variables[1] {
            let name =
                |variable: Option<u32>| if variable.is_some() { "a gradient" } else { "nothing" };
            return Err(TensorError::Recordings { value: index, operations: variables.map(name) });
        }
        let operation = same_operation(&tapes.0, &tapes.1, index)?;
        let (rough, exact) = (rough[k].1.as_ref(), exact[k].1.as_ref());
        let (rough_size, exact_size) = (rough.map(Tensor::size), exact.map(Tensor::size));
        let size = rough_size.or(exact_size).unwrap_or_default();
        let error = (size == exact_size.unwrap_or(size)).then(|| {
            let rough = |k: usize| rough.map_or(0.0, |rough| rough.data()[k].to_f64());
            let exact = |k: usize| exact.map_or(0.0, |exact| exact.data()[k].to_f64());
            relative_error(size, rough, exact)
        });
        Ok(ValueError { index, operation, error })
    };
    (0..rough.len().max(exact.len())).map(compare).collect()
}

/// The operation that computed value `index` on both tapes.
fn same_operation<T: Scalar, U: Scalar>(
    rough: &Inner<T>,
    exact: &Inner<U>,
    index: usize,
) -> Result<Option<&'static str>, TensorError> {
    match (rough.operation(index), exact.operation(index)) {
        (Some(rough), Some(exact)) if rough == exact => Ok(rough),
        (rough, exact) => {
            let name = |value: Option<Option<_>>| {
                value.map_or("nothing", |operation| operation.unwrap_or("a leaf"))
            };
            let operations = [name(rough), name(exact)];
            Err(TensorError::Recordings { value: index, operations })
        }
    }
}

/// `max_k |rough(k) - exact(k)| / max_k |exact(k)|` over `0..size`; infinite where only one of two
/// numbers is finite, or only one of the arrays is not zero everywhere.
fn relative_error(size: usize, rough: impl Fn(usize) -> f64, exact: impl Fn(usize) -> f64) -> f64 {
    let (mut error, mut scale) = (0.0_f64, 0.0_f64);
    for k in 0..size {
        let (rough, exact) = (rough(k), exact(k));
        let same = rough == exact || (rough.is_nan() && exact.is_nan());
        let difference = if same { 0.0 } else { (rough - exact).abs() };
        error = error.max(if difference.is_nan() { f64::INFINITY } else { difference });
        if exact.is_finite() {
            scale = scale.max(exact.abs());
        }
    }
    if error == 0.0 { 0.0 } else { error / scale }
}
