//! Affine maps of points, `y_i = M (p_i, 1)` with a matrix M of three rows or four: the loops of operations that
//! multiply points.
//!
//! Backward `p_bar_i = A^T y_bar_i`, with the first three columns A of M, and
//! `M_bar = sum_i y_bar_i (p_i, 1)^T`. Points are summed in pieces of a fixed size, in [`Scalar::Wide`], and
//! pieces in their order.

use bokashi_core::parallel::{for_each_piece_mut, merge_ranges};
use bokashi_core::{Accumulator, Scalar};

use crate::dispatch::dispatch;
use crate::row_map::sum_rows;

/// Points in one piece of work.
// Tests of projections repeat it, so as to have several pieces.
pub(crate) const POINTS_PER_PIECE: usize = 1 << 13;

/// Writes `M (p_i, 1)` for `points: [V, 3]` to `out: [V, N]`.
pub(crate) fn map_points<T: Scalar, const N: usize>(
    matrix: &[[T::Wide; 4]; N],
    points: &[T],
    out: &mut [T],
) {
    let points = points.as_chunks::<3>().0;
    for_each_piece_mut(out, N * POINTS_PER_PIECE, |piece, out| {
        map_piece(matrix, &points[piece * POINTS_PER_PIECE..], out.as_chunks_mut::<N>().0);
    });
}

/// [`map_points`] of one piece.
pub(crate) fn map_piece<T: Scalar, const N: usize>(
    matrix: &[[T::Wide; 4]; N],
    points: &[[T; 3]],
    out: &mut [[T; N]],
) {
    let m = *matrix;
    dispatch::<T, _>(
        #[inline(always)]
        || {
            for (p, out) in points.iter().zip(out) {
                let p = p.map(T::widen);
                for row in 0..N {
                    let m = m[row];
                    out[row] = T::narrow(m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3]);
                }
            }
        },
    );
}

/// Adds `A^T y_bar_i` for gradients `bars: [V, N]` to the gradient of the points.
pub(crate) fn add_points_bar<T: Scalar, const N: usize>(
    matrix: &[[T::Wide; 4]; N],
    bars: &[T],
    points_bar: &mut Accumulator<T>,
) {
    let (m, bars) = (*matrix, bars.as_chunks::<N>().0);
    for_each_piece_mut(points_bar.entries(), 3 * POINTS_PER_PIECE, |piece, entries| {
        let bars = &bars[piece * POINTS_PER_PIECE..];
        dispatch::<T, _>(
            #[inline(always)]
            || {
                for (p_bar, bar) in entries.as_chunks_mut::<3>().0.iter_mut().zip(bars) {
                    let bar = bar.map(T::widen);
                    for k in 0..3 {
                        let mut sum = m[0][k] * bar[0];
                        for row in 1..N {
                            sum += m[row][k] * bar[row];
                        }
                        p_bar[k] += T::narrow(sum);
                    }
                }
            },
        );
    });
}

/// `sum_i y_bar_i (p_i, 1)^T` over `points: [V, 3]` and gradients `bars: [V, N]`.
pub(crate) fn moments<T: Scalar, const N: usize>(points: &[T], bars: &[T]) -> [[T::Wide; 4]; N] {
    let (points, bars) = (points.as_chunks::<3>().0, bars.as_chunks::<N>().0);
    let mut total = [[T::Wide::ZERO; 4]; N];
    let work = |range: std::ops::Range<usize>| piece_moments(&points[range.clone()], &bars[range]);
    merge_ranges(points.len(), POINTS_PER_PIECE, work, |moments: [[T::Wide; 4]; N]| {
        for (total, row) in total.iter_mut().flatten().zip(moments.iter().flatten()) {
            *total += *row;
        }
    });
    total
}

/// [`moments`] of one piece.
pub(crate) fn piece_moments<T: Scalar, const N: usize>(
    points: &[[T; 3]],
    bars: &[[T; N]],
) -> [[T::Wide; 4]; N] {
    // By columns: the gradient of a point is a vector of four, which a number multiplies.
    let mut columns = [[T::Wide::ZERO; 4]; 4];
    dispatch::<T, _>(
        #[inline(always)]
        || {
            for (p, bar) in points.iter().zip(bars) {
                let p = p.map(T::widen);
                let mut wide = [T::Wide::ZERO; 4];
                for row in 0..N {
                    wide[row] = bar[row].widen();
                }
                for row in 0..4 {
                    for k in 0..3 {
                        columns[k][row] += wide[row] * p[k];
                    }
                    columns[3][row] += wide[row];
                }
            }
        },
    );
    std::array::from_fn(|row| columns.map(|column| column[row]))
}

/// `sum_i y_bar_i` over gradients `bars: [V, N]`.
pub(crate) fn sum<T: Scalar, const N: usize>(bars: &[T]) -> [T::Wide; N] {
    let bars = bars.as_chunks::<N>().0;
    sum_rows::<T, N>(bars.len(), POINTS_PER_PIECE, |row| Some(bars[row].map(T::widen)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_several_pieces_are_those_of_whole_numbers() {
        // Whole numbers are exact in any order.
        let count = 2 * POINTS_PER_PIECE + 5;
        let number = |k: usize| ((k * 7919) % 101) as f64 - 50.0;
        let points: Vec<f64> = (0..3 * count).map(number).collect();
        let bars: Vec<f64> = (0..4 * count).map(|k| number(3 * k + 1)).collect();
        let found = moments::<f64, 4>(&points, &bars);
        for (row, found) in found.iter().enumerate() {
            for (column, &found) in found.iter().enumerate() {
                let entry = |i: usize| if column < 3 { points[3 * i + column] } else { 1.0 };
                let expected: f64 = (0..count).map(|i| bars[4 * i + row] * entry(i)).sum();
                assert_eq!(found, expected);
            }
        }
        assert_eq!(sum::<f64, 4>(&bars), found.map(|row| row[3]));
        assert_eq!(moments::<f64, 3>(&[], &[]), [[0.0; 4]; 3]);
    }
}
