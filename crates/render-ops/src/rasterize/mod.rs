//! Rasterization of triangles to fragments.
//!
//! # Forward
//! At the centre of each pixel, of all faces that cover it the nearest one (see `setup` for the
//! coverage, `visibility` for the search). With the edge functions `a_i = q_j x q_k` of its vertices
//! relative to the pixel centre: `u = a_0 / A`, `v = a_1 / A`, `A = a_0 + a_1 + a_2` are
//! perspective-correct, and `depth = Z / W` with `Z = sum z_i a_i`, `W = sum w_i a_i`. All of this in
//! [`Scalar::Wide`].
//!
//! # Backward
//! With `m = u_bar u + v_bar v`: `a_bar_0 = (u_bar - m) / A`, `a_bar_1 = (v_bar - m) / A`,
//! `a_bar_2 = -m / A`; from the depth `a_bar_i += depth_bar (z_i - depth w_i) / W`,
//! `z_bar_i = depth_bar a_i / W`, `w_bar_i = -depth_bar depth a_i / W`. Then
//! `q_bar_1 += a_bar_0 (q_2y, -q_2x)`, `q_bar_2 += a_bar_0 (-q_1y, q_1x)` and cyclic, and
//! `x_bar_i = width q_bar_ix`, `y_bar_i = height q_bar_iy`, `w_bar_i -= X q_bar_ix + Y q_bar_iy`.
//! All of them grow as 1 over the scale of the positions: terms beyond the range of the numbers
//! make an entry infinite, with the sign of the first of them, and not NaN.
//!
//! # Where it is not smooth
//! Which face a pixel sees is a step function of the vertices: its derivative is zero almost
//! everywhere and not defined where a silhouette or an intersection crosses the pixel centre.
//! [`antialias`](crate::antialias()) makes up for silhouettes.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020; coverage as in `homogeneous`.

mod setup;
#[cfg(test)]
mod tests;
mod visibility;

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use self::visibility::Visibility;
use crate::error::RenderError;
use crate::fragments::{Coverage, Fragments, NO_FRAGMENT};
use crate::homogeneous::{Vertex, cross, missing_factors};
use crate::mesh::Mesh;
use crate::runs::RunSums;
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
/// through the near and far planes: the visible part is drawn. Faces of zero area are not drawn
/// and are counted in [`Coverage::culled`].
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
    let (outputs, coverage) =
        clip.tape().record_with(op, &[clip], |saved| saved.coverage.clone())?;
    let coverage = coverage.expect("forward has filled in the coverage");
    Ok(Fragments { barycentrics: outputs[0], depth: outputs[1], coverage })
}

/// Input: clip `[V, 4]`. Outputs: barycentrics `[N, 2]`, depth `[N]`.
struct Rasterize {
    mesh: Mesh,
    options: RasterOptions,
}

/// The coverage, shared with the fragments that were handed out, and the memory of the search.
#[derive(Debug)]
struct Saved<S> {
    coverage: Option<Arc<Coverage>>,
    visibility: Visibility<S>,
}

impl<S> Default for Saved<S> {
    fn default() -> Self {
        Self { coverage: None, visibility: Visibility::default() }
    }
}

impl<S> Saved<S> {
    /// The coverage of an earlier step, to be written over, where nobody else holds it; else a new
    /// one.
    fn recycled(&mut self, mesh: &Mesh, size: Size) -> &mut Coverage {
        if self.coverage.as_mut().and_then(Arc::get_mut).is_none() {
            self.coverage = None;
        }
        let coverage = self.coverage.get_or_insert_with(|| {
            Arc::new(Coverage {
                mesh: mesh.clone(),
                size,
                faces: Vec::new(),
                pixels: Vec::new(),
                fragment_of_pixel: Vec::new(),
                culled: Default::default(),
            })
        });
        let coverage = Arc::get_mut(coverage).expect("nobody else holds it");
        coverage.mesh = mesh.clone();
        coverage.size = size;
        coverage.faces.clear();
        coverage.pixels.clear();
        coverage.fragment_of_pixel.clear();
        coverage.fragment_of_pixel.resize(size.pixels(), NO_FRAGMENT);
        coverage
    }
}

impl<T: Scalar> Op<T> for Rasterize {
    type Saved = Saved<T::Wide>;
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

