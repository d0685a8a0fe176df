//! Neighbouring pixels that see different faces, at least one of them a face with a silhouette that
//! runs across the direction from one pixel to the other.
//!
//! Each run of such a face is held against its neighbours on two sides or on all four; within a run
//! there are no pairs. So the cost is that of these runs and of the pairs, not of the pixels. Runs lie in memory
//! by face, so those of a row are written down first, side by side, once for both rows beside it.

use std::ops::Range;

use crate::coverage::Coverage;
use crate::runs::Run;
use crate::size::Size;

/// What a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct SeenFace {
    pub(super) slot: u32,
    pub(super) face: u32,
    pub(super) fragment: u32,
}

/// A pixel and its right or its lower neighbour, which see different faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) row: usize,
    pub(super) column: usize,
    /// Whether the other pixel lies below, not on the right.
    pub(super) below: bool,
    /// What they see, where they are covered.
    pub(super) seen: [Option<SeenFace>; 2],
}

impl Pair {
    /// Both pixels.
    pub(super) fn pixels(&self, size: Size) -> [usize; 2] {
        let pixel = self.row * size.width + self.column;
        [pixel, pixel + if self.below { size.width } else { 1 }]
    }
}

/// The pairs for which a face counts: those of pixels beside each other, and those of pixels below each
/// other.
pub(super) type Directions = u8;
pub(super) const BESIDE: Directions = 1;
pub(super) const BELOW: Directions = 2;

/// A run in its row, and what is asked about it.
#[derive(Debug, Clone)]
struct RowRun {
    slot: u32,
    face: u32,
    /// The first fragment.
    fragment: u32,
    columns: Range<u32>,
    counts: Directions,
}

impl RowRun {
    /// At `column`, a column of its own.
    #[inline(always)]
    fn seen(&self, column: u32) -> SeenFace {
        let fragment = self.fragment + column - self.columns.start;
        SeenFace { slot: self.slot, face: self.face, fragment }
    }

    #[inline(always)]
    fn counts(&self, directions: Directions) -> bool {
        self.counts & directions != 0
    }
}

/// Two neighbouring rows: memory.
#[derive(Debug, Default)]
pub(super) struct Rows {
    upper: Vec<RowRun>,
    lower: Vec<RowRun>,
}

/// Writes down the runs of a row; the directions in which any of them counts. `face_of` tells the face of a
/// slot, and its directions.
#[inline(always)]
fn read(
    coverage: &Coverage,
    row: usize,
    face_of: impl Fn(usize) -> (u32, Directions),
    runs: &mut Vec<RowRun>,
) -> Directions {
    let before = (row * coverage.size().width) as u32;
    let mut any = 0;
    runs.clear();
    runs.extend(coverage.runs_in_row(row).map(|&run| {
        let Run { slot, pixel, length, fragment } = run;
        let (face, counts) = face_of(slot as usize);
        any |= counts;
        let start = pixel - before;
        RowRun { slot, face, fragment, columns: start..start + length, counts }
    }));
    any
}

impl Rows {
    /// Calls `visit` once with each pair whose first pixel lies in `rows` and of which one pixel sees
    /// a slot that counts in its direction; `face_of` tells the face of a slot, and its directions.
    #[inline(always)]
    pub(super) fn for_each_pair(
        &mut self,
        coverage: &Coverage,
        rows: Range<usize>,
        face_of: impl Fn(usize) -> (u32, Directions),
        mut visit: impl FnMut(Pair),
    ) {
        let Self { upper, lower } = self;
        let Size { width, height } = coverage.size();
        let mut any = read(coverage, rows.start, &face_of, upper);
        for row in rows {
            if any & BESIDE != 0 {
                for_each_beside(upper, row, width as u32, &mut visit);
            }
            if row + 1 == height {
                return;
            }
            let any_below = read(coverage, row + 1, &face_of, lower);
            let mut pair = |column: u32, seen| {
                visit(Pair { row, column: column as usize, below: true, seen });
            };
            // Which of the two walks finds a pair does not depend on `BELOW`: the order of blends, and
            // of all sums over them, is the same as if all pairs were visited.
            if (any | any_below) & BELOW != 0 {
                for_each_overlap(upper, lower, BESIDE | BELOW, |columns, run, below| {
                    let is_edge = below.is_none_or(|below| below.face != run.face);
                    if is_edge && (run.counts(BELOW) || below.is_some_and(|it| it.counts(BELOW))) {
                        columns.for_each(|column| {
                            pair(
                                column,
                                [Some(run), below].map(|run| run.map(|run| run.seen(column))),
                            )
                        });
                    }
                });
            }
            if any_below & BELOW != 0 {
                for_each_overlap(lower, upper, BELOW, |columns, run, above| {
                    if above.is_none_or(|above| above.face != run.face && above.counts == 0) {
                        columns.for_each(|column| {
                            pair(
                                column,
                                [above, Some(run)].map(|run| run.map(|run| run.seen(column))),
                            )
                        });
                    }
                });
            }
            std::mem::swap(upper, lower);
            any = any_below;
        }
    }
}

