//! The projection of an orthographic camera, from a scale and a centre in pixels.
//!
//! # Forward and backward
//! `screen` has x, y and w = 1. `z_clip = 2 Z / (f - n) - (f + n) / (f - n)`, -1 on the near plane at
//! Z = n and 1 on the far plane at Z = f. It is linear in the intrinsics.
//!
//! # Source
//! Hartley and Zisserman, *Multiple View Geometry in Computer Vision*, 2nd edition, 2004, section 6.3.

use bokashi_core::{Scalar, Var};

use super::screen::Screen;
use crate::error::RenderError;
use crate::size::Size;

const NAME: &str = "orthographic";

/// The matrix `[4, 4]` from OpenCV's camera coordinates (x right, y down, z forward) to clip space, of
/// `intrinsics: [4]` = (sx, sy, cx, cy): pixels per unit along x and y, and the pixel that the view axis
/// meets, for an image of `size`.
///
/// The centre (cx, cy) is as OpenCV has it: the *centre* of the first pixel is (0, 0). `near` and `far`
/// are positions on the view axis, and may lie behind the camera. The intrinsics have a gradient. A
/// negative scale mirrors the image. Since w is 1, [`eye_depth`](crate::eye_depth()) does not give
/// distances.
///
/// # Errors
/// - [`RenderError::Shape`] unless the intrinsics are `[4]`; [`RenderError::ImageSize`] for an image
///   without pixels.
/// - `TensorError::Value` unless both scales are finite and not 0, the centre is finite, and near < far
///   are finite.
/// - [`RenderError::Camera`] where an entry of the matrix leaves the range of the numbers.
#[inline(never)]
pub fn orthographic<'t, T: Scalar>(
    intrinsics: Var<'t, T>,
    size: Size,
    near: f64,
    far: f64,
) -> Result<Var<'t, T>, RenderError> {
    let size = size.checked()?;
    if !near.is_finite() {
        return Err(RenderError::value(NAME, "a finite near plane", near));
    }
    if !(far > near && far.is_finite()) {
        let rule = format!("a finite far plane beyond the near plane at {near}");
        return Err(RenderError::value(NAME, rule, far));
    }
    // Halved first: the difference of two numbers may be too large.
    let half = 0.5 * far - 0.5 * near;
    let depth = [1.0 / half, -(0.5 * far + 0.5 * near) / half];
    let rules = ["a finite scale other than 0", "a finite centre"];
    let op = Screen { operation: NAME, rules, size, column: 3, depth };
    intrinsics.tape().apply(op, &[intrinsics])
}
