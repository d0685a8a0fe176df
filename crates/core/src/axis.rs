//! Arrays along one of their axes, seen as `[outer, extent, inner]`.

use std::ops::Range;

use crate::error::TensorError;
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut, merge_ranges};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::summation::sum;

/// Sums that are formed side by side.
const LANES: usize = 8;
/// From so many columns on they are enough to share among threads.
const MANY_COLUMNS: usize = 512;

/// An array of `shape` seen as `[outer, extent of axis, inner]`.
///
/// # Errors
/// [`TensorError::Axis`] unless there is such an axis.
pub(crate) fn blocks(
    shape: &Shape,
    axis: usize,
    operation: &'static str,
) -> Result<[usize; 3], TensorError> {
    let Some(&extent) = shape.get(axis) else {
        return Err(TensorError::Axis { operation, axis, shape: shape.clone() });
    };
    // Of an array without entries a product need not fit an index, and is not used.
    let product = |axes: &[usize]| axes.iter().fold(1_usize, |n, &extent| n.saturating_mul(extent));
    Ok([product(&shape[..axis]), extent, product(&shape[axis + 1..])])
}

/// `shape` without `axis`, one of its axes: the shape of what a reduction gives.
///
/// # Errors
/// [`TensorError::Length`] where it has more entries than fit an index, which an axis of extent 0 can
/// hide.
pub(crate) fn reduced(shape: &Shape, axis: usize) -> Result<Shape, TensorError> {
    let reduced = shape.without(axis);
    match reduced.checked_size() {
        Some(_) => Ok(reduced),
        None => Err(TensorError::Length { shape: reduced, entries: 0 }),
    }
}

/// `shape` with a new axis of `extent` before `axis`, or at the end.
///
/// # Errors
/// [`TensorError::Value`] where `axis` is beyond the end.
pub(crate) fn with_new_axis(
    shape: &Shape,
    axis: usize,
    extent: usize,
    operation: &'static str,
) -> Result<Shape, TensorError> {
    if axis <= shape.rank() {
        return Ok(shape.with_new(axis, extent));
    }
    let rule = format!("a new axis up to the rank {}", shape.rank()).into();
    Err(TensorError::Value { operation, rule, value: axis as f64 })
}

/// Sums `x: [outer, extent, inner]` over its middle axis into `sums: [outer, inner]`, each sum
/// through `round` from [`Scalar::Wide`].
pub(crate) fn sum_along<T: Scalar>(
    x: &[T],
    [_, extent, inner]: [usize; 3],
    sums: &mut [T],
    round: impl Fn(T::Wide) -> T + Send + Sync,
) {
    if inner == 1 {
        let piece = (ENTRIES_PER_PIECE / extent.max(1)).max(1);
        for_each_piece_mut(sums, piece, |k, sums| {
            for (row, total) in (k * piece..).zip(sums) {
                let x = &x[row * extent..][..extent];
                *total = round(if extent < LANES {
                    x.iter().map(|x| x.widen()).sum()
                } else {
                    sum::<T>(extent, |k| x[k].widen())
                });
            }
        });
        return;
    }
    let size = extent * inner;
    let sum_block = |block: usize, sums: &mut [T]| {
        let x = &x[block * size..][..size];
        let term = |row: usize, column: usize| x[row * inner + column].widen();
        sum_rows::<T>(extent, inner, term, |column, total| sums[column] = round(total));
    };
    if size > ENTRIES_PER_PIECE {
        for (block, sums) in sums.chunks_mut(inner).enumerate() {
            if inner < MANY_COLUMNS {
                sum_block(block, sums);
                continue;
            }
            // So many columns that threads share them rather than the rows.
            let x = &x[block * size..][..size];
            let columns = (ENTRIES_PER_PIECE / extent).max(1).next_multiple_of(LANES);
            for_each_piece_mut(sums, columns, |k, sums| {
                for (group, sums) in sums.chunks_mut(LANES).enumerate() {
                    let first = k * columns + group * LANES;
                    let term = |row: usize, c: usize| x[row * inner + first + c].widen();
                    let totals = sum_lanes::<T>([extent, inner], sums.len(), term);
                    sums.iter_mut().zip(totals).for_each(|(sum, total)| *sum = round(total));
                }
            });
        }
        return;
    }
    let blocks = (ENTRIES_PER_PIECE / size.max(1)).max(1);
    for_each_piece_mut(sums, (blocks * inner).max(1), |k, sums| {
        let sums = (k * blocks..).zip(sums.chunks_mut(inner));
        sums.for_each(|(block, sums)| sum_block(block, sums));
    });
}