/// Calls `visit` with the pairs of neighbours in a row.
#[inline(always)]
fn for_each_beside(runs: &[RowRun], row: usize, width: u32, visit: &mut impl FnMut(Pair)) {
    let pair = |column: u32, left: Option<&RowRun>, right: Option<&RowRun>| {
        let seen = [left.map(|run| run.seen(column)), right.map(|run| run.seen(column + 1))];
        Pair { row, column: column as usize, below: false, seen }
    };
    for (index, run) in runs.iter().enumerate().filter(|(_, run)| run.counts(BESIDE)) {
        let Range { start, end } = run.columns;
        if start > 0 {
            let left = index
                .checked_sub(1)
                .map(|index| &runs[index])
                .filter(|run| run.columns.end == start);
            if left.is_none_or(|left| !left.counts(BESIDE)) {
                visit(pair(start - 1, left, Some(run)));
            }
        }
        if end < width {
            let right = runs.get(index + 1).filter(|run| run.columns.start == end);
            visit(pair(end - 1, Some(run), right));
        }
    }
}

/// Cuts each run of `runs` that counts in one of `directions` into stretches of columns at which the row
/// `other_runs` sees one face, or none.
#[inline(always)]
fn for_each_overlap(
    runs: &[RowRun],
    mut other_runs: &[RowRun],
    directions: Directions,
    mut visit: impl FnMut(Range<u32>, &RowRun, Option<&RowRun>),
) {
    for run in runs.iter().filter(|run| run.counts(directions)) {
        let Range { mut start, end } = run.columns;
        while start < end {
            let Some((other, others)) = other_runs.split_first() else {
                visit(start..end, run, None);
                break;
            };
            let columns = &other.columns;
            if columns.end <= start {
                other_runs = others;
                continue;
            }
            // It lies around the first column, or begins after it.
            let (seen, stop) = match columns.start <= start {
                true => (Some(other), columns.end),
                false => (None, columns.start),
            };
            let stop = stop.min(end);
            visit(start..stop, run, seen);
            start = stop;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use bokashi_core::{Tape, Tensor};
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;

    /// All pairs of different faces, at least one of those in `counting` for pairs of that kind, by
    /// looking at each pixel.
    fn expected(coverage: &Coverage, counting: &[BTreeSet<usize>; 2]) -> BTreeSet<(usize, bool)> {
        let Size { width, height } = coverage.size();
        let mut pairs = BTreeSet::new();
        for pixel in 0..width * height {
            for (below, step) in [(false, 1), (true, width)] {
                let is_last =
                    if below { pixel / width + 1 == height } else { pixel % width + 1 == width };
                if is_last {
                    continue;
                }
                let faces = [pixel, pixel + step].map(|pixel| coverage.face_at(pixel));
                let counting = &counting[usize::from(below)];
                let counts = faces.iter().flatten().any(|face| counting.contains(face));
                if faces[0] != faces[1] && counts {
                    pairs.insert((pixel, below));
                }
            }
        }
        pairs
    }

    proptest! {
        #[test]
        fn every_pair_is_visited_once(
            corners in proptest::collection::vec((-1.5..1.5, -1.5..1.5, -0.5..0.5), 12),
            width in 1_usize..12,
            height in 1_usize..12,
            beside in proptest::collection::btree_set(0_usize..4, 0..4),
            below in proptest::collection::btree_set(0_usize..4, 0..4),
        ) {
            let tape = Tape::<f64>::new();
            let clip = corners.iter().flat_map(|&(x, y, z)| [x, y, z, 1.0]).collect();
            let clip = tape.leaf(&Tensor::new([12, 4], clip).unwrap());
            let mesh = Mesh::new((0..4).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), 12);
            let fragments = rasterize(clip, &mesh.unwrap(), Size { width, height }).unwrap();
            let coverage = &fragments.coverage;
            let counting = [beside, below];
            let seen = |slot: usize| {
                let face = coverage.centers.face(slot);
                let [beside, below] = counting.each_ref().map(|kind| u8::from(kind.contains(&face)));
                (face as u32, (beside * BESIDE) | (below * BELOW))
            };
            let mut found = BTreeSet::new();
            Rows::default().for_each_pair(coverage, 0..height, seen, |pair| {
                let pixels = pair.pixels(coverage.size());
                for (seen, pixel) in pair.seen.into_iter().zip(pixels) {
                    assert_eq!(seen.map(|seen| seen.face as usize), coverage.face_at(pixel));
                    let fragment = seen.map(|seen| seen.fragment as usize);
                    assert_eq!(fragment, coverage.fragment_at(pixel));
                    let slot = seen.map(|seen| coverage.centers.face(seen.slot as usize));
                    assert_eq!(slot, coverage.face_at(pixel));
                }
                assert!(found.insert((pixels[0], pair.below)), "{pair:?} twice");
            });
            prop_assert_eq!(found, expected(coverage, &counting));
        }
    }
}
