//! Points by an affine matrix: from world to camera, say.
//!
//! # Forward
//! `y_i = A p_i + b`, with the matrix `[A b; 0 1]`.
//!
//! # Backward
//! `p_bar_i = A^T y_bar_i`; `A_bar = sum_i y_bar_i p_i^T`, `b_bar = sum_i y_bar_i`. The last row is no
//! variable: its gradient is 0. It is smooth everywhere.

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::error::RenderError;
use crate::matrix;
use crate::point_map::{add_points_bar, map_points, moments};

const NAME: &str = "transform_points";

/// `points: [V, 3]` by `matrix: [4, 4]`, an affine map whose last row is (0, 0, 0, 1): `[V, 3]`. A view takes
/// points from world to camera coordinates. Both inputs have a gradient.
///
/// # Errors
/// - [`RenderError::Shape`] unless the points are `[V, 3]` and the matrix `[4, 4]`.
/// - [`RenderError::Camera`] for an entry of the matrix that is not finite.
/// - `TensorError::Value` for another last row: [`project`](crate::project()) takes such matrices.
/// - `TensorError::ForeignVariable` for variables of two tapes.
#[inline(never)]
pub fn transform_points<'t, T: Scalar>(
    points: Var<'t, T>,
    matrix: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    points.tape().apply(TransformPoints, &[points, matrix])
}

/// Inputs: points `[V, 3]`, a matrix `[4, 4]`. Output: points `[V, 3]`.
struct TransformPoints;

/// The rows `[A b]` of a matrix.
fn first_rows<T: Scalar>(entries: &[T]) -> [[T::Wide; 4]; 3] {
    let [x, y, z, _] = matrix::from_entries(entries);
    [x, y, z]
}

impl<T: Scalar> Op<T> for TransformPoints {
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
        if !matches!(**inputs.shape(0), [_, 3]) {
            return Err(RenderError::shape(NAME, "points of shape [V, 3]", inputs.shape(0)));
        }
        if **inputs.shape(1) != [4, 4] {
            return Err(RenderError::shape(NAME, "a matrix of shape [4, 4]", inputs.shape(1)));
        }
        matrix::check_finite(inputs.data(1))?;
        matrix::check_affine(NAME, inputs.data(1))?;
        let out = outputs.push(inputs.shape(0));
        map_points(&first_rows(inputs.data(1)), inputs.data(0), out);
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(1, inputs.needs(0)).input_if(0, inputs.needs(1))
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let bars = kept.only_upstream();
        if let Some(points_bar) = gradients.get(0) {
            add_points_bar(&first_rows(kept.input(1)), bars, points_bar);
        }
        if let Some(matrix_bar) = gradients.get(1) {
            let sums = moments::<T, 3>(kept.input(0), bars);
            matrix_bar.add_each(|k| sums.get(k / 4).map_or(T::ZERO, |row| T::narrow(row[k % 4])));
        }
    }
}
