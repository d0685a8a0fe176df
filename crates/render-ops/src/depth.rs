//! Depth at fragments.
//!
//! # Forward
//! `depth = Z / W`, `Z = sum z_i a_i`, `W = sum w_i a_i`, with the edge functions of the fragment's
//! face at its pixel's centre. In [`Scalar::Wide`].
//!
//! # Backward
//! `a_bar_i = depth_bar (z_i - depth w_i) / W`, from there as in `edge_functions`; and
//! `z_bar_i += depth_bar a_i / W`, `w_bar_i -= depth_bar depth a_i / W`. Terms beyond the range of
//! the numbers as in [`rasterize`](crate::rasterize()).
//!
//! With exact coverage the depth is that at the centroid of each piece, which moves: z / w of the
//! clip positions, interpolated.
//!
//! # Where it is not smooth
//! Where another face comes to be seen.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::coverage::Coverage;
use crate::edge_functions::{EdgeSums, LocalFace};
use crate::error::RenderError;
use crate::face_sums::{FaceSums, Layout};
use crate::fragments::Fragments;
use crate::interpolate::interpolate;

/// Each fragment's depth z / w, -1 on the near plane and 1 on the far plane: `[N]`, differentiable
/// with respect to the clip positions that were rasterized.
///
/// # Errors
/// [`RenderError::Shape`] for fragments that are not whole; `TensorError::ForeignVariable` for
/// fragments of several tapes.
pub fn depth<'t, T: Scalar>(fragments: &Fragments<'t, T>) -> Result<Var<'t, T>, RenderError> {
    let tape = fragments.clip.tape();
    let coverage = fragments.checked_coverage("depth", tape)?;
    if coverage.is_exact() {
        let clip = interpolate(fragments.clip, fragments)?;
        let [z, w] = [2, 3].map(|at| clip.slice(1, at..at + 1));
        return Ok(z?.try_div(w?)?.reshape([coverage.count()])?);
    }
    tape.apply(Depth { coverage }, &[fragments.clip])
}

/// Input: clip `[V, 4]`. Output: depth `[N]`.
struct Depth {
    coverage: Arc<Coverage>,
}

/// The face of slot `slot` around the slot's first pixel.
fn face_of<T: Scalar>(coverage: &Coverage, clip: &[T], slot: usize) -> LocalFace<T::Wide> {
    let indices = coverage.mesh.faces()[coverage.slots[slot].face as usize];
    LocalFace::of(clip, indices, coverage.first_pixel_of(slot), coverage.size)
}

impl<T: Scalar> Op<T> for Depth {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "depth"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let (coverage, clip) = (&*self.coverage, inputs.data(0));
        let depths = outputs.push([coverage.count()]);
        let two = T::Wide::from_f64(2.0);
        coverage.for_each_band_mut(coverage.bands(), 1, depths, |slots, first, depths| {
            for slot in slots {
                let face = face_of(coverage, clip, slot);
                for span in coverage.spans_of(slot) {
                    let [mut x, y] = face.place(span.pixel, coverage.size);
                    let row = face.row(y);
                    let own = span.fragments.start - first..span.fragments.end - first;
                    for depth in &mut depths[own] {
                        let a = row.map(|[start, slope]| start + slope * x);
                        let [z_over_w, _] = face.depth_and_w(a);
                        // What rasterization lets through lies between the planes.
                        *depth = T::narrow(z_over_w.greater(-T::Wide::ONE).lesser(T::Wide::ONE));
                        x += two;
                    }
                }
            }
        });
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(clip_bar) = gradients.get(0) else { return };
        let coverage = &*self.coverage;
        let pull_back = PullBack { coverage, clip: kept.input(0), depth_bar: kept.only_upstream() };
        Layout { coverage, bands: coverage.bands(), mesh: &coverage.mesh, width: 4 }
            .add_to(clip_bar, &pull_back);
    }
}

/// From the gradients of depths to those of the vertices.
struct PullBack<'a, T> {
    coverage: &'a Coverage,
    clip: &'a [T],
    depth_bar: &'a [T],
}

impl<T: Scalar> FaceSums<T::Wide> for PullBack<'_, T> {
    fn sum(&self, slot: usize, fragments: Range<usize>, rows: &mut [T::Wide]) {
        let face = face_of(self.coverage, self.clip, slot);
        let size = self.coverage.size;
        let (mut edges, mut direct) = (EdgeSums::default(), [[T::Wide::ZERO; 2]; 3]);
        let two = T::Wide::from_f64(2.0);
        for span in self.coverage.spans_within(slot, fragments) {
            let [mut x, y] = face.place(span.pixel, size);
            let row = face.row(y);
            for depth_bar in &self.depth_bar[span.fragments] {
                let a = row.map(|[start, slope]| start + slope * x);
                let [depth, w] = face.depth_and_w(a);
                let scale = depth_bar.widen() / w;
                let a_bar = face.vertices.map(|vertex| scale * (vertex.z - depth * vertex.w));
                edges.add_row(a_bar, a_bar.map(|a_bar| x * a_bar), y);
                for (direct, a) in direct.iter_mut().zip(a) {
                    direct[0] += scale * a;
                    direct[1] -= scale * depth * a;
                }
                x += two;
            }
        }
        for (i, row) in rows.chunks_exact_mut(4).enumerate() {
            let [x_bar, y_bar, w_bar] = face.pull_back(&edges, i, size);
            let [z_bar, more_w_bar] = direct[i];
            let bars = [x_bar, y_bar, z_bar, w_bar + more_w_bar];
            row.copy_from_slice(&bars.map(|bar| face.factors[i] * bar));
        }
    }
}
