//! A plane of depths: what the pixels of a band see of one layer.

use std::ops::Range;

use super::filter::{EIGHT, EMPTY};
use crate::run_reader::NO_FACE;

/// Rows that lie a multiple of so many numbers apart share places in a core's cache: they get a sixteenth more.
const NUMBERS_APART: usize = 256;

/// The nearest depth per pixel of a band so far, as the filter has it, and the position of its face among those of the
/// band.
#[derive(Debug, Default)]
pub(super) struct Plane {
    /// The width of the image that it was made for.
    width: usize,
    /// Pixels from a row to the next, with room to write seven beyond the width.
    pub(super) stride: usize,
    pub(super) depths: Vec<f32>,
    pub(super) faces: Vec<u32>,
    /// Per row: the columns, first and end, that were reached.
    pub(super) reached: Vec<[usize; 2]>,
    /// The columns, first and end, that small faces reached in any row.
    pub(super) reached_by_small: [usize; 2],
}

/// No columns, first and end.
const NONE: [usize; 2] = [usize::MAX, 0];

impl Plane {
    /// Makes it one of this many columns and rows. It stays as it is where it was one, with nothing drawn.
    pub(super) fn fit(&mut self, width: usize, rows: usize) {
        if self.width != width || self.reached.len() != rows {
            *self = Self::new(width, rows);
        }
    }

    /// One with nothing drawn.
    pub(super) fn new(width: usize, rows: usize) -> Self {
        let stride = (width + EIGHT - 1).next_multiple_of(EIGHT);
        let is_bad = stride.is_multiple_of(NUMBERS_APART);
        let stride = if is_bad { stride + NUMBERS_APART / 16 } else { stride };
        Self {
            width,
            stride,
            depths: vec![EMPTY; rows * stride],
            faces: vec![NO_FACE; rows * stride],
            reached: vec![NONE; rows],
            reached_by_small: NONE,
        }
    }

    /// Whether no pixel was reached.
    pub(super) fn is_empty(&self) -> bool {
        let [first, end] = self.reached_by_small;
        first >= end && self.reached.iter().all(|[first, end]| first >= end)
    }

    /// The columns of a row, first and end, that were reached; from then on only small faces reached any.
    #[inline(always)]
    pub(super) fn take_reached(&mut self, row: usize) -> [usize; 2] {
        let [first, end] = std::mem::replace(&mut self.reached[row], NONE);
        let [first_of_small, end_of_small] = self.reached_by_small;
        [first.min(first_of_small), end.max(end_of_small).min(self.width)]
    }

    /// Reaches columns, first and end, of a row.
    #[inline(always)]
    pub(super) fn reach(&mut self, row: usize, [first, end]: [usize; 2]) {
        let reached = &mut self.reached[row];
        *reached = [reached[0].min(first), reached[1].max(end)];
    }

    /// Reaches columns, first and end, of any row.
    #[inline(always)]
    pub(super) fn reach_by_small(&mut self, [first, end]: [usize; 2]) {
        let reached = &mut self.reached_by_small;
        *reached = [reached[0].min(first), reached[1].max(end)];
    }

    /// The place of some columns of a row.
    #[inline(always)]
    pub(super) fn pixels(&self, row: usize, [first, end]: [usize; 2]) -> Range<usize> {
        row * self.stride + first..row * self.stride + end
    }

    /// The depths and faces of a row.
    #[inline(always)]
    pub(super) fn row(&mut self, row: usize) -> (&mut [f32], &mut [u32]) {
        let pixels = self.pixels(row, [0, self.width]);
        (&mut self.depths[pixels.clone()], &mut self.faces[pixels])
    }

    /// Forgets some columns of a row.
    #[inline(always)]
    pub(super) fn forget(&mut self, row: usize, columns: [usize; 2]) {
        let pixels = self.pixels(row, columns);
        self.depths[pixels.clone()].fill(EMPTY);
        self.faces[pixels].fill(NO_FACE);
    }

    /// Forgets the first `rows` rows.
    pub(super) fn forget_rows(&mut self, rows: usize) {
        for row in 0..rows {
            let [first, end] = self.take_reached(row);
            if first < end {
                self.forget(row, [first, end]);
            }
        }
        self.reached_by_small = NONE;
    }
}
