//! The matrix from world to clip space, which [`project`](crate::project()) and
//! [`project_instances`](crate::project_instances()) multiply by.

use bokashi_core::{Scalar, Var};
use glam::DMat4;

use crate::error::RenderError;
use crate::matrix::Matrix4;

/// A camera: the matrix that maps world to OpenGL clip space, a projection times a view.
///
/// A `&DMat4` converts into a fixed camera, a variable of shape `[4, 4]` into a learnable one. A tensor
/// is row-major and glam's matrices are column-major:
/// [`camera::to_tensor`](crate::camera::to_tensor) transposes.
#[derive(Debug, Clone, Copy)]
pub enum Camera<'t, T: Scalar> {
    /// A matrix without a gradient, in `f64` on any tape.
    Fixed(DMat4),
    /// A matrix on the tape, row-major. Shape `[4, 4]`.
    Variable(Var<'t, T>),
}

impl<T: Scalar> From<&DMat4> for Camera<'_, T> {
    fn from(matrix: &DMat4) -> Self {
        Self::Fixed(*matrix)
    }
}

impl<'t, T: Scalar> From<Var<'t, T>> for Camera<'t, T> {
    fn from(matrix: Var<'t, T>) -> Self {
        Self::Variable(matrix)
    }
}

impl<'t, T: Scalar> Camera<'t, T> {
    /// The rows of a fixed matrix; `None` for a variable.
    ///
    /// # Errors
    /// [`RenderError::Camera`] for an entry that is not finite.
    pub(crate) fn fixed<S: Scalar>(self) -> Result<Option<Matrix4<S>>, RenderError> {
        match self {
            Self::Fixed(matrix) => rows(&matrix).map(Some),
            Self::Variable(_) => Ok(None),
        }
    }

    /// The variable; `None` for a fixed matrix.
    pub(crate) fn variable(self) -> Option<Var<'t, T>> {
        match self {
            Self::Fixed(_) => None,
            Self::Variable(matrix) => Some(matrix),
        }
    }
}

/// The rule of a camera's shape.
pub(crate) const CAMERA_RULE: &str = "a camera matrix of shape [4, 4]";

/// The rows of a fixed matrix.
///
/// # Errors
/// [`RenderError::Camera`] for an entry that is not finite.
pub(crate) fn rows<S: Scalar>(matrix: &DMat4) -> Result<Matrix4<S>, RenderError> {
    let columns = matrix.to_cols_array_2d();
    for (column, entries) in columns.iter().enumerate() {
        if let Some(row) = entries.iter().position(|entry| !entry.is_finite()) {
            return Err(RenderError::Camera { row, column, value: entries[row] });
        }
    }
    Ok(std::array::from_fn(|row| std::array::from_fn(|k| S::from_f64(columns[k][row]))))
}