/// Sums `term(row, column)` over all rows, for each column: calls `put(column, sum)`.
/// Rows are summed in pieces of a fixed number, and the pieces' sums are added in order.
pub(crate) fn sum_rows<T: Scalar>(
    rows: usize,
    columns: usize,
    term: impl Fn(usize, usize) -> T::Wide + Send + Sync,
    mut put: impl FnMut(usize, T::Wide),
) {
    for first in (0..columns).step_by(LANES) {
        let width = LANES.min(columns - first);
        let term = |row: usize, c: usize| term(row, first + c);
        let totals = sum_lanes::<T>([rows, columns], width, term);
        totals[..width].iter().enumerate().for_each(|(c, &total)| put(first + c, total));
    }
}

/// Sums `term(row, c)` over all rows for each `c` below `width`, of an array of so many rows and columns.
fn sum_lanes<T: Scalar>(
    [rows, columns]: [usize; 2],
    width: usize,
    term: impl Fn(usize, usize) -> T::Wide + Send + Sync,
) -> [T::Wide; LANES] {
    let mut totals = [T::Wide::ZERO; LANES];
    // A loop of a known length where there are a few columns.
    let piece = |range: Range<usize>| {
        let mut sums = [T::Wide::ZERO; LANES];
        match width {
            1 => lanes::<1, T>(range, &term, &mut sums),
            2 => lanes::<2, T>(range, &term, &mut sums),
            3 => lanes::<3, T>(range, &term, &mut sums),
            4 => lanes::<4, T>(range, &term, &mut sums),
            LANES => lanes::<LANES, T>(range, &term, &mut sums),
            _ => {
                for row in range {
                    for (c, sum) in sums[..width].iter_mut().enumerate() {
                        *sum += term(row, c);
                    }
                }
            }
        }
        sums
    };
    let mut merge = |sums: [T::Wide; LANES]| {
        totals.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
    };
    let rows_per_piece = (ENTRIES_PER_PIECE / columns).max(1);
    if rows_per_piece == 1 {
        // Row after row is the same sum.
        merge(piece(0..rows));
    } else if rows * width > ENTRIES_PER_PIECE {
        merge_ranges(rows, rows_per_piece, piece, merge);
    } else {
        // The same pieces, too little work to share.
        let starts = (0..rows).step_by(rows_per_piece);
        starts.map(|start| piece(start..(start + rows_per_piece).min(rows))).for_each(merge);
    }
    totals
}

/// Writes the sums of `term(row, column)` over `rows`, for `W` columns.
fn lanes<const W: usize, T: Scalar>(
    rows: Range<usize>,
    term: impl Fn(usize, usize) -> T::Wide,
    sums: &mut [T::Wide; LANES],
) {
    // A local array of known length stays in registers.
    let mut columns = [T::Wide::ZERO; W];
    for row in rows {
        for (c, sum) in columns.iter_mut().enumerate() {
            *sum += term(row, c);
        }
    }
    sums[..W].copy_from_slice(&columns);
}

/// The adjoint of [`sum_along`]: adds `entry(sums_bar)`, with `sums_bar: [outer, inner]`, to
/// each row of `x_bar: [outer, extent, inner]`.
pub(crate) fn spread_along<T: Scalar>(
    sums_bar: &[T],
    [_, extent, inner]: [usize; 3],
    x_bar: &mut [T],
    entry: impl Fn(T) -> T + Send + Sync,
) {
    if x_bar.is_empty() {
        return;
    }
    if is_in_lines([0, extent, inner]) {
        for_each_line_mut(x_bar, extent, [], |row, x_bar, []| {
            let bar = entry(sums_bar[row]);
            x_bar.iter_mut().for_each(|x_bar| *x_bar += bar);
        });
        return;
    }
    let rows = (ENTRIES_PER_PIECE / inner).max(1);
    for_each_piece_mut(x_bar, rows * inner, |k, x_bar| {
        for (row, x_bar) in (k * rows..).zip(x_bar.chunks_mut(inner)) {
            let sums_bar = &sums_bar[row / extent * inner..][..inner];
            x_bar.iter_mut().zip(sums_bar).for_each(|(x_bar, &bar)| *x_bar += entry(bar));
        }
    });
}

/// Whether lines along the middle axis of `[outer, extent, inner]` lie in one piece, and are no longer than
/// a piece of work.
pub(crate) fn is_in_lines([_, extent, inner]: [usize; 3]) -> bool {
    inner == 1 && extent <= ENTRIES_PER_PIECE
}

/// Calls `work(row, line, lines of from)` for each line of `extent` entries of `data`, and the lines
/// beside it in `from`; lines may be worked on at the same time.
#[inline(always)]
pub(crate) fn for_each_line_mut<T: Scalar, const N: usize>(
    data: &mut [T],
    extent: usize,
    from: [&[T]; N],
    work: impl Fn(usize, &mut [T], [&[T]; N]) + Send + Sync,
) {
    match extent {
        0 => {}
        1 => for_each_short_line_mut::<T, 1, N>(data, from, work),
        2 => for_each_short_line_mut::<T, 2, N>(data, from, work),
        3 => for_each_short_line_mut::<T, 3, N>(data, from, work),
        4 => for_each_short_line_mut::<T, 4, N>(data, from, work),
        _ => {
            let lines = (ENTRIES_PER_PIECE / extent).max(1);
            for_each_piece_mut(data, lines * extent, |k, data| {
                for (row, line) in (k * lines..).zip(data.chunks_mut(extent)) {
                    work(row, line, from.map(|from| &from[row * extent..][..extent]));
                }
            });
        }
    }
}

