//! Rows of numbers in blocks: number by number on the stack, for vectors, and back.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::join;

/// Rows of a block.
pub(super) const BLOCK: usize = 64;

/// Rows in one piece of work.
pub(super) const PIECE: usize = 32 * BLOCK;

/// `K` numbers of each row of a block.
pub(super) type Lanes<T, const K: usize> = [[T; BLOCK]; K];

/// The numbers of a row.
#[inline(always)]
pub(super) fn row<T: Copy, const K: usize>(lanes: &Lanes<T, K>, k: usize) -> [T; K] {
    std::array::from_fn(|i| lanes[i][k])
}

/// Sets the numbers of a row.
#[inline(always)]
pub(super) fn set_row<T: Copy, const K: usize>(lanes: &mut Lanes<T, K>, k: usize, row: [T; K]) {
    for i in 0..K {
        lanes[i][k] = row[i];
    }
}

/// Adds to the numbers of a row.
#[inline(always)]
pub(super) fn add_row<T: Scalar, const K: usize>(lanes: &mut Lanes<T, K>, k: usize, row: [T; K]) {
    for i in 0..K {
        lanes[i][k] += row[i];
    }
}

/// Numbers `[N, width]` of rows, or `[width]` of all rows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column<'a, T> {
    pub(super) entries: &'a [T],
    pub(super) width: usize,
    pub(super) is_uniform: bool,
}

impl<T: Scalar> Column<'_, T> {
    /// Loads the numbers of `rows`; rows beyond their end are as the last of them.
    #[inline(always)]
    pub(super) fn load(&self, rows: &Range<usize>, lanes: &mut [[T; BLOCK]]) {
        let width = self.width;
        if self.is_uniform {
            for (lane, &entry) in lanes.iter_mut().zip(self.entries) {
                lane.fill(entry);
            }
            return;
        }
        let entries = &self.entries[rows.start * width..rows.end * width];
        match (lanes, rows.len()) {
            ([x, y, z], BLOCK) => {
                let entries: &[[T; 3]] = entries.as_chunks().0;
                let entries: &[[T; 3]; BLOCK] = entries.first_chunk().expect("a whole block");
                for k in 0..BLOCK {
                    x[k] = entries[k][0];
                    y[k] = entries[k][1];
                    z[k] = entries[k][2];
                }
            }
            ([x], BLOCK) => x.copy_from_slice(entries),
            (lanes, count) => {
                for k in 0..BLOCK {
                    let at = k.min(count - 1) * width;
                    for (lane, &entry) in lanes.iter_mut().zip(&entries[at..at + width]) {
                        lane[k] = entry;
                    }
                }
            }
        }
    }
}

/// Adds the numbers of a block's rows to `entries`, or writes them where these are fresh.
#[inline(always)]
pub(super) fn store<T: Scalar>(lanes: &[[T; BLOCK]], entries: &mut [T], is_fresh: bool) {
    let width = lanes.len();
    match (lanes, entries.len() / width) {
        ([x, y, z], BLOCK) => {
            let entries: &mut [[T; 3]] = entries.as_chunks_mut().0;
            let entries: &mut [[T; 3]; BLOCK] = entries.first_chunk_mut().expect("a whole block");
            if is_fresh {
                for k in 0..BLOCK {
                    entries[k] = [x[k], y[k], z[k]];
                }
            } else {
                for k in 0..BLOCK {
                    entries[k] = [entries[k][0] + x[k], entries[k][1] + y[k], entries[k][2] + z[k]];
                }
            }
        }
        _ => {
            for (k, entries) in entries.chunks_exact_mut(width).enumerate() {
                for (entry, lane) in entries.iter_mut().zip(lanes) {
                    *entry = if is_fresh { lane[k] } else { *entry + lane[k] };
                }
            }
        }
    }
}

/// The most gradients of rows that are written at the same time.
pub(super) const MOST_PARTS: usize = 6;

/// What is written for some rows: per part its numbers, `width` a row; and the sums of each piece,
/// `width` of them as well.
#[derive(Debug)]
pub(super) struct Written<'a, T: Scalar> {
    pub(super) parts: [(usize, &'a mut [T]); MOST_PARTS],
    pub(super) sums: (usize, &'a mut [T::Wide]),
}

impl<'a, T: Scalar> Written<'a, T> {
    /// The first `pieces` pieces, and all others.
    fn split(self, pieces: usize) -> (Self, Self) {
        let mut later: [(usize, &mut [T]); MOST_PARTS] = Default::default();
        let mut at = 0;
        let parts = self.parts.map(|(width, entries)| {
            let (first, second) = entries.split_at_mut((pieces * PIECE * width).min(entries.len()));
            later[at] = (width, second);
            at += 1;
            (width, first)
        });
        let (width, sums) = self.sums;
        let (first, second) = sums.split_at_mut(pieces * width);
        (Self { parts, sums: (width, first) }, Self { parts: later, sums: (width, second) })
    }
}

/// Calls `work` for each piece of `rows`, which begin with a piece; pieces may run at the same time.
pub(super) fn for_each_piece<T: Scalar>(
    rows: Range<usize>,
    written: Written<'_, T>,
    work: &(impl Fn(Range<usize>, Written<'_, T>) + Sync),
) {
    let pieces = rows.len().div_ceil(PIECE);
    if pieces <= 1 {
        if pieces == 1 {
            work(rows, written);
        }
        return;
    }
    let middle = rows.start + pieces / 2 * PIECE;
    let (first, second) = written.split(pieces / 2);
    join(
        || for_each_piece(rows.start..middle, first, work),
        || for_each_piece(middle..rows.end, second, work),
    );
}
