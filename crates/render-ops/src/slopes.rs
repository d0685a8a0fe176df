//! How distances change from pixel to pixel, and layers that know it.

use bokashi_core::{Scalar, Var};

use crate::differentials::differentials;
use crate::error::RenderError;
use crate::eye_depth::eye_depth;
use crate::fragments::Fragments;
use crate::interpolate_differentials::interpolate_differentials;
use crate::lens::LensLayer;

/// How each fragment's distance along the view axis changes from pixel to pixel, to the right and down: `[N, 2]`,
/// differentiable with respect to the clip positions that were rasterized.
///
/// # Errors
/// As [`eye_depth`].
pub fn eye_depth_slope<'t, T: Scalar>(
    fragments: &Fragments<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let w = fragments.clip.slice(1, 3..4)?;
    let slopes = interpolate_differentials(w, fragments, differentials(fragments)?)?;
    Ok(slopes.reshape([fragments.coverage.count(), 2])?)
}

impl<'a, 't, T: Scalar> LensLayer<'a, 't, T> {
    /// A layer at the distances of its fragments, and with their slopes, of colours times alpha and alphas.
    ///
    /// # Errors
    /// As [`eye_depth_slope`].
    pub fn from_fragments(
        fragments: &'a Fragments<'t, T>,
        premultiplied: Var<'t, T>,
        alpha: Var<'t, T>,
    ) -> Result<Self, RenderError> {
        let distance = eye_depth(fragments)?.values();
        let slope = Some(eye_depth_slope(fragments)?);
        Ok(Self { fragments, premultiplied, alpha, distance, slope })
    }
}
