//! Work cut into pieces of a fixed size, whatever the number of threads.
//!
//! Pieces are cut by size alone and results are merged in the order of the pieces, so every result
//! is bitwise the same for any number of threads. Work of a single piece never enters the thread
//! pool: at 32x32 pixels entering it costs more than the work.

use std::ops::Range;

#[cfg(feature = "parallel")]
use rayon::prelude::*;

/// Entries in one piece of cheap elementwise work: a few microseconds, many times the cost of
/// handing a piece to another thread.
pub const ENTRIES_PER_PIECE: usize = 1 << 14;

/// Calls `work(k, piece)` for each piece of `piece` entries of `data`, the last one perhaps
/// shorter; pieces may run at the same time.
pub fn for_each_piece_mut<T: Send>(
    data: &mut [T],
    piece: usize,
    work: impl Fn(usize, &mut [T]) + Send + Sync,
) {
    #[cfg(feature = "parallel")]
    if data.len() > piece && rayon::current_num_threads() > 1 {
        data.par_chunks_mut(piece).enumerate().for_each(|(k, chunk)| work(k, chunk));
        return;
    }
    data.chunks_mut(piece).enumerate().for_each(|(k, chunk)| work(k, chunk));
}

/// Calls `work(item, k)` on each item; items may run at the same time.
pub fn for_each_item_mut<T: Send>(items: &mut [T], work: impl Fn(usize, &mut T) + Send + Sync) {
    for_each_piece_mut(items, 1, |k, item| work(k, &mut item[0]));
}

/// `work(range)` of each range of `piece` indices of `0..length`, in the order of the ranges.
pub fn map_ranges<R: Send>(
    length: usize,
    piece: usize,
    work: impl Fn(Range<usize>) -> R + Send + Sync,
) -> Vec<R> {
    let range = |k: usize| k * piece..((k + 1) * piece).min(length);
    let pieces = length.div_ceil(piece);
    #[cfg(feature = "parallel")]
    if pieces > 1 && rayon::current_num_threads() > 1 {
        return (0..pieces).into_par_iter().map(|k| work(range(k))).collect();
    }
    (0..pieces).map(|k| work(range(k))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_cover_everything_once_and_in_order() {
        for length in [0, 1, 9, 10, 11, 100] {
            let ranges = map_ranges(length, 10, |range| range);
            let covered: Vec<usize> = ranges.into_iter().flatten().collect();
            assert_eq!(covered, (0..length).collect::<Vec<_>>());

            let mut data = vec![0; length];
            for_each_piece_mut(&mut data, 10, |k, piece| {
                piece.iter_mut().enumerate().for_each(|(i, entry)| *entry += 10 * k + i);
            });
            assert_eq!(data, (0..length).collect::<Vec<_>>());
        }
    }
}