        saved.recycled(&self.mesh, self.options.size);
        let coverage = saved.coverage.as_mut().and_then(Arc::get_mut).expect("just recycled");
        let (bands, culled) = saved.visibility.run(clip, &self.mesh, self.options);
        coverage.culled = culled;
        let count = bands.iter().map(|band| band.fragments.len()).sum();
        let [barycentrics, depth] = outputs.push_all([[count, 2].into(), [count].into()]);
        let fragments = bands.iter().flat_map(|band| &band.fragments);
        let entries = barycentrics.chunks_exact_mut(2).zip(depth);
        for ((fragment, (barycentric, depth)), at) in fragments.zip(entries).zip(0..) {
            coverage.faces.push(fragment.face);
            coverage.pixels.push(fragment.pixel);
            coverage.fragment_of_pixel[fragment.pixel as usize] = at;
            barycentric[0] = T::narrow(fragment.sample.u);
            barycentric[1] = T::narrow(fragment.sample.v);
            *depth = T::narrow(fragment.sample.depth);
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(clip_bar) = gradients.get(0) else { return };
        let clip = kept.input(0);
        let (barycentrics_bar, depth_bar) = (kept.upstream(0), kept.upstream(1));
        let coverage = saved.coverage.as_ref().expect("forward has filled in the coverage");
        let size = self.options.size;
        let sums = RunSums { coverage, mesh: &self.mesh, width: 4 };
        sums.add_to(clip_bar, |face, fragments: Range<usize>, sums| {
            let (vertices, factors) = Vertex::of_face(clip, self.mesh.faces()[face], size);
            for fragment in fragments {
                let pixel = coverage.pixels[fragment] as usize;
                let center = [size.center_x(pixel % size.width), size.center_y(pixel / size.width)];
                let upstream = Upstream {
                    uv: barycentrics_bar
                        .map(|bar| [bar[2 * fragment], bar[2 * fragment + 1]].map(T::widen)),
                    depth: depth_bar.map(|bar| bar[fragment].widen()),
                };
                upstream.pull_back(&vertices, factors, center, size, sums);
            }
            for (sums, &factor) in sums.chunks_exact_mut(4).zip(&factors) {
                sums.iter_mut().for_each(|sum| *sum = factor * *sum);
            }
        });
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        saved.coverage.as_ref().map_or(0, |coverage| {
            size_of::<u32>()
                * (coverage.faces.len() + coverage.pixels.len() + coverage.fragment_of_pixel.len())
        })
    }
}

/// The upstream gradients of one fragment, those that are not zero for all.
struct Upstream<S> {
    uv: Option<[S; 2]>,
    depth: Option<S>,
}

impl<S: Scalar<Wide = S>> Upstream<S> {
    /// Adds the gradients with respect to (x, y, z, w) of the three vertices, as they are after
    /// being multiplied by `factors`, to `sums: [3, 4]`.
    #[inline]
    fn pull_back(
        &self,
        vertices: &[Vertex<S>; 3],
        factors: [S; 3],
        center: [S; 2],
        size: Size,
        sums: &mut [S],
    ) {
        let q = vertices.map(|vertex| vertex.relative_to(center[0], center[1]));
        let a = [cross(q[1], q[2]), cross(q[2], q[0]), cross(q[0], q[1])];
        let mut a_bar = [S::ZERO; 3];
        if let Some([u_bar, v_bar]) = self.uv {
            // The weights are missing_i a_i, so a_bar_i gets that factor.
            let missing = missing_factors(a, factors);
            let weights: [S; 3] = std::array::from_fn(|k| missing[k] * a[k]);
            let total = weights[0] + weights[1] + weights[2];
            let m = (u_bar * weights[0] + v_bar * weights[1]) / total;
            let weights_bar = [(u_bar - m) / total, (v_bar - m) / total, -m / total];
            a_bar = std::array::from_fn(|k| missing[k] * weights_bar[k]);
        }
        if let Some(depth_bar) = self.depth {
            let w: S = (0..3).map(|i| vertices[i].w * a[i]).sum();
            let z: S = (0..3).map(|i| vertices[i].z * a[i]).sum();
            let (depth, scale) = (z / w, depth_bar / w);
            for i in 0..3 {
                a_bar[i] += scale * (vertices[i].z - depth * vertices[i].w);
                sums[4 * i + 2] += scale * a[i];
                sums[4 * i + 3] -= scale * depth * a[i];
            }
        }
        let (width, height) = (S::from_f64(size.width as f64), S::from_f64(size.height as f64));
        for i in 0..3 {
            // Vertex i is the second of one edge function and the first of another.
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            let x_bar = a_bar[k] * q[j][1] - a_bar[j] * q[k][1];
            let y_bar = a_bar[j] * q[k][0] - a_bar[k] * q[j][0];
            sums[4 * i] += width * x_bar;
            sums[4 * i + 1] += height * y_bar;
            sums[4 * i + 3] -= center[0] * x_bar + center[1] * y_bar;
        }
    }
}
