//! Sums of rows by lists: `y_i = sum_k w_k x_(r_k)`, over the places `k` of list `i`.
//!
//! Scatter-adds become gathers: each row of `y` is one thread's, and its terms are added in the order of
//! its list, whatever the number of threads. Terms are summed in [`Scalar::Wide`].

use std::ops::Range;

use crate::axis::sum_rows;
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::scalar::Scalar;

/// Lists of rows, one after another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lists<'a> {
    /// Where each list starts among `rows`, and last where the last one ends.
    pub(crate) starts: &'a [usize],
    pub(crate) rows: &'a [u32],
}

/// Computes the sum of each list over rows of `x`, of `inner` entries each, times the `weights` of the
/// list's places, where there are some; calls `put(entry of y, sum)` for every entry of `y`.
pub(crate) fn sum_listed_rows<T: Scalar>(
    lists: Lists<'_>,
    weights: Option<&[T]>,
    x: &[T],
    inner: usize,
    y: &mut [T],
    put: impl Fn(&mut T, T::Wide) + Send + Sync,
) {
    match inner {
        0 => {}
        1 => in_columns::<T, 1>(lists, weights, x, y, put),
        2 => in_columns::<T, 2>(lists, weights, x, y, put),
        3 => in_columns::<T, 3>(lists, weights, x, y, put),
        4 => in_columns::<T, 4>(lists, weights, x, y, put),
        _ => for_each_sum_mut(lists, inner, y, |places, y| {
            sum_long(lists, places, weights, x, inner, y, &put);
        }),
    }
}

/// Calls `work(places, row of y)` for each list.
fn for_each_sum_mut<T: Scalar>(
    lists: Lists<'_>,
    inner: usize,
    y: &mut [T],
    work: impl Fn(Range<usize>, &mut [T]) + Send + Sync,
) {
    let starts = lists.starts;
    // Lists of usual length, a piece of terms in all.
    let count = starts.len().saturating_sub(1).max(1);
    let length = (lists.rows.len() / count + 1) * inner;
    let piece = (ENTRIES_PER_PIECE / length).max(1);
    for_each_piece_mut(y, piece * inner, |k, y| {
        let ends = starts[k * piece..].windows(2);
        for (ends, y) in ends.zip(y.chunks_mut(inner)) {
            work(ends[0]..ends[1], y);
        }
    });
}

/// [`sum_listed_rows`] for rows of `W` entries.
fn in_columns<T: Scalar, const W: usize>(
    lists: Lists<'_>,
    weights: Option<&[T]>,
    x: &[T],
    y: &mut [T],
    put: impl Fn(&mut T, T::Wide) + Send + Sync,
) {
    let (rows, _) = x.as_chunks::<W>();
    for_each_sum_mut(lists, W, y, |places, y| {
        if places.len() * W > ENTRIES_PER_PIECE {
            return sum_long(lists, places, weights, x, W, y, &put);
        }
        let mut sums = [T::Wide::ZERO; W];
        let listed = &lists.rows[places.clone()];
        match weights {
            None => {
                for &row in listed {
                    let row = &rows[row as usize];
                    sums.iter_mut().zip(row).for_each(|(sum, entry)| *sum += entry.widen());
                }
            }
            Some(weights) => {
                for (&row, weight) in listed.iter().zip(&weights[places]) {
                    let (row, weight) = (&rows[row as usize], weight.widen());
                    sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += weight * x.widen());
                }
            }
        }
        y.iter_mut().zip(sums).for_each(|(y, sum)| put(y, sum));
    });
}

/// The sum of one list, in pieces where it is long.
fn sum_long<T: Scalar>(
    lists: Lists<'_>,
    places: Range<usize>,
    weights: Option<&[T]>,
    x: &[T],
    inner: usize,
    y: &mut [T],
    put: impl Fn(&mut T, T::Wide),
) {
    let listed = &lists.rows[places.clone()];
    let entry = |k: usize, column: usize| x[listed[k] as usize * inner + column].widen();
    let put = |column: usize, sum| put(&mut y[column], sum);
    match weights {
        None => sum_rows::<T>(listed.len(), inner, entry, put),
        Some(weights) => {
            let weights = &weights[places];
            let term = |k: usize, column| weights[k].widen() * entry(k, column);
            sum_rows::<T>(listed.len(), inner, term, put);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_a_loop_over_each_list_at_every_width() {
        let lengths = [0, 1, 7, 0, 30_000, 2, 0];
        let mut starts = vec![0];
        starts.extend(lengths.iter().scan(0, |end, length| {
            *end += length;
            Some(*end)
        }));
        let count = *starts.last().unwrap();
        let rows: Vec<u32> = (0..count).map(|k| (k * 7919 % 50) as u32).collect();
        for inner in [0, 1, 2, 3, 4, 5, 8, 19] {
            let x: Vec<f32> = (0..50 * inner).map(|k| (k % 13) as f32 - 6.0).collect();
            let weights: Vec<f32> = (0..count).map(|k| (k % 3) as f32).collect();
            for weights in [None, Some(&weights[..])] {
                let mut expected = vec![0.5; lengths.len() * inner];
                for i in 0..lengths.len() {
                    for k in starts[i]..starts[i + 1] {
                        for c in 0..inner {
                            let entry = x[rows[k] as usize * inner + c];
                            expected[i * inner + c] += weights.map_or(1.0, |w| w[k]) * entry;
                        }
                    }
                }
                let mut y = vec![0.5; expected.len()];
                let lists = Lists { starts: &starts, rows: &rows };
                sum_listed_rows(lists, weights, &x, inner, &mut y, |y, sum| *y += sum as f32);
                assert_eq!(y, expected, "{inner}");
            }
        }
    }
}
