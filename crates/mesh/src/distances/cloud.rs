//! Points of a tensor in `f64`, scaled so that no square of a distance leaves the range of the numbers.

use bokashi_core::{Scalar, Tensor, TensorError};
use bokashi_render_ops::Mesh;

/// Scaled points lie within this distance of the origin along each axis, or a power of two of it.
const FAR: f64 = (1_u128 << 100) as f64;

/// The rows of `tensor: [n, 3]`; `name` is their name in the plural.
///
/// # Errors
/// [`TensorError::Shape`] for another shape; [`TensorError::Value`] for a number that is not finite.
pub(super) fn points<T: Scalar>(
    tensor: &Tensor<T>,
    operation: &'static str,
    name: &'static str,
) -> Result<Vec<[f64; 3]>, TensorError> {
    if tensor.shape().len() != 2 || tensor.shape()[1] != 3 {
        let (rule, shape) = (format!("{name} of shape [n, 3]").into(), tensor.shape().clone());
        return Err(TensorError::Shape { operation, rule, shape });
    }
    let rows = tensor.data().as_chunks::<3>().0;
    let points: Vec<_> = rows.iter().map(|row| row.map(Scalar::to_f64)).collect();
    match points.iter().position(|point| !point.iter().all(|x| x.is_finite())) {
        None => Ok(points),
        Some(row) => {
            let rule = format!("finite numbers in row {row} of the {name}").into();
            let value = points[row].into_iter().find(|x| !x.is_finite()).unwrap_or_default();
            Err(TensorError::Value { operation, rule, value })
        }
    }
}

/// [`points`] of which there is at least one.
///
/// # Errors
/// As [`points`], and [`TensorError::Shape`] where there is none.
pub(super) fn some_points<T: Scalar>(
    tensor: &Tensor<T>,
    operation: &'static str,
    name: &'static str,
) -> Result<Vec<[f64; 3]>, TensorError> {
    let points = points(tensor, operation, name)?;
    if points.is_empty() {
        let rule = format!("{name} of shape [n, 3] with n from 1 up").into();
        return Err(TensorError::Shape { operation, rule, shape: tensor.shape().clone() });
    }
    Ok(points)
}

/// The positions of a mesh's vertices.
///
/// # Errors
/// As [`points`], and [`TensorError::Shape`] unless there are as many as the mesh has vertices.
pub(super) fn vertices<T: Scalar>(
    tensor: &Tensor<T>,
    mesh: &Mesh,
    operation: &'static str,
) -> Result<Vec<[f64; 3]>, TensorError> {
    let count = mesh.vertex_count();
    if **tensor.shape() != [count, 3] {
        let (rule, shape) =
            (format!("positions of shape [{count}, 3]").into(), tensor.shape().clone());
        return Err(TensorError::Shape { operation, rule, shape });
    }
    points(tensor, operation, "positions")
}

/// A power of two by which points are scaled; most are not.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    exponent: i32,
}

impl Scale {
    /// Scales all points alike, so that the largest coordinate is near 1 where squares would leave the range.
    pub(super) fn balance<const N: usize>(mut clouds: [&mut [[f64; 3]]; N]) -> Self {
        let all = clouds.iter().flat_map(|cloud| cloud.as_flattened());
        let largest = all.fold(0.0_f64, |largest, x| largest.max(x.abs()));
        if largest == 0.0 || (1.0 / FAR..=FAR).contains(&largest) {
            return Self { exponent: 0 };
        }
        let scale = Self { exponent: -largest.log2() as i32 };
        for cloud in &mut clouds {
            cloud.as_flattened_mut().iter_mut().for_each(|x| *x = scaled(*x, scale.exponent));
        }
        scale
    }

    /// A length of scaled points, as it was.
    pub(super) fn length(self, scaled_length: f64) -> f64 {
        scaled(scaled_length, -self.exponent)
    }
}

/// `x` times a power of two, which may lie beyond the range of the numbers.
fn scaled(x: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    x * 2.0_f64.powi(half) * 2.0_f64.powi(exponent - half)
}

pub(super) fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    let entry = |i: usize, j: usize| a[i] * b[j] - a[j] * b[i];
    [entry(1, 2), entry(2, 0), entry(0, 1)]
}
