//! The inverse of an affine matrix: from camera to world becomes from world to camera.
//!
//! # Forward
//! `[A b; 0 1]^-1 = [B -B b; 0 1]` with `B = A^-1`, by cofactors. For a rotation A it is `A^T`, up to
//! rounding.
//!
//! # Backward
//! With the result `[B c; 0 1]`: `A_bar = -B^T (B_bar B^T + c_bar c^T)`, `b_bar = -B^T c_bar`. The last row
//! is no variable: its gradient is 0. It is smooth wherever it is defined.

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::error::RenderError;
use crate::matrix;
use crate::rotation::Matrix3;

const NAME: &str = "affine_inverse";

/// The inverse `[4, 4]` of `matrix: [4, 4]`, a rigid motion or any other affine map, whose last row is
/// (0, 0, 0, 1). That of a camera's pose, camera to world, is its view, world to camera.
///
/// # Errors
/// - [`RenderError::Shape`] unless the matrix is `[4, 4]`; [`RenderError::Camera`] for an entry that is not
///   finite, or an inverse with such an entry.
/// - `TensorError::Value` for another last row, and for a linear part whose determinant is 0 within
///   rounding.
#[inline(never)]
pub fn affine_inverse<'t, T: Scalar>(matrix: Var<'t, T>) -> Result<Var<'t, T>, RenderError> {
    matrix.tape().apply(AffineInverse, &[matrix])
}

/// Input: a matrix `[4, 4]`. Output: another.
struct AffineInverse;

/// The inverse of a matrix.
///
/// # Errors
/// The determinant, where it is 0 within rounding; of the matrix times a power of two.
fn inverse<S: Scalar>(a: Matrix3<S>) -> Result<Matrix3<S>, f64> {
    // Times a power of two, so that no product leaves the range of the numbers.
    let largest = a.iter().flatten().map(|entry| entry.to_f64().abs()).fold(0.0, f64::max);
    if largest == 0.0 {
        return Err(0.0);
    }
    let factor = S::from_f64(f64::powi(2.0, -(largest.log2() as i32).clamp(-1000, 1000)));
    let a = a.map(|row| row.map(|entry| factor * entry));
    let product = |i: [usize; 2], j: [usize; 2]| a[i[0]][i[1]] * a[j[0]][j[1]];
    let next = |k: usize| [(k + 1) % 3, (k + 2) % 3];
    // The cofactors, and how large their terms are.
    let terms = |i: usize, j: usize| {
        let ([i1, i2], [j1, j2]) = (next(i), next(j));
        [product([i1, j1], [i2, j2]), product([i1, j2], [i2, j1])]
    };
    let cofactors: Matrix3<S> = std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let [one, other] = terms(i, j);
            one - other
        })
    });
    let determinant: S = (0..3).map(|j| a[0][j] * cofactors[0][j]).sum();
    let size: f64 =
        (0..3).flat_map(|j| terms(0, j).map(|term| (term * a[0][j]).to_f64().abs())).sum();
    if determinant.to_f64().abs() <= 8.0 * f64::EPSILON * size {
        return Err(determinant.to_f64());
    }
    Ok(std::array::from_fn(|i| std::array::from_fn(|j| factor * (cofactors[j][i] / determinant))))
}

impl<T: Scalar> Op<T> for AffineInverse {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        if **inputs.shape(0) != [4, 4] {
            let rule = "a matrix of shape [4, 4]";
            return Err(RenderError::shape(NAME, rule, inputs.shape(0)));
        }
        matrix::check_finite(inputs.data(0))?;
        matrix::check_affine(NAME, inputs.data(0))?;
        let m = matrix::from_entries(inputs.data(0));
        let linear = std::array::from_fn(|i| std::array::from_fn(|j| m[i][j]));
        let inverse: Matrix3<T::Wide> = inverse(linear).map_err(|determinant| {
            let rule = "a linear part whose determinant is not 0 within rounding";
            RenderError::value(NAME, rule, determinant)
        })?;
        let mut rows = m;
        for (row, b) in rows.iter_mut().zip(inverse) {
            let shift = b[0] * m[0][3] + b[1] * m[1][3] + b[2] * m[2][3];
            *row = [b[0], b[1], b[2], -shift];
        }
        let entries = outputs.push([4, 4]);
        matrix::write(&rows, entries);
        matrix::check_finite(entries)
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.output(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(matrix_bar) = gradients.get(0) else { return };
        let (n, n_bar) =
            (matrix::from_entries(kept.output(0)), matrix::from_entries(kept.only_upstream()));
        // [B_bar B^T + c_bar c^T, c_bar].
        let inner: [[T::Wide; 4]; 3] = std::array::from_fn(|i| {
            std::array::from_fn(|j| match j {
                3 => n_bar[i][3],
                j => (0..4).map(|k| n_bar[i][k] * n[j][k]).sum(),
            })
        });
        matrix_bar.add_each(|entry| match entry / 4 {
            3 => T::ZERO,
            row => {
                let sum: T::Wide = (0..3).map(|i| n[i][row] * inner[i][entry % 4]).sum();
                T::narrow(-sum)
            }
        });
    }
}
