//! Rasterization of triangles to fragments.
//!
//! # Forward
//! At the centre of each pixel, of all faces that cover it the nearest one (see `setup` for the
//! coverage, `visibility` for the search). With the edge functions `a_i = q_j x q_k` of its vertices
//! relative to the pixel centre: `u = a_0 / A`, `v = a_1 / A`, `A = a_0 + a_1 + a_2` are
//! perspective-correct. In [`Scalar::Wide`].
//!
//! # Backward
//! With `m = u_bar u + v_bar v`: `a_bar_0 = (u_bar - m) / A`, `a_bar_1 = (v_bar - m) / A`,
//! `a_bar_2 = -m / A`; from there to the vertices as in `edge_functions`. The gradients grow as 1
//! over the scale of the positions: terms beyond the range of the numbers make an entry infinite,
//! with the sign of the first of them, and not NaN.
//!
//! # Where it is not smooth
//! Which face a pixel sees is a step function of the vertices: its derivative is zero almost
//! everywhere and not defined where a silhouette or an intersection crosses the pixel centre.
//! [`antialias`](crate::antialias()) makes up for silhouettes.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020; coverage as in `homogeneous`.

mod canvas;
mod culling;
mod pull_back;
mod setup;
#[cfg(test)]
mod tests;
mod visibility;

use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use self::pull_back::PullBack;
use self::visibility::Visibility;
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::face_sums::Layout;
use crate::fragments::Fragments;
use crate::mesh::Mesh;
use crate::size::Size;

/// Which faces are left out by the side that they show. The front is the side from which the
/// vertices run counter-clockwise on the screen, y up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Cull {
    /// Both sides are drawn.
    #[default]
    None,
    /// Faces seen from the back are not drawn: for closed opaque meshes with the front outside,
    /// whose pictures it does not change.
    Back,
    /// Faces seen from the front are not drawn.
    Front,
}

/// How to rasterize.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RasterOptions {
    /// The image's size in pixels.
    pub size: Size,
    /// Which faces are left out by the side that they show.
    pub cull: Cull,
}

impl From<Size> for RasterOptions {
    fn from(size: Size) -> Self {
        Self { size, cull: Cull::None }
    }
}

/// The fragments of `mesh` with vertices `clip: [V, 4]` in clip space: one for each pixel whose
/// centre some face covers.
///
/// Smaller z / w wins; of equal ones the lower face index. Faces may reach behind the eye and
/// through the near and far planes: the visible part is drawn. Faces whose area is zero within
/// rounding are not drawn and are counted in [`Coverage::culled`].
///
/// # Errors
/// [`RenderError::ImageSize`] for an image without pixels; [`RenderError::Shape`] unless `clip` is
/// `[V, 4]` with the mesh's number of vertices; [`RenderError::Position`] for a coordinate that is
/// not finite.
pub fn rasterize<'t, T: Scalar>(
    clip: Var<'t, T>,
    mesh: &Mesh,
    options: impl Into<RasterOptions>,
) -> Result<Fragments<'t, T>, RenderError> {
    let options = options.into();
    options.size.checked()?;
    let op = Rasterize { mesh: mesh.clone(), options };
    let look = |saved: &Saved<T>| (saved.coverage.clone(), saved.visibility.reaches_behind);
    let (outputs, (coverage, reaches_behind)) = clip.tape().record_with(op, &[clip], look)?;
    let coverage = coverage.expect("forward has filled in the coverage");
    if !reaches_behind {
        clip.tape().leave_out("rasterize", "whole rows: no face reaches behind the eye");
    }
    Ok(Fragments { barycentrics: outputs[0], clip, coverage })
}

/// Input: clip `[V, 4]`. Output: barycentrics `[N, 2]`.
struct Rasterize {
    mesh: Mesh,
    options: RasterOptions,
}

/// The coverage, shared with the fragments that were handed out, and the memory of the search.
#[derive(Debug, Default)]
struct Saved<T: Scalar> {
    coverage: Option<Arc<Coverage>>,
    visibility: Visibility<T>,
}

/// The coverage of an earlier step, to be written over, where nobody else holds it; else a new one.
fn recycled<'a>(
    coverage: &'a mut Option<Arc<Coverage>>,
    mesh: &Mesh,
    size: Size,
) -> &'a mut Coverage {
    if coverage.as_mut().and_then(Arc::get_mut).is_none() {
        *coverage = None;
    }
    let coverage = coverage.get_or_insert_with(|| Arc::new(Coverage::empty(mesh.clone(), size)));
    let coverage = Arc::get_mut(coverage).expect("nobody else holds it");
    coverage.mesh = mesh.clone();
    coverage.size = size;
    coverage
}

impl<T: Scalar> Op<T> for Rasterize {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "rasterize"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (clip, shape) = (inputs.data(0), inputs.shape(0));
        if **shape != [self.mesh.vertex_count(), 4] {
            return Err(RenderError::Shape {
                operation: "rasterize",
                rule: format!("clip positions of shape [{}, 4]", self.mesh.vertex_count()),
                shape: shape.clone(),
            });
        }
        if let Some(at) = clip.iter().position(|coordinate| !coordinate.is_finite()) {
            let vertex = at / 4;
            let [x, y, z, w] = std::array::from_fn(|k| clip[4 * vertex + k].to_f64());
            return Err(RenderError::Position { vertex, x, y, z, w });
        }

        let Saved { coverage, visibility } = saved;
        let coverage = recycled(coverage, &self.mesh, self.options.size);
        visibility.run(clip, self.options, coverage);
        let mut barycentrics = outputs.push([coverage.count(), 2]);
        for band in visibility.bands() {
            let (own, rest) = barycentrics.split_at_mut(band.barycentrics.len());
            own.copy_from_slice(&band.barycentrics);
            barycentrics = rest;
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(clip_bar) = gradients.get(0) else { return };
        let Saved { coverage, visibility } = saved;
        let coverage = coverage.as_deref().expect("forward has filled in the coverage");
        let pull_back =
            PullBack { coverage, corners: &visibility.corners, uv_bar: kept.only_upstream() };
        Layout { coverage, mesh: &self.mesh, width: 4 }.add_to(clip_bar, &pull_back);
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        saved.coverage.as_ref().map_or(0, |coverage| coverage.bytes())
    }
}
