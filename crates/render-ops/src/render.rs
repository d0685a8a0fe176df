//! A picture in one call.
//!
//! ```text
//! clip, mesh -> rasterize -> interpolate -> composite -> antialias, where it is asked for
//! ```
//!
//! [`render`] takes that way for colours at vertices. A shader stands between `rasterize` and
//! [`Fragments::picture`].

use bokashi_core::{Scalar, Var};

use crate::antialias::antialias;
use crate::background::Background;
use crate::composite::composite;
use crate::error::RenderError;
use crate::fragments::Fragments;
use crate::interpolate::interpolate_indexed;
use crate::mesh::Mesh;
use crate::picture::Picture;
use crate::raster_options::RasterOptions;
use crate::rasterize::rasterize;
use crate::vertex_attributes::VertexAttributes;

/// The picture of `mesh` with vertices `clip: [V, 4]` in clip space and `colors: [A, C]` at its vertices, before
/// `background`. Silhouettes look as the options say, and the creases of the colours are resolved with exact
/// ones.
///
/// # Errors
/// As [`rasterize`], [`interpolate_indexed`] and [`Fragments::picture`].
pub fn render<'a, 't, T: Scalar>(
    clip: Var<'t, T>,
    mesh: &Mesh,
    colors: impl Into<VertexAttributes<'a, 't, T>>,
    options: impl Into<RasterOptions>,
    background: Background<'t, T>,
) -> Result<Picture<'t, T>, RenderError> {
    let colors = colors.into();
    let fragments = rasterize(clip, mesh, options.into().creases(&[colors]))?;
    let surface = interpolate_indexed(colors.values, colors.indices.unwrap_or(mesh), &fragments)?;
    fragments.picture(surface, background)
}

impl<'t, T: Scalar> Fragments<'t, T> {
    /// The picture of fragments that look like `values: [N, C]`, before `background`: [`composite`], and
    /// [`antialias`] where the options of [`rasterize`] asked for it.
    ///
    /// # Errors
    /// As [`composite`].
    pub fn picture(
        &self,
        values: Var<'t, T>,
        background: Background<'t, T>,
    ) -> Result<Picture<'t, T>, RenderError> {
        let picture = composite(values, self, background)?;
        if self.coverage.antialias { antialias(picture) } else { Ok(picture.into()) }
    }
}
