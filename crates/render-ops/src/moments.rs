//! Sums over points, for the gradients of matrices that multiply them.
//!
//! With `y_i = M (p_i, 1)`: `M_bar = sum_i y_bar_i (p_i, 1)^T`. Points are summed in pieces of a fixed
//! size, in [`Scalar::Wide`], and pieces in their order.

use bokashi_core::Scalar;
use bokashi_core::parallel::merge_ranges;

/// Points in one piece of work.
pub(crate) const POINTS_PER_PIECE: usize = 1 << 13;

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
    crate::dispatch::dispatch::<T, _>(
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
    let mut total = [T::Wide::ZERO; N];
    let work = |range: std::ops::Range<usize>| {
        let mut sums = [T::Wide::ZERO; N];
        for bar in &bars[range] {
            sums.iter_mut().zip(bar).for_each(|(sum, bar)| *sum += bar.widen());
        }
        sums
    };
    merge_ranges(bars.len(), POINTS_PER_PIECE, work, |sums: [T::Wide; N]| {
        total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
    });
    total
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
