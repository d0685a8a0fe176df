//! The blends at silhouettes, found face by face.

use std::ops::Range;

use bokashi_core::Scalar;

use super::discontinuity::{Blend, SilhouetteFace};
use super::pairs::Pair;
use crate::coverage::Coverage;
use crate::dispatch::dispatch_256;
use crate::edge_functions::depth_at;
use crate::fetch::{AT_ONCE, fetch, is_large};
use crate::scratch::Workbench;

/// A blend, and what it is found with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found<S> {
    /// What the order of blends is by: first this, see [`Search::blend_in_front`], then the column.
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

/// A blend by a face, if the other pixel sees no other face, or a farther one.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate<S> {
    blend: Blend<S>,
    pair: Pair,
    face: u32,
    fragment: u32,
    /// The face's depth at its pixel.
    depth: S,
    /// The run of the other pixel, if it sees a face, and that face's depth there.
    other: Option<u32>,
    other_depth: S,
}

/// What is drawn, and memory.
pub(super) struct Search<'a, T: Scalar> {
    pub(super) coverage: &'a Coverage,
    pub(super) clip: &'a [T],
    pub(super) candidates: &'a Workbench<Vec<Candidate<T::Wide>>>,
}

impl<T: Scalar> Search<'_, T> {
    /// Finds the blends by the faces of the slots of a band.
    pub(super) fn find(&self, slots: Range<usize>, found: &mut Vec<Found<T::Wide>>) {
        let mut candidates = self.candidates.take();
        dispatch_256::<T, _>(
            #[inline(always)]
            || {
                if is_large(self.coverage.mesh().faces()) {
                    self.coverage.fetch_runs(slots.clone());
                }
                // Moved, so that the closure can run only once and is inlined here.
                let (end, starts) = (slots.end, slots.step_by(AT_ONCE));
                for start in starts {
                    candidates.clear();
                    self.find_candidates(start..end.min(start + AT_ONCE), &mut candidates);
                    self.find_others(&mut candidates);
                    for candidate in &candidates {
                        self.blend_in_front(candidate, found);
                    }
                }
            },
        );
        self.candidates.put_back(candidates);
    }

    /// Finds the candidates by the faces of at most [`AT_ONCE`] slots.
    #[inline(always)]
    fn find_candidates(&self, slots: Range<usize>, candidates: &mut Vec<Candidate<T::Wide>>) {
        let coverage = self.coverage;
        if is_large(coverage.mesh().faces()) {
            let adjacency = coverage.mesh().adjacency();
            slots
                .clone()
                .for_each(|slot| fetch(adjacency.neighbors(coverage.centers.face(slot))[1]));
        }
        // Put on the list without a branch, which nobody could foretell.
        let (mut folded, mut count) = ([(0, 0); AT_ONCE], 0);
        let edges = coverage.silhouette_edges();
        for slot in slots {
            let silhouettes = edges.find(coverage.centers.face(slot));
            folded[count] = (slot, silhouettes);
            count += usize::from(silhouettes != 0);
        }
        for &(slot, silhouettes) in &folded[..count] {
            self.find_by_face(slot, silhouettes, candidates);
        }
    }

    /// Finds the candidates by a face with silhouettes.
    #[inline(always)]
    fn find_by_face(&self, slot: usize, silhouettes: u8, candidates: &mut Vec<Candidate<T::Wide>>) {
        let size = self.coverage.size();
        let face = self.coverage.centers.face(slot);
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
                                let covered = pair.covered_pixel();
                                candidates.push(Candidate {
                                    pair,
                                    blend,
                                    face: face as u32,
                                    fragment: run.fragment + covered[1] - first,
                                    depth: depth_at(&silhouette_face.vertices, covered, size),
                                    other: None,
                                    other_depth: T::Wide::ZERO,
                                });
                            }
                        },
                    );
                }
            },
        );
    }

    /// Finds what the other pixels see.
    #[inline(always)]
    fn find_others(&self, candidates: &mut [Candidate<T::Wide>]) {
        let (coverage, size) = (self.coverage, self.coverage.size());
        // First by themselves: they wait for memory, but not for each other.
        for candidate in &mut *candidates {
            let [row, column] = candidate.pair.other_pixel();
            candidate.other = coverage.run_in_row(row as usize, column);
        }
        for candidate in candidates {
            let Some(run) = candidate.other else { continue };
            let face = coverage.centers.face_of(&coverage.centers.runs[run as usize]);
            let vertices = SilhouetteFace::corners(self.clip, coverage.mesh().faces()[face], size);
            candidate.other_depth = depth_at(&vertices, candidate.pair.other_pixel(), size);
        }
    }

    /// Adds the blend of a candidate, if its other pixel sees no other face, or a farther one. Of faces that are as near
    /// the blend is by the first pixel's.
    #[inline(always)]
    fn blend_in_front(&self, candidate: &Candidate<T::Wide>, found: &mut Vec<Found<T::Wide>>) {
        let (coverage, width) = (self.coverage, self.coverage.size().width as u32);
        let Candidate { blend, pair, face, fragment, depth, other, other_depth } = candidate;
        let mut other_fragment = MISSING;
        let mut is_outlined = false;
        if let Some(run) = *other {
            let run = &coverage.centers.runs[run as usize];
            let other = coverage.centers.face_of(run);
            let (is_nearer, is_farther) = (depth < other_depth, other_depth < depth);
            let is_behind = if pair.covers_first { is_farther } else { !is_nearer };
            if is_behind || other == *face as usize {
                return;
            }
            let [row, column] = pair.other_pixel();
            other_fragment = run.fragment + (row * width + column - run.pixel);
            is_outlined = coverage.silhouette_edges().find(other) != 0;
        }
        // Row by row from the top: pairs beside each other, then those whose upper pixel sees a face with
        // silhouettes, then the others.
        let kind = match pair.below {
            false => 0,
            true if pair.covers_first || is_outlined => 1,
            true => 2,
        };
        let (line, column) = (LINES as u32 * pair.row + kind, pair.column);
        let fragments = [*fragment, other_fragment];
        let fragments = if pair.covers_first { fragments } else { [other_fragment, *fragment] };
        found.push(Found { line, column, blend: *blend, fragments });
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;
    use crate::size::Size;

    #[test]
    fn faces_that_are_searched_at_once_have_the_blends_that_each_has_alone() {
        let count = 3 * AT_ONCE + 5;
        let corners = (0..count).flat_map(|k| {
            let (x, y) = (-0.9 + 0.017 * k as f64, 0.7 * (2.4 * k as f64).sin());
            let z = 0.1 * (k % 7) as f64;
            [[x, y, z, 1.0], [x + 0.2, y - 0.03, z, 1.0], [x + 0.03, y + 0.2, z, 1.0]]
        });
        let clip = Tensor::new([3 * count, 4], corners.flatten().collect()).unwrap();
        let faces = (0..count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let mesh = Mesh::new(faces, 3 * count).unwrap();
        let tape = Tape::<f64>::new();
        let fragments = rasterize(tape.leaf(&clip), &mesh, Size { width: 90, height: 80 }).unwrap();
        let (coverage, candidates) = (&*fragments.coverage, &Workbench::default());
        assert!(coverage.centers.bands() == 1 && coverage.centers.slots.len() > 2 * AT_ONCE);
        let search = Search { coverage, clip: clip.data(), candidates };
        let (mut together, mut alone) = (Vec::new(), Vec::new());
        let slots = 0..coverage.centers.slots.len();
        search.find(slots.clone(), &mut together);
        slots.for_each(|slot| search.find(slot..slot + 1, &mut alone));
        assert!(together.len() > count);
        let numbers = |found: &[Found<f64>]| -> Vec<_> {
            let of_one = |f: &Found<f64>| (f.line, f.column, f.fragments, f.blend.alpha);
            found.iter().map(of_one).collect()
        };
        assert_eq!(numbers(&together), numbers(&alone));
    }

    /// Layers of a flat drawing share borders, not vertices. Products with the depth 0.5 are exact, so that depths tie.
    #[test]
    fn of_faces_at_one_depth_that_of_the_first_pixel_blends() {
        let count = 40;
        let corners = (0..count).flat_map(|k| {
            let at = |phase: f64| 0.05 * (2.4 * k as f64 + phase).sin();
            let (x, y) = (-0.9 + 0.2 * (k % 10) as f64, -0.8 + 0.5 * (k / 10) as f64);
            let ([top, bottom], side) = ([[x + at(0.0), y + 0.2], [x + at(1.0), y - 0.2]], 0.09);
            [top, bottom, [x - side, y + at(2.0)], bottom, top, [x + side, y + at(3.0)]]
        });
        let clip = corners.flat_map(|[x, y]| [x, y, 0.5, 1.0]).collect();
        let clip = Tensor::<f64>::new([6 * count, 4], clip).unwrap();
        let faces = (0..2 * count as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let mesh = Mesh::new(faces, 6 * count).unwrap();
        let tape = Tape::<f64>::new();
        let fragments = rasterize(tape.leaf(&clip), &mesh, Size { width: 90, height: 80 }).unwrap();
        let (coverage, candidates) = (&*fragments.coverage, &Workbench::default());
        let search = Search { coverage, clip: clip.data(), candidates };
        let mut found = Vec::new();
        search.find(0..coverage.centers.slots.len(), &mut found);
        let of_borders = found.iter().filter(|found| !found.fragments.contains(&MISSING));
        assert!(of_borders.clone().count() > 4 * count);
        assert!(of_borders.into_iter().all(|found| found.blend.covers_first));
    }
}