/// [`for_each_line_mut`] for lines of `E` entries: loops of a known length, where `work` is inlined.
#[inline(always)]
pub(crate) fn for_each_short_line_mut<T: Scalar, const E: usize, const N: usize>(
    data: &mut [T],
    from: [&[T]; N],
    work: impl Fn(usize, &mut [T], [&[T]; N]) + Send + Sync,
) {
    let lines = ENTRIES_PER_PIECE / E;
    for_each_piece_mut(data, lines * E, |k, data| {
        let (data, _) = data.as_chunks_mut::<E>();
        let first = k * lines;
        let from = from.map(|from| &from.as_chunks::<E>().0[first..][..data.len()]);
        for (index, line) in data.iter_mut().enumerate() {
            work(first + index, line, from.map(|from| &from[index][..]));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_outer_axis_inner() {
        assert_eq!(blocks(&[2, 3, 4, 5].into(), 1, "slice"), Ok([2, 3, 20]));
        assert_eq!(blocks(&[7].into(), 0, "slice"), Ok([1, 7, 1]));
        let message = "slice needs an axis below the rank 1, got axis 1 of shape [7]";
        assert_eq!(blocks(&[7].into(), 1, "slice").unwrap_err().to_string(), message);
    }

    #[test]
    fn a_new_axis_stands_before_another_or_at_the_end() {
        let shape = Shape::from([2, 3]);
        let with = |axis| with_new_axis(&shape, axis, 1, "stack");
        assert_eq!(
            [with(0), with(1), with(2)],
            [Ok([1, 2, 3].into()), Ok([2, 1, 3].into()), Ok([2, 3, 1].into())]
        );
        let message = "stack needs a new axis up to the rank 2, got 3";
        assert_eq!(with(3).unwrap_err().to_string(), message);
    }

    #[test]
    fn sums_along_an_axis_are_exact_on_integers_at_every_extent() {
        let extents = [0, 1, 2, LANES, LANES + 1, 200];
        let all = (0..216).map(|k| [k / 36, k / 6 % 6, k % 6].map(|at| extents[at]));
        // Columns that threads share, in a group more or less, and rows that they share.
        let wide = [[2, 40, 700], [3, 5, 6001], [1, 2, ENTRIES_PER_PIECE + 1], [2, 9000, 3]];
        for [outer, extent, inner] in all.chain(wide) {
            let x: Vec<f32> = (0..outer * extent * inner).map(|k| (k % 101) as f32).collect();
            let mut sums = vec![f32::NAN; outer * inner];
            sum_along(&x, [outer, extent, inner], &mut sums, |total| total as f32);
            for (k, &total) in sums.iter().enumerate() {
                let first = (k / inner) * extent * inner + k % inner;
                let expected: f32 = (0..extent).map(|row| x[first + row * inner]).sum();
                assert_eq!(total, expected, "[{outer}, {extent}, {inner}] at {k}");
            }
        }
    }

    #[test]
    fn every_line_is_visited_once_beside_its_own() {
        for extent in [0, 1, 2, 3, 4, 5, 20_000] {
            let rows = 100_000_usize.div_ceil(extent.max(1)).min(10_000);
            let numbers: Vec<f64> = (0..rows * extent).map(|k| k as f64).collect();
            let mut seen = vec![0.5; numbers.len()];
            for_each_line_mut(&mut seen, extent, [&numbers], |row, line, [numbers]| {
                for (line, number) in line.iter_mut().zip(numbers) {
                    *line += number + 0.25 * row as f64;
                }
            });
            for (k, &seen) in seen.iter().enumerate() {
                assert_eq!(seen, 0.5 + k as f64 + 0.25 * (k / extent) as f64);
            }
        }
    }

    #[test]
    fn spreading_is_the_adjoint_of_summing() {
        for [outer, extent, inner] in [[3, 4, 5], [1, 7, 1], [2, 0, 3], [2, 3, 0], [9, 1, 1]] {
            let x: Vec<f64> = (0..outer * extent * inner).map(|k| (k % 7) as f64).collect();
            let upstream: Vec<f64> = (0..outer * inner).map(|k| (k % 5) as f64 - 2.0).collect();
            let (mut sums, mut x_bar) = (vec![0.0; upstream.len()], vec![0.0; x.len()]);
            sum_along(&x, [outer, extent, inner], &mut sums, |total| total);
            spread_along(&upstream, [outer, extent, inner], &mut x_bar, |bar| bar);
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            assert_eq!(dot(&sums, &upstream), dot(&x, &x_bar));
        }
    }
}
