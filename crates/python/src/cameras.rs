//! Cameras and poses on the tape.

use bokashi_render_ops::{self as ops, Size};
use ops::glam::{DMat4, DVec4};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smallvec::smallvec;

use crate::array::{Array, by_type};
use crate::step::{Recorded, record};

/// A matrix `[4, 4]` that stays as it is.
fn matrix(array: &Array<'_>) -> PyResult<DMat4> {
    let (shape, entries) = array.constant()?;
    if shape != [4, 4] {
        return Err(PyValueError::new_err(format!("a matrix needs shape [4, 4], got {shape:?}")));
    }
    let row = |k: usize| DVec4::from_slice(&entries[4 * k..]);
    Ok(DMat4::from_cols(row(0), row(1), row(2), row(3)).transpose())
}

#[pyfunction]
pub fn se3<'py>(py: Python<'py>, increment: Array<'py>, fixed: Array<'py>) -> Recorded<'py> {
    let fixed = matrix(&fixed)?;
    // The pull-back has no gradient for the second.
    let inputs = [Some(&increment), None];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(increment), None] = x[..] else { unreachable!("it is required") };
        Ok(smallvec![ops::se3(increment, &fixed)?])
    }))
}

/// Projections of intrinsics.
macro_rules! projections {
    ($($name:ident)+) => {$(
        #[pyfunction]
        pub fn $name<'py>(
            py: Python<'py>,
            intrinsics: Array<'py>,
            height: usize,
            width: usize,
            near: f64,
            far: f64,
        ) -> Recorded<'py> {
            let inputs = [Some(&intrinsics)];
            by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
                let [Some(intrinsics)] = x[..] else { unreachable!("they are required") };
                Ok(smallvec![ops::$name(intrinsics, Size { width, height }, near, far)?])
            }))
        }
    )+};
}

projections! { pinhole orthographic }
