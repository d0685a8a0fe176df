//! Distances along the view axis at fragments.
//!
//! # Forward and backward
//! `w = sum_i b_i w_i` with the perspective-correct weights `b_i = a_i / sum_j a_j`: 1 / w is linear over
//! the image. That is a quotient of two functions that are linear over the image, `face_quotients` with
//! `n = w` and `m = 1`. It is computed of edge functions, and not of the barycentrics that were
//! rounded: where one vertex is much farther away than the others, its weight is what is left of 1. w is
//! linear over the face, so that for a piece of a boundary pixel, whose weights are means, it is the
//! mean.
//!
//! # Where it is not smooth
//! Where the visible face changes.
//!
//! # Source
//! Olano and Greer, *Triangle scan conversion using 2D homogeneous coordinates*, Graphics Hardware
//! 1997.

use bokashi_core::{Scalar, Var};

use crate::background::Background;
use crate::depth_image::DepthImage;
use crate::error::RenderError;
use crate::face_quotients::{Quotient, quotients};
use crate::fragments::Fragments;
use crate::homogeneous::Vertex;
use crate::picture::Composite;

const NAME: &str = "eye_depth";

/// Each fragment's distance along the view axis, differentiable with respect to the clip positions that
/// were rasterized. A piece of exact coverage has its mean distance.
///
/// It is the w of clip space, which is the distance, in units of the scene, for the matrices of
/// [`pinhole`](crate::pinhole()) and [`perspective`](crate::camera::perspective). An orthographic camera
/// has w = 1 everywhere. There interpolate the z of the vertices in camera coordinates instead, and make
/// a [`DepthImage::from_distances`].
///
/// # Errors
/// [`RenderError::Shape`] for fragments that are not whole; `TensorError::ForeignVariable` for
/// fragments of several tapes.
#[inline(never)]
pub fn eye_depth<'t, T: Scalar>(
    fragments: &Fragments<'t, T>,
) -> Result<EyeDepth<'t, T>, RenderError> {
    Ok(EyeDepth { values: quotients::<T, Distance>(fragments)? })
}

/// Distances along the view axis at fragments: what [`eye_depth`] gives.
#[derive(Debug, Clone, Copy)]
pub struct EyeDepth<'t, T: Scalar> {
    values: Var<'t, T>,
}

impl<'t, T: Scalar> EyeDepth<'t, T> {
    /// A distance for each fragment, `[N]`, differentiable.
    pub fn values(self) -> Var<'t, T> {
        self.values
    }

    /// The image of the distances, `[H, W]`, before a background that is `far` away. A boundary pixel of
    /// exact coverage has the mean of what is seen in it, the background among it. Silhouettes of
    /// fragments at pixel centres are steps.
    ///
    /// # Errors
    /// - `TensorError::Value` unless `far` is positive, and with exact coverage finite.
    /// - [`RenderError::Shape`] for other fragments than the distances are of, and for fragments that are
    ///   not whole; `TensorError::ForeignVariable` for fragments of another tape.
    pub fn image(
        self,
        fragments: &Fragments<'t, T>,
        far: f64,
    ) -> Result<DepthImage<'t, T>, RenderError> {
        let rule = match fragments.weight {
            None => "a background at a distance above 0",
            Some(_) => "a background at a finite distance above 0",
        };
        let is_finite = T::from_f64(far).is_finite() || fragments.weight.is_none();
        if far.is_nan() || T::from_f64(far) <= T::ZERO || !is_finite {
            return Err(RenderError::value(NAME, rule, far));
        }
        let far = self.values.tape().constant_full([1], T::from_f64(far));
        let rows = self.values.reshape([self.values.shape().size(), 1])?;
        let picture = Composite::from_values(rows, fragments, Background::Color(far))?;
        let size = picture.size();
        Ok(DepthImage::from_distances(picture.image()?.reshape([size.height, size.width])?))
    }
}

struct Distance;

impl Quotient for Distance {
    const NAME: &'static str = NAME;

    /// A vertex that was multiplied has weights that were divided.
    #[inline(always)]
    fn terms<S: Scalar>(vertex: &Vertex<S>, factor: S) -> [S; 2] {
        [vertex.w, factor]
    }

    #[inline(always)]
    fn pull_back<S: Scalar>([n_bar, _]: [S; 2]) -> [S; 2] {
        [S::ZERO, n_bar]
    }

    /// What rasterization lets through lies before the eye.
    #[inline(always)]
    fn within_range<S: Scalar>(quotient: S) -> S {
        quotient.maximum_or_nan(S::ZERO)
    }
}
