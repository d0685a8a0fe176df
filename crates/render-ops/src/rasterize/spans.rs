//! Large faces, and those that the filter leaves in doubt, drawn in spans: their depths are wide numbers.
//!
//! The plane has depths in single precision. Where two are too close to tell, both are computed anew in wide numbers.
//! So a pixel sees the face of the least depth in wide numbers, and of equal ones the first.

use std::ops::Range;

use bokashi_core::Scalar;

use super::filter::{EIGHT, Eight, Filter};
use super::plane::NO_FACE;

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

/// The largest depth that is drawn.
const LARGEST_DEPTH: f64 = 1.0;

impl<S: Scalar<Wide = S>> RowOfPixels<'_, S> {
    /// Draws the columns `within`, which the face surely covers, where it is nearer.
    #[inline(always)]
    pub(super) fn cover(&mut self, y: S, within: Range<usize>, centers: &[S], depth: impl Fn(S) -> S) {
        let filter = self.filter;
        let advantage = filter.advantage();
        let [surely, perhaps] = filter.depth_ranges(LARGEST_DEPTH);
        let mut doubts = [0_u32; EIGHT];
        let (depths, faces) = (&mut self.depths[within.clone()], &mut self.faces[within.clone()]);
        let (depth_blocks, depths) = depths.as_chunks_mut::<EIGHT>();
        let (face_blocks, _) = faces.as_chunks_mut::<EIGHT>();
        let center_blocks = centers[within.clone()].as_chunks::<EIGHT>().0;
        for ((depths, faces), x) in depth_blocks.iter_mut().zip(face_blocks).zip(center_blocks) {
            let mut own: Eight<f32> = [0.0; EIGHT];
            for lane in 0..EIGHT {
                own[lane] = filter.narrow(depth(x[lane]).to_f64());
            }
            for lane in 0..EIGHT {
                let (own, before, face_before) = (own[lane], depths[lane], faces[lane]);
                let tolerance = filter.tolerance_at(own);
                let is_in = |[nearest, farthest]: [f32; 2]| (own > nearest) & (own < farthest);
                let nearer = before - own - advantage;
                let is_seen = is_in(surely) & (nearer > tolerance);
                let may_be_seen = is_in(perhaps) & (nearer >= -tolerance);
                doubts[lane] |= u32::from(may_be_seen & !is_seen & (face_before != self.number));
                depths[lane] = if is_seen { own } else { before };
                faces[lane] = if is_seen { self.number } else { face_before };
            }
        }
        let is_settled = doubts.iter().fold(0, |any, doubt| any | doubt) == 0;
        let rest = within.end - depths.len();
        let first = if is_settled { rest } else { within.start };
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
        if !may_be_seen || !(-LARGEST_DEPTH..=LARGEST_DEPTH).contains(&value) {
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
