//! The projection of a pinhole camera, from intrinsics in pixels.
//!
//! # Forward and backward
//! `screen` has x, y and w = Z. `z_clip = (f + n) / (f - n) Z - 2 f n / (f - n)`, which is -w on the near
//! plane at Z = n and w on the far plane at Z = f. It is linear in the intrinsics.
//!
//! # Source
//! Hartley and Zisserman, *Multiple View Geometry in Computer Vision*, 2nd edition, 2004, section 6.1;
//! the pixels of OpenCV's module `calib3d`.

use bokashi_core::{Scalar, Var};

use super::screen::Screen;
use crate::error::RenderError;
use crate::size::Size;

const NAME: &str = "pinhole";

/// The matrix `[4, 4]` from OpenCV's camera coordinates (x right, y down, z forward) to clip space, of
/// `intrinsics: [4]` = (fx, fy, cx, cy) in pixels for an image of `size`. [`project`](crate::project())
/// takes its product with a view of OpenCV's convention.
///
/// The principal point (cx, cy) is as OpenCV has it: the *centre* of the first pixel is (0, 0), so that
/// the middle of the image is ((W - 1) / 2, (H - 1) / 2). Where (0, 0) is the corner of the image, as
/// in COLMAP, take 1/2 off cx and cy.
///
/// `near` and `far` are distances along the view axis; `far` may be infinite. The intrinsics have a
/// gradient. A negative focal length mirrors the image.
///
/// # Errors
/// - [`RenderError::Shape`] unless the intrinsics are `[4]`; [`RenderError::ImageSize`] for an image
///   without pixels.
/// - `TensorError::Value` unless both focal lengths are finite and not 0, the principal point is finite,
///   and 0 < near < far.
/// - [`RenderError::Camera`] where an entry of the matrix leaves the range of the numbers.
#[inline(never)]
pub fn pinhole<'t, T: Scalar>(
    intrinsics: Var<'t, T>,
    size: Size,
    near: f64,
    far: f64,
) -> Result<Var<'t, T>, RenderError> {
    let size = size.checked()?;
    // In the tape's precision: what is 0 there has no reciprocal there.
    let rounded = T::from_f64(near).to_f64();
    if !(rounded > 0.0 && rounded.is_finite()) {
        let rule = "a near plane at a finite distance above 0";
        return Err(RenderError::value(NAME, rule, rounded));
    }
    if far.partial_cmp(&near) != Some(std::cmp::Ordering::Greater) {
        let rule = format!("a far plane beyond the near plane at {near}");
        return Err(RenderError::value(NAME, rule, far));
    }
    let ratio = near / far;
    let depth = [(1.0 + ratio) / (1.0 - ratio), -2.0 * near / (1.0 - ratio)];
    let rules = ["a finite focal length other than 0", "a finite principal point"];
    let op = Screen { operation: NAME, rules, size, column: 2, depth };
    intrinsics.tape().apply(op, &[intrinsics])
}
