//! Images of distances, told apart from other images by type.

use bokashi_core::{Scalar, Var};

/// A distance for each pixel, `[H, W]`: along the view axis, from 0 at the eye to infinity, in units of
/// the scene. It is no image of [`depth`](crate::depth()), which is z / w.
///
/// [`EyeDepth::image`](crate::EyeDepth::image) makes it of what was rasterized,
/// [`DepthImage::from_distances`] of anything else.
#[derive(Debug, Clone, Copy)]
pub struct DepthImage<'t, T: Scalar>(Var<'t, T>);

impl<'t, T: Scalar> DepthImage<'t, T> {
    /// Of distances `[H, W]` that come from elsewhere: a sensor, or an orthographic camera, whose w is no
    /// distance. Who takes the image checks shape and numbers.
    pub fn from_distances(distances: Var<'t, T>) -> Self {
        Self(distances)
    }

    /// The distances, `[H, W]`, differentiable.
    pub fn distances(self) -> Var<'t, T> {
        self.0
    }
}
