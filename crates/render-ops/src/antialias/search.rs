//! The blends at silhouettes, found face by face.

use std::ops::Range;

use bokashi_core::Scalar;

use super::discontinuity::{Blend, SilhouetteFace};
use super::pairs::Pair;
use crate::coverage::Coverage;
use crate::dispatch::dispatch_256;
use crate::edge_functions::depth_at;
use crate::runs::Run;

/// A blend, and what it is found with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found<S> {
    /// What the order of blends is by: first this, see [`Search::seen`], then the column.
    pub(super) line: u32,
    pub(super) column: u32,
    pub(super) blend: Blend<S>,
    /// The fragments of its two pixels.
    pub(super) fragments: [u32; 2],
}

/// The lines of blends in a row of the image.
pub(super) const LINES: usize = 3;

/// The row of an uncovered pixel, as long as not all of them are known.
pub(super) const MISSING: u32 = u32::MAX;

/// What is drawn.
pub(super) struct Search<'a, T: Scalar> {
    pub(super) coverage: &'a Coverage,
    pub(super) clip: &'a [T],
}

impl<T: Scalar> Search<'_, T> {
    /// Finds the blends by the faces of some slots.
    pub(super) fn find(&self, slots: Range<usize>, found: &mut Vec<Found<T::Wide>>) {
        dispatch_256::<T, _>(
            #[inline(always)]
            || {
                for slot in slots {
                    let face = self.coverage.centers.face(slot);
                    let silhouettes = self.coverage.silhouettes_of(face);
                    if silhouettes != 0 {
                        self.find_by_face(slot, face, silhouettes, found);
                    }
                }
            },
        );
    }

    /// Finds the blends by a face with silhouettes.
    #[inline(always)]
    fn find_by_face(
        &self,
        slot: usize,
        face: usize,
        silhouettes: u8,
        found: &mut Vec<Found<T::Wide>>,
    ) {
        let size = self.coverage.size();
        let indices = self.coverage.mesh().faces()[face];
        let silhouette_face = SilhouetteFace::new(self.clip, indices, silhouettes, size);
        let runs = self.coverage.centers.in_slot(slot);
        silhouette_face.for_each_line(
            size,
            #[inline(always)]
            |corner, line| {
                for run in runs {
                    let [row, column] = size.row_and_column(run.pixel as usize);
                    let first = column as u32;
                    line.for_each_pair(
                        row as u32,
                        first..first + run.length,
                        size,
                        #[inline(always)]
                        |pair| {
                            if let Some(blend) = silhouette_face.blend(corner, &pair, size) {
                                let fragment = run.fragment + pair.covered_pixel()[1] - first;
                                found.extend(self.blend_in_front(
                                    &silhouette_face,
                                    face,
                                    fragment,
                                    pair,
                                    blend,
                                ));
                            }
                        },
                    );
                }
            },
        );
    }

    /// A blend by a face at a pair, if the other pixel sees no other face, or a farther one. Of faces
    /// that are as near the blend is by the first pixel's.
    #[inline(always)]
    fn blend_in_front(
        &self,
        silhouette_face: &SilhouetteFace<T::Wide>,
        face: usize,
        fragment: u32,
        pair: Pair,
        blend: Blend<T::Wide>,
    ) -> Option<Found<T::Wide>> {
        let (coverage, size) = (self.coverage, self.coverage.size());
        let [row, column] = pair.other_pixel();
        let mut other_fragment = MISSING;
        let mut is_outlined = false;
        if let Some(run) = coverage.run_in_row(row as usize, column) {
            let other = coverage.centers.face_of(run);
            if other == face {
                return None;
            }
            let indices = coverage.mesh().faces()[other];
            let vertices = SilhouetteFace::corners(self.clip, indices, size);
            let own_depth = depth_at(&silhouette_face.vertices, pair.covered_pixel(), size);
            let other_depth = depth_at(&vertices, pair.other_pixel(), size);
            let (is_nearer, is_farther) = (own_depth < other_depth, other_depth < own_depth);
            let is_behind = if pair.covers_first { is_farther } else { !is_nearer };
            if is_behind {
                return None;
            }
            let Run { pixel, fragment, .. } = *run;
            other_fragment = fragment + (row * size.width as u32 + column - pixel);
            is_outlined = coverage.silhouettes_of(other) != 0;
        }
        // Row by row from the top: pairs beside each other, then those whose upper pixel sees a face with
        // silhouettes, then the others.
        let kind = match pair.below {
            false => 0,
            true if pair.covers_first || is_outlined => 1,
            true => 2,
        };
        let (line, column) = (LINES as u32 * pair.row + kind, pair.column);
        let fragments = [fragment, other_fragment];
        let fragments = if pair.covers_first { fragments } else { [other_fragment, fragment] };
        Some(Found { line, column, blend, fragments })
    }
}
