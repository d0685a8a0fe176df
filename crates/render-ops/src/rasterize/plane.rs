//! A plane of depths: what the pixels of a band see of one layer.

use std::ops::Range;

use bokashi_core::Scalar;

use super::prepared::Prepared;
use super::setup::{LANES, beyond};

/// Stands for "no face".
pub(super) const NO_FACE: u64 = u64::MAX;

/// The nearest depth per pixel of a band so far, and the position of its face among those that were drawn.
#[derive(Debug)]
pub(super) struct Plane<S> {
    /// The width of the image that it was made for.
    width: usize,
    /// Blocks from a row to the next.
    per_row: usize,
    /// In blocks, row by row.
    pub(super) depths: Vec<[S; LANES]>,
    /// In as many bits, so that both fit the same vectors.
    pub(super) faces: Vec<[u64; LANES]>,
    /// Per row: the columns, first and end, that were reached.
    pub(super) reached: Vec<[usize; 2]>,
    /// The blocks of a row, first and end, that small faces reached in any row.
    pub(super) reached_by_blocks: [usize; 2],
}

impl<S> Default for Plane<S> {
    fn default() -> Self {
        let (depths, faces, reached) = Default::default();
        Self { width: 0, per_row: 0, depths, faces, reached, reached_by_blocks: [usize::MAX, 0] }
    }
}

impl<S: Scalar<Wide = S>> Plane<S> {
    /// Makes it one for the bands of `view`. It stays as it is where it was one, with nothing drawn.
    pub(super) fn fit<T: Scalar<Wide = S>>(&mut self, view: &Prepared<'_, T>) {
        // As many blocks are not enough: what was drawn beyond the width is never forgotten.
        if self.width != view.size.width || self.reached.len() != view.rows {
            *self = Self::new(view.size.width, view.rows, view.blocks_per_row());
        }
    }

    /// One with nothing drawn.
    pub(super) fn new(width: usize, rows: usize, per_row: usize) -> Self {
        let blocks = rows * per_row;
        Self {
            width,
            per_row,
            depths: vec![[beyond(); LANES]; blocks],
            faces: vec![[NO_FACE; LANES]; blocks],
            reached: vec![[width, 0]; rows],
            ..Self::default()
        }
    }

    /// Whether no pixel was reached.
    pub(super) fn is_empty(&self) -> bool {
        let [first, end] = self.reached_by_blocks;
        first >= end && self.reached.iter().all(|[first, end]| first >= end)
    }

    /// The columns of a row, first and end, that were reached; from then on none was.
    #[inline(always)]
    pub(super) fn take_reached(&mut self, row: usize) -> [usize; 2] {
        let [first, end] = std::mem::replace(&mut self.reached[row], [self.width, 0]);
        let [first_block, end_block] = self.reached_by_blocks;
        let first = first.min(first_block.saturating_mul(LANES));
        [first, end.max((end_block * LANES).min(self.width))]
    }

    /// The blocks that hold some columns of a row, first and end.
    #[inline(always)]
    pub(super) fn blocks(&self, row: usize, [first, end]: [usize; 2]) -> Range<usize> {
        let before = row * self.per_row;
        before + first / LANES..before + end.div_ceil(LANES)
    }

    /// The depths and faces of a row, and what was reached there.
    #[inline(always)]
    pub(super) fn row(&mut self, row: usize) -> (&mut [S], &mut [u64], &mut [usize; 2]) {
        let blocks = self.blocks(row, [0, self.width]);
        let (depths, faces) = (&mut self.depths[blocks.clone()], &mut self.faces[blocks]);
        (depths.as_flattened_mut(), faces.as_flattened_mut(), &mut self.reached[row])
    }

    /// Forgets the first `rows` rows.
    pub(super) fn forget(&mut self, rows: usize) {
        for row in 0..rows {
            let [first, end] = self.take_reached(row);
            if first < end {
                let (depths, faces, _) = self.row(row);
                depths[first..end].fill(beyond());
                faces[first..end].fill(NO_FACE);
            }
        }
        self.reached_by_blocks = [usize::MAX, 0];
    }
}
