//! Depth at fragments.
//!
//! # Forward
//! `depth = Z / W`, `Z = sum z_i a_i`, `W = sum w_i a_i`, with the edge functions of the fragment's
//! face at its pixel's centre. In [`Scalar::Wide`].
//!
//! # Backward
//! `a_bar_i = depth_bar (z_i - depth w_i) / W`, from there as in `edge_functions`; and
//! `z_bar_i += depth_bar a_i / W`, `w_bar_i -= depth_bar depth a_i / W`. Terms beyond the range of
//! the numbers are treated as in [`rasterize`](crate::rasterize()).
//!
//! A piece of a boundary pixel has the depth of its mean weights b_i, which depend on the vertices:
//! `depth = Z / W`, `Z = sum b_i z_i`, `W = sum b_i w_i`; `b_bar_i = depth_bar (z_i - depth w_i) / W`,
//! `z_bar_i += depth_bar b_i / W`, `w_bar_i -= depth_bar depth b_i / W`.
//!
//! # Where it is not smooth
//! Where the visible face changes.
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
use crate::face_sums::{FaceSums, Layout, add_term};
use crate::fragments::Fragments;
use crate::runs::Run;

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
        return tape.apply(Depth { coverage }, &[fragments.clip, fragments.barycentrics]);
    }
    tape.apply(Depth { coverage }, &[fragments.clip])
}

/// Inputs: clip `[V, 4]`, and with exact coverage barycentrics `[N, 2]`. Output: depth `[N]`.
struct Depth {
    coverage: Arc<Coverage>,
}

/// The face of slot `slot` around the slot's first pixel.
fn face_of<T: Scalar>(coverage: &Coverage, clip: &[T], slot: usize) -> LocalFace<T::Wide> {
    let runs = &coverage.centers;
    let indices = coverage.mesh.faces()[runs.face(slot)];
    LocalFace::of(clip, indices, runs.first_pixel_of(slot), coverage.size)
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
        let (depths, pieces) = depths.split_at_mut(coverage.centers());
        if inputs.len() == 2 {
            for (run, piece) in coverage.pieces.runs.iter().zip(pieces) {
                let Mean { depth, .. } = Mean::of(coverage, clip, inputs.data(1), run);
                *piece =
                    T::narrow(depth.maximum_or_nan(-T::Wide::ONE).minimum_or_nan(T::Wide::ONE));
            }
        }
        coverage.centers.for_each_band_mut(1, depths, |slots, first, depths| {
            for slot in slots {
                let face = face_of(coverage, clip, slot);
                for run in coverage.centers.of(slot) {
                    let [mut x, y] = face.place(run.pixel as usize, coverage.size);
                    let row = face.row(y);
                    let own = run.fragments().start - first..run.fragments().end - first;
                    for depth in &mut depths[own] {
                        let a = row.map(|[start, slope]| start + slope * x);
                        let [z_over_w, _] = face.depth_and_w(a);
                        // What rasterization lets through lies between the planes.
                        *depth = T::narrow(
                            z_over_w.maximum_or_nan(-T::Wide::ONE).minimum_or_nan(T::Wide::ONE),
                        );
                        x += two;
                    }
                }
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let keep = Keep::NOTHING.input(0);
        if inputs.len() == 2 { keep.input(1) } else { keep }
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let (coverage, clip, depth_bar) = (&*self.coverage, kept.input(0), kept.only_upstream());
        let pieces = |barycentrics| {
            let mean = move |run: &Run| {
                let at = coverage.centers() + run.fragment as usize;
                (Mean::of(coverage, clip, barycentrics, run), depth_bar[at].widen(), at)
            };
            coverage.pieces.runs.iter().map(mean)
        };
        if let Some(clip_bar) = gradients.get(0) {
            let pull_back = DepthPullBack { coverage, clip, depth_bar };
            let runs = &coverage.centers;
            Layout { runs, mesh: &coverage.mesh, width: 4 }.add_to(clip_bar, &pull_back);
            if kept.input_count() == 2 {
                let entries = clip_bar.entries();
                for (mean, depth_bar, _) in pieces(kept.input(1)) {
                    let Mean { indices, weights, depth, w, .. } = mean;
                    for (index, weight) in indices.into_iter().zip(weights) {
                        let z_bar = depth_bar * weight / w;
                        let entries = &mut entries[4 * index as usize..][..4];
                        add_term(&mut entries[2], T::narrow(z_bar));
                        add_term(&mut entries[3], T::narrow(-depth * z_bar));
                    }
                }
            }
        }
        if kept.input_count() < 2 {
            return;
        }
        let Some(barycentrics_bar) = gradients.get(1) else { return };
        let entries = barycentrics_bar.entries();
        for (mean, depth_bar, at) in pieces(kept.input(1)) {
            let [u_bar, v_bar] = mean.slopes().map(|slope| T::narrow(depth_bar * slope));
            entries[2 * at] += u_bar;
            entries[2 * at + 1] += v_bar;
        }
    }
}

/// Where a piece has its mean weights.
struct Mean<S> {
    indices: [u32; 3],
    /// The weights of the face's vertices.
    weights: [S; 3],
    /// z and w of the vertices.
    zw: [[S; 2]; 3],
    depth: S,
    /// `sum b_i w_i`.
    w: S,
}

impl<S: Scalar<Wide = S>> Mean<S> {
    fn of<T: Scalar<Wide = S>>(
        coverage: &Coverage,
        clip: &[T],
        barycentrics: &[T],
        piece: &Run,
    ) -> Self {
        let indices = coverage.mesh.faces()[coverage.pieces.face_of(piece)];
        let at = coverage.centers() + piece.fragment as usize;
        let [u, v] = [0, 1].map(|k| barycentrics[2 * at + k].widen());
        let weights = [u, v, S::ONE - u - v];
        let zw = indices.map(|index| [2, 3].map(|k| clip[4 * index as usize + k].widen()));
        let [z, w] = [0, 1].map(|k| (0..3).map(|i| weights[i] * zw[i][k]).sum::<S>());
        Self { indices, weights, zw, depth: z / w, w }
    }

    /// The derivatives of the depth with respect to u and v.
    fn slopes(&self) -> [S; 2] {
        let slopes = self.zw.map(|[z, w]| (z - self.depth * w) / self.w);
        [slopes[0] - slopes[2], slopes[1] - slopes[2]]
    }
}

/// From the gradients of depths to those of the vertices.
struct DepthPullBack<'a, T> {
    coverage: &'a Coverage,
    clip: &'a [T],
    depth_bar: &'a [T],
}

impl<T: Scalar> FaceSums<T::Wide> for DepthPullBack<'_, T> {
    fn sum(&self, slot: usize, fragments: Range<usize>, rows: &mut [T::Wide]) {
        let face = face_of(self.coverage, self.clip, slot);
        let size = self.coverage.size;
        let (mut edges, mut direct) = (EdgeSums::default(), [[T::Wide::ZERO; 2]; 3]);
        let two = T::Wide::from_f64(2.0);
        for run in self.coverage.centers.within(slot, fragments) {
            let [mut x, y] = face.place(run.pixel as usize, size);
            let row = face.row(y);
            for depth_bar in &self.depth_bar[run.fragments()] {
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
