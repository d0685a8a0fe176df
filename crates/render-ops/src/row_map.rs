//! Maps of rows: the loops of operations in which no row knows of another.
//!
//! Rows are formed in [`Scalar::Wide`] and rounded once. Work is cut by numbers of rows, and sums over rows are
//! merged in the order of the pieces. A row that is `None` is 0, and adds nothing.

use bokashi_core::parallel::{for_each_piece_mut, merge_ranges, write_each};
use bokashi_core::{Accumulator, Scalar};

/// Rows in one piece of work, where nothing is summed.
const ROWS_PER_PIECE: usize = 1 << 12;

/// Writes `row(k)` to row k of `out: [.., N]`.
#[inline(always)]
pub(crate) fn map_rows<T: Scalar, const N: usize>(
    out: &mut [T],
    row: impl Fn(usize) -> Option<[T::Wide; N]> + Send + Sync,
) {
    write_each(out.as_chunks_mut::<N>().0, ROWS_PER_PIECE, |k| {
        row(k).map_or([T::ZERO; N], |row| row.map(T::narrow))
    });
}

/// Adds `row(k)` to row k of `gradient: [.., N]`.
#[inline(always)]
pub(crate) fn add_rows<T: Scalar, const N: usize>(
    gradient: &mut Accumulator<T>,
    row: impl Fn(usize) -> Option<[T::Wide; N]> + Send + Sync,
) {
    for_each_piece_mut(gradient.entries(), N * ROWS_PER_PIECE, |piece, entries| {
        for (k, entries) in entries.as_chunks_mut::<N>().0.iter_mut().enumerate() {
            let Some(row) = row(piece * ROWS_PER_PIECE + k) else { continue };
            for i in 0..N {
                entries[i] += T::narrow(row[i]);
            }
        }
    });
}

/// The sum of `row(k)` over all k below `count`, in pieces of `rows_per_piece`.
#[inline(always)]
pub(crate) fn sum_rows<T: Scalar, const N: usize>(
    count: usize,
    rows_per_piece: usize,
    row: impl Fn(usize) -> Option<[T::Wide; N]> + Send + Sync,
) -> [T::Wide; N] {
    let mut total = [T::Wide::ZERO; N];
    let piece = |range: std::ops::Range<usize>| {
        let mut sums = [T::Wide::ZERO; N];
        for k in range {
            let Some(terms) = row(k) else { continue };
            for i in 0..N {
                sums[i] += terms[i];
            }
        }
        sums
    };
    merge_ranges(count, rows_per_piece, piece, |sums: [T::Wide; N]| {
        total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
    });
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_is_written_or_summed_once_and_none_is_zero() {
        let count = 2 * ROWS_PER_PIECE + 5;
        let row = |k: usize| (!k.is_multiple_of(3)).then_some([k as f64, 1.0]);
        let mut out = vec![f64::NAN; 2 * count];
        map_rows::<f64, 2>(&mut out, row);
        for (k, out) in out.chunks(2).enumerate() {
            assert_eq!(out, row(k).unwrap_or_default());
        }
        let columns = [0, 1].map(|c| out.iter().skip(c).step_by(2).sum::<f64>());
        assert_eq!(sum_rows::<f64, 2>(count, 1000, row), columns);
    }
}
