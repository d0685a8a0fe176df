//! Points as a lens of polynomials shows them.
//!
//! # Forward
//! `(X, Y, Z)` becomes `(x'' Z, y'' Z, Z)`: see `distortion`.
//!
//! # Backward
//! See `bend`, with the slopes of `distortion`.
//!
//! # Where it is not smooth, and source
//! See `distortion`.

use bokashi_core::{Scalar, Var};

use super::bend::{Bend, LensKind};
use super::distortion::Distortion;
use crate::error::RenderError;

/// `points: [V, 3]` in OpenCV's camera coordinates as a lens shows them: `[V, 3]`, (x'' Z, y'' Z, Z) with
/// the distorted normalized coordinates. A [`pinhole`](crate::pinhole()) then takes them to clip space.
///
/// `coefficients` are OpenCV's, in its order: `[5]`, (k1, k2, p1, p2, k3), or `[8]`, (k1, k2, p1, p2, k3, k4,
/// k5, k6). Both inputs have a gradient. Edges stay straight: a mesh needs faces small enough to bend.
///
/// The formula holds up to the radius where it would bring points back into the image
/// ([`distortion_radius`](crate::camera::distortion_radius)). From there on the map goes on linearly along
/// each ray from the centre, also behind the camera, so that points outside the image stay outside.
///
/// Coefficients of 0 that have no gradient are the identity: the points themselves are returned.
///
/// # Errors
/// [`RenderError::Shape`] unless the points are `[V, 3]` and the coefficients `[5]` or `[8]`;
/// `TensorError::Value` for a coefficient that is not finite, or beyond 1e100;
/// `TensorError::ForeignVariable` for variables of two tapes.
#[inline(never)]
pub fn distort<'t, T: Scalar>(
    points: Var<'t, T>,
    coefficients: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    match *coefficients.shape() {
        [8] => points.tape().apply(Bend::<_, 8>(Polynomials), &[points, coefficients]),
        _ => points.tape().apply(Bend::<_, 5>(Polynomials), &[points, coefficients]),
    }
}

/// A lens of polynomials.
#[derive(Debug, Clone, Copy)]
struct Polynomials;

impl LensKind<5> for Polynomials {
    const NAME: &'static str = "distort";
    const RULE: &'static str = "coefficients of shape [5] or [8]";
    const HAS_IDENTITY: bool = true;
    type Lens<S: Scalar> = Distortion<S>;
}

impl LensKind<8> for Polynomials {
    const NAME: &'static str = "distort";
    const RULE: &'static str = "coefficients of shape [5] or [8]";
    const HAS_IDENTITY: bool = true;
    type Lens<S: Scalar> = Distortion<S>;
}
