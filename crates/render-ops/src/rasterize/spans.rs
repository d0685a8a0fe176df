//! Large faces, and those that the filter leaves in doubt, drawn in spans: their depths are wide numbers.
//!
//! The plane has depths in single precision. Where two are too close to tell, both are computed anew in wide numbers.
//! So a pixel sees the face of the least depth in wide numbers, and of equal ones the first.

use std::ops::Range;
use std::sync::atomic::{Ordering, compiler_fence};

use bokashi_core::Scalar;
use pulp::Simd;

use super::filter::{Filter, are_beyond, first_lanes, is_drawn};
use crate::run_reader::NO_FACE;

/// Pixels of a row of a plane, into which a face is drawn.
pub(super) struct RowOfPixels<'a, S> {
    pub(super) depths: &'a mut [f32],
    pub(super) faces: &'a mut [u32],
    /// The number of the face.
    pub(super) number: u32,
    pub(super) filter: &'a Filter,
    /// The depth of a face that was drawn before, by its number, at (Y, X).
    pub(super) depth_of: &'a dyn Fn(u32, [S; 2]) -> S,
}

impl<S: Scalar<Wide = S>> RowOfPixels<'_, S> {
    /// Draws the columns `within`, which the face surely covers, where it is nearer. `is_linear` says whether its depth is
    /// linear along them but for a small share of the tolerance.
    #[inline(always)]
    pub(super) fn cover<V: Simd>(
        &mut self,
        simd: V,
        (y, is_linear): (S, bool),
        within: Range<usize>,
        centers: &[S],
        depth: impl Fn(S) -> S,
    ) {
        let Some(last) = within.len().checked_sub(1) else { return };
        let filter = self.filter;
        let ends = [within.start, within.end - 1].map(|column| depth(centers[column]).to_f64());
        if is_linear && are_beyond(ends) {
            return;
        }
        let is_plain = is_linear && filter.is_plain(ends);
        let [start, end] = ends.map(|depth| filter.narrow(depth));
        let slope = simd.splat_f32s((end - start) / last.max(1) as f32);
        let (start, advantage) = (simd.splat_f32s(start), simd.splat_f32s(filter.advantage()));
        let (one, number) = (simd.splat_f32s(1.0), simd.splat_u32s(self.number));
        let (mut x, lanes) = (first_lanes(simd), simd.splat_f32s(V::F32_LANES as f32));
        let mut closest = simd.splat_f32s(f32::INFINITY);
        let (depths, faces) = (&mut self.depths[within.clone()], &mut self.faces[within.clone()]);
        let (depth_blocks, rest) = V::as_mut_simd_f32s(depths);
        let blocks = depth_blocks.iter_mut().zip(V::as_mut_simd_u32s(faces).0);
        let in_blocks = centers[within.clone()].chunks_exact(V::F32_LANES);
        for ((depths, faces), centers) in blocks.zip(in_blocks) {
            let (own, tolerance) = match is_plain {
                true => (simd.mul_add_e_f32s(slope, x, start), one),
                false => filter.depths_of(simd, centers, &depth),
            };
            let (before, face_before) = (*depths, *faces);
            compiler_fence(Ordering::SeqCst);
            // How surely it is seen: above 1 it is, below -1 it is not.
            let nearer = simd.sub_f32s(simd.sub_f32s(before, own), advantage);
            let seen = simd.div_f32s(nearer, tolerance);
            let is_seen = simd.greater_than_f32s(seen, one);
            *depths = simd.select_f32s(is_seen, own, before);
            *faces = simd.select_u32s(is_seen, number, face_before);
            closest = simd.min_f32s(closest, simd.abs_f32s(seen));
            x = simd.add_f32s(x, lanes);
        }
        let is_settled = simd.reduce_min_f32s(closest) > 1.0;
        let first = if is_settled { within.end - rest.len() } else { within.start };
        for column in first..within.end {
            let x = centers[column];
            self.cover_one(y, (column, x), depth(x));
        }
    }

    /// Draws one pixel where it is nearer; returns whether it is.
    #[inline(always)]
    pub(super) fn cover_one(&mut self, y: S, (column, x): (usize, S), depth: S) -> bool {
        let value = depth.to_f64();
        let own = self.filter.narrow(value);
        let (before, face_before) = (self.depths[column], self.faces[column]);
        let tolerance = self.filter.tolerance_at(own);
        let nearer = before - own - self.filter.advantage();
        let may_be_seen = nearer >= -tolerance && face_before != self.number;
        if !may_be_seen || !is_drawn(value) {
            return false;
        }
        let is_seen = nearer > tolerance
            || face_before == NO_FACE
            || value < (self.depth_of)(face_before, [y, x]).to_f64();
        if is_seen {
            (self.depths[column], self.faces[column]) = (own, self.number);
        }
        is_seen
    }
}
