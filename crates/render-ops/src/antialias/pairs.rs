//! Neighbouring pixels that see different faces, at least one of them a face with a silhouette.
//!
//! Each run of such a face is held against its neighbours on all four sides; within a run there are
//! no pairs. So the cost is that of these runs and of the pairs, not of the pixels.

use std::ops::Range;

use crate::coverage::{Coverage, Span};
use crate::size::Size;

/// What a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Seen {
    pub(super) slot: u32,
    pub(super) face: u32,
    pub(super) fragment: u32,
}

impl Seen {
    /// At `pixel`, one of `span`.
    #[inline(always)]
    fn of(span: &Span, pixel: usize) -> Self {
        let fragment = span.fragments.start + pixel - span.pixel;
        let [slot, face, fragment] = [span.slot, span.face, fragment].map(|number| number as u32);
        Self { slot, face, fragment }
    }
}

/// A pixel and its right or its lower neighbour, which see different faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) row: usize,
    pub(super) column: usize,
    /// Whether the other pixel is the one below, not the one on the right.
    pub(super) below: bool,
    /// What they see, where they are covered.
    pub(super) seen: [Option<Seen>; 2],
}

impl Pair {
    /// Both pixels.
    pub(super) fn pixels(&self, size: Size) -> [usize; 2] {
        let pixel = self.row * size.width + self.column;
        [pixel, pixel + if self.below { size.width } else { 1 }]
    }
}

/// Calls `visit` once with each pair of which one pixel lies in `rows` and sees a slot that `counts`;
/// of two such pixels it is the first one's row that matters.
pub(super) fn for_each_pair(
    coverage: &Coverage,
    rows: Range<usize>,
    counts: impl Fn(usize) -> bool,
    mut visit: impl FnMut(Pair),
) {
    let Size { width, height } = coverage.size();
    let counts_itself = |span: Option<&Span>| span.is_some_and(|span| counts(span.slot));
    for row in rows {
        let own = coverage.row(row);
        let mut above = row.checked_sub(1).map(|row| Beside::of(coverage, row));
        let mut below = (row + 1 < height).then(|| Beside::of(coverage, row + 1));
        for at in own.clone() {
            let span = coverage.span_in_row(at);
            if !counts(span.slot) {
                continue;
            }
            let pixels = span.pixels();
            let columns = pixels.start - row * width..pixels.end - row * width;
            let seen = |pixel| Some(Seen::of(&span, pixel));
            if columns.start > 0 {
                let other = (at > own.start).then(|| coverage.span_in_row(at - 1));
                let other = other.filter(|other| other.pixels().end == pixels.start);
                if !counts_itself(other.as_ref()) {
                    let column = columns.start - 1;
                    let other = other.map(|other| Seen::of(&other, pixels.start - 1));
                    let seen = [other, seen(pixels.start)];
                    visit(Pair { row, column, below: false, seen });
                }
            }
            if columns.end < width {
                let other = (at + 1 < own.end).then(|| coverage.span_in_row(at + 1));
                let other = other.filter(|other| other.pixel == pixels.end);
                let other = other.map(|other| Seen::of(&other, pixels.end));
                let seen = [seen(pixels.end - 1), other];
                visit(Pair { row, column: columns.end - 1, below: false, seen });
            }
            if let Some(above) = &mut above {
                above.for_each_stretch(columns.clone(), |stretch, other| {
                    let is_own = other.is_some_and(|other| other.face == span.face);
                    if is_own || counts_itself(other) {
                        return;
                    }
                    for column in stretch {
                        let pixel = row * width + column;
                        let seen = [other.map(|other| Seen::of(other, pixel - width)), seen(pixel)];
                        visit(Pair { row: row - 1, column, below: true, seen });
                    }
                });
            }
            if let Some(below) = &mut below {
                below.for_each_stretch(columns, |stretch, other| {
                    if other.is_some_and(|other| other.face == span.face) {
                        return;
                    }
                    for column in stretch {
                        let pixel = row * width + column;
                        let seen = [seen(pixel), other.map(|other| Seen::of(other, pixel + width))];
                        visit(Pair { row, column, below: true, seen });
                    }
                });
            }
        }
    }
}

/// A row that others are held against from left to right.
struct Beside<'a> {
    coverage: &'a Coverage,
    first_pixel: usize,
    /// The runs that are not passed yet.
    runs: Range<usize>,
}

impl<'a> Beside<'a> {
    #[inline(always)]
    fn of(coverage: &'a Coverage, row: usize) -> Self {
        let first_pixel = row * coverage.size().width;
        Self { coverage, first_pixel, runs: coverage.row(row) }
    }

    /// Cuts `columns` into stretches that see one face, or none. They do not start before those of
    /// the call before.
    #[inline(always)]
    fn for_each_stretch(
        &mut self,
        columns: Range<usize>,
        mut visit: impl FnMut(Range<usize>, Option<&Span>),
    ) {
        let Range { mut start, end } = columns;
        while start < end {
            if self.runs.is_empty() {
                return visit(start..end, None);
            }
            let span = self.coverage.span_in_row(self.runs.start);
            let own = span.pixel - self.first_pixel..span.pixels().end - self.first_pixel;
            if own.end <= start {
                self.runs.start += 1;
                continue;
            }
            if start < own.start {
                visit(start..own.start.min(end), None);
            }
            if own.start < end {
                visit(start.max(own.start)..own.end.min(end), Some(&span));
            }
            start = own.end;
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

    /// All pairs of different faces, at least one of those in `counting`, by looking at each pixel.
    fn expected(coverage: &Coverage, counting: &BTreeSet<usize>) -> BTreeSet<(usize, bool)> {
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
            counting in proptest::collection::btree_set(0_usize..4, 0..4),
        ) {
            let tape = Tape::<f64>::new();
            let clip = corners.iter().flat_map(|&(x, y, z)| [x, y, z, 1.0]).collect();
            let clip = tape.leaf(&Tensor::new([12, 4], clip).unwrap());
            let mesh = Mesh::new((0..4).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), 12);
            let fragments = rasterize(clip, &mesh.unwrap(), Size { width, height }).unwrap();
            let coverage = &fragments.coverage;
            let counts: Vec<_> = coverage
                .slots
                .iter()
                .map(|slot| counting.contains(&(slot.face as usize)))
                .collect();
            let mut found = BTreeSet::new();
            for_each_pair(coverage, 0..height, |slot| counts[slot], |pair| {
                let pixels = pair.pixels(coverage.size());
                for (seen, pixel) in pair.seen.into_iter().zip(pixels) {
                    assert_eq!(seen.map(|seen| seen.face as usize), coverage.face_at(pixel));
                    let fragment = seen.map(|seen| seen.fragment as usize);
                    assert_eq!(fragment, coverage.fragment_at(pixel));
                    let slot = seen.map(|seen| coverage.slots[seen.slot as usize].face as usize);
                    assert_eq!(slot, coverage.face_at(pixel));
                }
                assert!(found.insert((pixels[0], pair.below)), "{pair:?} twice");
            });
            prop_assert_eq!(found, expected(coverage, &counting));
        }
    }
}
