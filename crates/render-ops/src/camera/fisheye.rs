//! Points as a fisheye shows them.
//!
//! # Forward
//! A point at the angle theta off the axis is shown at the radius `theta_d(theta)`: see `equidistant`.
//!
//! # Backward
//! See `bend`, with the slopes of `equidistant`.
//!
//! # Where it is not smooth, and source
//! See `equidistant`.

use bokashi_core::{Scalar, Var};

use super::bend::{Bend, LensKind};
use super::equidistant::Equidistant;
use crate::error::RenderError;

/// `points: [V, 3]` in OpenCV's camera coordinates as a fisheye shows them: `[V, 3]`, (x'' d, y'' d, d) with the
/// distorted normalized coordinates and the *distance* d from the eye. A [`pinhole`](crate::pinhole()) then
/// takes them to clip space, where depths, and the near and far planes, are distances from the eye.
///
/// `coefficients: [4]` are those of OpenCV's module `fisheye`, (k1, k2, k3, k4). With the angle theta off the axis
/// and `theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`, (x'', y'') has the length
/// theta_d. Both inputs have a gradient. Edges stay straight: a mesh needs faces small enough to bend.
///
/// The polynomial holds up to the angle where it would bring points back into the image, and up to 150 degrees
/// at most ([`fisheye_limit`](crate::camera::fisheye_limit)). That may lie behind the camera. From there on
/// points go outwards, as a pinhole shows those that approach the plane of the eye, and are seen no longer.
///
/// # Errors
/// [`RenderError::Shape`] unless the points are `[V, 3]` and the coefficients `[4]`;
/// `TensorError::Value` for a coefficient that is not finite, or beyond 1e100;
/// `TensorError::ForeignVariable` for variables of two tapes.
#[inline(never)]
pub fn fisheye<'t, T: Scalar>(
    points: Var<'t, T>,
    coefficients: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    points.tape().apply(Bend::<_, 4>(Angles), &[points, coefficients])
}

/// A lens that shows angles as radii.
#[derive(Debug, Clone, Copy)]
struct Angles;

impl LensKind<4> for Angles {
    const NAME: &'static str = "fisheye";
    const RULE: &'static str = "coefficients of shape [4]";
    const HAS_IDENTITY: bool = false;
    type Lens<S: Scalar> = Equidistant<S>;
}
