//! Neighbouring pixels that see different faces.
//!
//! Within a run there are none, so the runs of a row, and those of the row below, are walked side
//! by side: the cost is that of the runs and of the pairs, not of the pixels.

use std::iter::Peekable;
use std::ops::Range;

use crate::coverage::{Coverage, Span};
use crate::size::Size;

/// A pixel and its right or its lower neighbour, which see different faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) pixel: usize,
    /// Whether the other pixel is the one below, not the one on the right.
    pub(super) below: bool,
    /// The slots of the faces, where the pixels are covered.
    pub(super) slots: [Option<usize>; 2],
}

impl Pair {
    /// Both pixels.
    pub(super) fn pixels(&self, size: Size) -> [usize; 2] {
        [self.pixel, self.pixel + if self.below { size.width } else { 1 }]
    }
}

/// Calls `visit` with each pair whose first pixel lies in `rows`: row by row, side by side first,
/// then one below the other, from the left.
pub(super) fn for_each_pair(coverage: &Coverage, rows: Range<usize>, mut visit: impl FnMut(Pair)) {
    let Size { width, height } = coverage.size();
    for row in rows {
        let start = row * width;
        side_by_side(coverage, row, start, start + width, &mut visit);
        if row + 1 < height {
            one_below(coverage, row, start, width, &mut visit);
        }
    }
}

/// The pairs along a row of the pixels from `start` to before `end`.
#[inline]
fn side_by_side(
    coverage: &Coverage,
    row: usize,
    start: usize,
    end: usize,
    visit: &mut impl FnMut(Pair),
) {
    let mut before: Option<Span> = None;
    let mut pair = |pixel, slots| visit(Pair { pixel, below: false, slots });
    for span in coverage.row(row) {
        let slot = Some(span.slot);
        match before {
            Some(before) if before.pixels().end == span.pixel => {
                pair(span.pixel - 1, [Some(before.slot), slot]);
            }
            _ => {
                if let Some(before) = before {
                    pair(before.pixels().end - 1, [Some(before.slot), None]);
                }
                if span.pixel > start {
                    pair(span.pixel - 1, [None, slot]);
                }
            }
        }
        before = Some(span);
    }
    if let Some(last) = before.filter(|last| last.pixels().end < end) {
        pair(last.pixels().end - 1, [Some(last.slot), None]);
    }
}

/// The pairs of a row, whose first pixel is `start`, and the one below.
#[inline]
fn one_below(
    coverage: &Coverage,
    row: usize,
    start: usize,
    width: usize,
    visit: &mut impl FnMut(Pair),
) {
    let mut upper = Cursor { spans: coverage.row(row).peekable() };
    let mut lower = Cursor { spans: coverage.row(row + 1).peekable() };
    let mut pixel = start;
    while pixel < start + width {
        let (above, above_end) = upper.at(pixel, start + width);
        let (below, below_end) = lower.at(pixel + width, start + 2 * width);
        let end = above_end.min(below_end - width);
        if above.map(|seen| seen.face) != below.map(|seen| seen.face) {
            let slots = [above, below].map(|seen| seen.map(|seen| seen.slot));
            for pixel in pixel..end {
                visit(Pair { pixel, below: true, slots });
            }
        }
        pixel = end;
    }
}

/// What pixels see.
#[derive(Debug, Clone, Copy)]
struct Seen {
    slot: usize,
    face: usize,
}

/// A walk along the runs of a row.
struct Cursor<I: Iterator<Item = Span>> {
    spans: Peekable<I>,
}

impl<I: Iterator<Item = Span>> Cursor<I> {
    /// What `pixel` sees, if anything, and where the run, or the gap, ends. Pixels come in order.
    #[inline]
    fn at(&mut self, pixel: usize, row_end: usize) -> (Option<Seen>, usize) {
        while self.spans.next_if(|span| span.pixels().end <= pixel).is_some() {}
        match self.spans.peek() {
            None => (None, row_end),
            Some(span) if pixel < span.pixel => (None, span.pixel),
            Some(span) => {
                (Some(Seen { slot: span.slot, face: span.face }), span.pixels().end)
            }
        }
    }
}
