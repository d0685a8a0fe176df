//! Neighbouring pixels that see different faces, at least one of them a face with a silhouette.
//!
//! Row by row: its runs are held against each other, and against those of the row below. Within a
//! run there are no pairs, so the cost is that of the runs and of the pairs, not of the pixels.

use std::ops::Range;

use crate::coverage::{Coverage, Span};
use crate::size::Size;

/// What a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Seen {
    pub(super) slot: usize,
    pub(super) face: usize,
    pub(super) fragment: usize,
}

impl Seen {
    /// At `pixel`, one of `span`.
    fn of(span: &Span, pixel: usize) -> Self {
        let fragment = span.fragments.start + pixel - span.pixel;
        Self { slot: span.slot, face: span.face, fragment }
    }
}

/// A pixel and its right or its lower neighbour, which see different faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) pixel: usize,
    /// Whether the other pixel is the one below, not the one on the right.
    pub(super) below: bool,
    /// What they see, where they are covered.
    pub(super) seen: [Option<Seen>; 2],
}

impl Pair {
    /// Both pixels.
    pub(super) fn pixels(&self, size: Size) -> [usize; 2] {
        [self.pixel, self.pixel + if self.below { size.width } else { 1 }]
    }
}

/// Calls `visit` once with each pair whose first pixel lies in `rows` and of which at least one
/// sees a slot that `counts`.
pub(super) fn for_each_pair(
    coverage: &Coverage,
    rows: Range<usize>,
    counts: impl Fn(usize) -> bool,
    mut visit: impl FnMut(Pair),
) {
    let Size { width, height } = coverage.size();
    let counts = |span: Option<&Span>| span.is_some_and(|span| counts(span.slot));
    for row in rows {
        let mut pair_up = |first: Option<&Span>, second: Option<&Span>, pixel: usize| {
            if counts(first) || counts(second) {
                let seen = [
                    first.map(|span| Seen::of(span, pixel)),
                    second.map(|span| Seen::of(span, pixel + 1)),
                ];
                visit(Pair { pixel, below: false, seen });
            }
        };
        let mut before: Option<Span> = None;
        for span in coverage.row(row) {
            match &before {
                Some(other) if other.pixels().end == span.pixel => {
                    pair_up(before.as_ref(), Some(&span), span.pixel - 1);
                }
                other => {
                    if let Some(other) = other {
                        pair_up(before.as_ref(), None, other.pixels().end - 1);
                    }
                    if span.pixel > row * width {
                        pair_up(None, Some(&span), span.pixel - 1);
                    }
                }
            }
            before = Some(span);
        }
        if let Some(last) = before.filter(|span| span.pixels().end < (row + 1) * width) {
            pair_up(Some(&last), None, last.pixels().end - 1);
        }
        if row + 1 < height {
            for_each_stretch(coverage, row, |stretch, upper, lower| {
                let is_same = upper.map(|span| span.face) == lower.map(|span| span.face);
                if is_same || !(counts(upper) || counts(lower)) {
                    return;
                }
                for pixel in stretch {
                    let seen = [
                        upper.map(|span| Seen::of(span, pixel)),
                        lower.map(|span| Seen::of(span, pixel + width)),
                    ];
                    visit(Pair { pixel, below: true, seen });
                }
            });
        }
    }
}

/// Cuts the pixels of `row` into stretches above each of which and below each of which there is one
/// run or none, not none twice.
#[inline]
fn for_each_stretch(
    coverage: &Coverage,
    row: usize,
    mut visit: impl FnMut(Range<usize>, Option<&Span>, Option<&Span>),
) {
    let width = coverage.size().width;
    let (mut uppers, mut lowers) = (coverage.row(row), coverage.row(row + 1));
    let (mut upper, mut lower) = (uppers.next(), lowers.next());
    let mut start = 0;
    // The pixels of a run, as those of the upper row; beyond the last run there is nothing.
    let own = |span: &Option<Span>, down: usize| {
        let pixels = span.as_ref().map_or(usize::MAX..usize::MAX, Span::pixels);
        pixels.start.saturating_sub(down)..pixels.end.saturating_sub(down)
    };
    while upper.is_some() || lower.is_some() {
        let (above, below) = (own(&upper, 0), own(&lower, width));
        start = start.max(above.start.min(below.start));
        let next = |pixels: &Range<usize>| {
            if start < pixels.start { pixels.start } else { pixels.end }
        };
        let end = next(&above).min(next(&below));
        let at = |pixels: &Range<usize>| pixels.start <= start;
        visit(
            start..end,
            upper.as_ref().filter(|_| at(&above)),
            lower.as_ref().filter(|_| at(&below)),
        );
        start = end;
        if above.end == end {
            upper = uppers.next();
        }
        if below.end == end {
            lower = lowers.next();
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
                    assert_eq!(seen.map(|seen| seen.face), coverage.face_at(pixel));
                    assert_eq!(seen.map(|seen| seen.fragment), coverage.fragment_at(pixel));
                    let slot = seen.map(|seen| coverage.slots[seen.slot].face as usize);
                    assert_eq!(slot, coverage.face_at(pixel));
                }
                assert!(found.insert((pair.pixel, pair.below)), "{pair:?} twice");
            });
            prop_assert_eq!(found, expected(coverage, &counting));
        }
    }
}
