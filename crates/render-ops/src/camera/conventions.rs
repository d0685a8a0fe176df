//! From one convention of camera coordinates to the other, and from matrices to tensors.
//!
//! OpenGL: x right, y up, z backward. OpenCV: x right, y down, z forward. Either becomes the other by
//! turning y and z round, `F = diag(1, -1, -1, 1)`. A *view* maps world to camera coordinates and turns
//! to `F view`; a camera's *pose* maps camera to world coordinates and turns to `pose F`. Both are
//! exact.

use bokashi_core::{Scalar, Tensor};
use glam::DMat4;

use crate::error::RenderError;

/// A view of OpenGL's convention, world to camera, as a view of OpenCV's.
///
/// ```
/// use bokashi_render_ops::camera::{look_at, opengl_to_opencv_view};
/// use bokashi_render_ops::glam::DVec3;
///
/// let view = look_at(DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y);
/// let point = DVec3::new(1.0, 2.0, 0.0);
/// assert_eq!(view.transform_point3(point), DVec3::new(1.0, 2.0, -4.0));
/// let view = opengl_to_opencv_view(view);
/// assert_eq!(view.transform_point3(point), DVec3::new(1.0, -2.0, 4.0));
/// ```
pub fn opengl_to_opencv_view(view: DMat4) -> DMat4 {
    turned_rows(view)
}

/// A view of OpenCV's convention, world to camera, as a view of OpenGL's.
pub fn opencv_to_opengl_view(view: DMat4) -> DMat4 {
    turned_rows(view)
}

/// A camera's pose of OpenGL's convention, camera to world, as a pose of OpenCV's.
pub fn opengl_to_opencv_pose(pose: DMat4) -> DMat4 {
    turned_columns(pose)
}

/// A camera's pose of OpenCV's convention, camera to world, as a pose of OpenGL's.
pub fn opencv_to_opengl_pose(pose: DMat4) -> DMat4 {
    turned_columns(pose)
}

fn turned_columns(mut matrix: DMat4) -> DMat4 {
    matrix.y_axis = -matrix.y_axis;
    matrix.z_axis = -matrix.z_axis;
    matrix
}

fn turned_rows(matrix: DMat4) -> DMat4 {
    turned_columns(matrix.transpose()).transpose()
}

/// A matrix as a tensor `[4, 4]`, which is row-major.
pub fn to_tensor<T: Scalar>(matrix: &DMat4) -> Tensor<T> {
    let columns = matrix.to_cols_array_2d();
    Tensor::from_flat_fn([4, 4], |k| T::from_f64(columns[k % 4][k / 4]))
}

/// The matrix of a tensor `[4, 4]`.
///
/// # Errors
/// [`RenderError::Shape`] for a tensor of another shape.
pub fn from_tensor<T: Scalar>(tensor: &Tensor<T>) -> Result<DMat4, RenderError> {
    if **tensor.shape() != [4, 4] {
        let rule = "a tensor of shape [4, 4]";
        return Err(RenderError::shape("a matrix", rule, tensor.shape()));
    }
    let entry = |k: usize| tensor.data()[k].to_f64();
    Ok(DMat4::from_cols_array(&std::array::from_fn(|k| entry(k % 4 * 4 + k / 4))))
}
