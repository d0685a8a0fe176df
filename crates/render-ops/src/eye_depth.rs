//! Distances along the view axis at fragments.
//!
//! # Forward
//! `w = sum_i b_i w_i`, with the perspective-correct weights b of the fragment's face. Along a face 1 / w
//! is linear over the image, and w is linear over the face. So w needs no division, and for a piece of a
//! boundary pixel, whose weights are means, it is the mean.
//!
//! # Backward
//! `u_bar += w_bar (w_0 - w_2)`, `v_bar += w_bar (w_1 - w_2)`; `w_bar_i += b_i w_bar` at the vertices.
//! What the weights owe to the vertices is [`rasterize`](crate::rasterize())'s to add.
//!
//! # Where it is not smooth
//! Where the visible face changes.
//!
//! # Source
//! Olano and Greer, *Triangle scan conversion using 2D homogeneous coordinates*, Graphics Hardware
//! 1997.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::background::Background;
use crate::coverage::Coverage;
use crate::depth_image::DepthImage;
use crate::error::RenderError;
use crate::face_sums::{FaceSums, Layout};
use crate::fragments::Fragments;
use crate::picture::Composite;

const NAME: &str = "eye_depth";

/// Each fragment's distance along the view axis, by the clip positions that were rasterized and the
/// barycentrics; differentiable with respect to both. A piece of exact coverage has its mean distance.
///
/// It is the w of clip space, which is the distance, in units of the scene, for the matrices of
/// [`pinhole`](crate::pinhole()) and [`perspective`](crate::camera::perspective). An orthographic camera
/// has w = 1 everywhere. There interpolate the z of the vertices in camera coordinates instead, and make
/// a [`DepthImage::of_distances`].
///
/// # Errors
/// [`RenderError::Shape`] for fragments that are not whole; `TensorError::ForeignVariable` for
/// fragments of several tapes.
#[inline(never)]
pub fn eye_depth<'t, T: Scalar>(
    fragments: &Fragments<'t, T>,
) -> Result<EyeDepth<'t, T>, RenderError> {
    let tape = fragments.clip.tape();
    let coverage = fragments.checked_coverage(NAME, tape)?;
    let inputs = [fragments.clip, fragments.barycentrics];
    Ok(EyeDepth { values: tape.apply(OfFragments { coverage }, &inputs)? })
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
            return Err(RenderError::of_value(NAME, rule, far));
        }
        let far = self.values.tape().constant_full([1], T::from_f64(far));
        let rows = self.values.reshape([self.values.shape().size(), 1])?;
        let picture = Composite::of_values(rows, fragments, Background::Color(far))?;
        let size = picture.size();
        Ok(DepthImage::of_distances(picture.image()?.reshape([size.height, size.width])?))
    }
}

/// Inputs: clip `[V, 4]`, barycentrics `[N, 2]`. Output: distances `[N]`.
struct OfFragments {
    coverage: Arc<Coverage>,
}

/// `w_0 - w_2`, `w_1 - w_2` and `w_2` of a face.
fn slopes<T: Scalar>(coverage: &Coverage, clip: &[T], face: usize) -> [T::Wide; 3] {
    let corners = coverage.mesh().faces()[face];
    let [p, q, r] = corners.map(|vertex| clip[4 * vertex as usize + 3].widen());
    [p - r, q - r, r]
}

impl OfFragments {
    /// Calls `work(face, fragments, own)` for each face in each band, with its fragments and their
    /// entries of `entries: [N, width]`. Bands may be worked on at the same time.
    fn for_each_face_mut<T: Scalar>(
        &self,
        width: usize,
        entries: &mut [T],
        work: impl Fn(usize, Range<usize>, &mut [T]) + Sync,
    ) {
        let Coverage { centers, pieces, .. } = &*self.coverage;
        let (of_centers, of_pieces) = entries.split_at_mut(centers.count * width);
        for (runs, before, entries) in
            [(centers, 0, of_centers), (pieces, centers.count, of_pieces)]
        {
            runs.for_each_band_mut(width, entries, |slots, first, entries| {
                for slot in slots {
                    let Range { start, end } = runs.fragments_of(slot..slot + 1);
                    let own = &mut entries[(start - first) * width..(end - first) * width];
                    work(runs.face(slot), before + start..before + end, own);
                }
            });
        }
    }
}

impl<T: Scalar> Op<T> for OfFragments {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let (clip, barycentrics) = (inputs.data(0), inputs.data(1));
        let values = outputs.push([self.coverage.count()]);
        self.for_each_face_mut(1, values, |face, fragments, own| {
            let [by_u, by_v, start] = slopes(&self.coverage, clip, face);
            let uv = &barycentrics.as_chunks::<2>().0[fragments];
            for (own, [u, v]) in own.iter_mut().zip(uv) {
                *own = T::narrow(start + u.widen() * by_u + v.widen() * by_v);
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        match (inputs.needs(0), inputs.needs(1)) {
            (true, true) => Keep::NOTHING.input(0).input(1),
            (true, false) => Keep::NOTHING.input(1),
            (false, true) => Keep::NOTHING.input(0),
            (false, false) => Keep::NOTHING,
        }
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let bars = kept.only_upstream();
        if let Some(clip_bar) = gradients.get(0) {
            let mut first = 0;
            for runs in [&self.coverage.centers, &self.coverage.pieces] {
                let shares = Shares { uv: &kept.input(1)[2 * first..], bars: &bars[first..] };
                Layout { runs, mesh: self.coverage.mesh(), width: 4 }.add_to(clip_bar, &shares);
                first += runs.count;
            }
        }
        if let Some(barycentrics_bar) = gradients.get(1) {
            let clip = kept.input(0);
            self.for_each_face_mut(2, barycentrics_bar.entries(), |face, fragments, own| {
                let [by_u, by_v, _] = slopes(&self.coverage, clip, face);
                for (own, bar) in own.as_chunks_mut::<2>().0.iter_mut().zip(&bars[fragments]) {
                    own[0] += T::narrow(bar.widen() * by_u);
                    own[1] += T::narrow(bar.widen() * by_v);
                }
            });
        }
    }
}

/// The shares of each vertex in the gradients of distances, in the column of w.
struct Shares<'a, T> {
    uv: &'a [T],
    bars: &'a [T],
}

impl<T: Scalar> FaceSums<T::Wide> for Shares<'_, T> {
    fn sum(&self, _slot: usize, fragments: Range<usize>, rows: &mut [T::Wide]) {
        let mut sums = [T::Wide::ZERO; 3];
        let uv = &self.uv.as_chunks::<2>().0[fragments.clone()];
        for ([u, v], bar) in uv.iter().zip(&self.bars[fragments]) {
            let (u, v, bar) = (u.widen(), v.widen(), bar.widen());
            let shares = [u, v, T::Wide::ONE - u - v];
            sums.iter_mut().zip(shares).for_each(|(sum, share)| *sum += share * bar);
        }
        for (row, sum) in rows.chunks_exact_mut(4).zip(sums) {
            row.copy_from_slice(&[T::Wide::ZERO, T::Wide::ZERO, T::Wide::ZERO, sum]);
        }
    }
}
