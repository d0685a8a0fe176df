//! Walks over an array in row-major order beside arrays that are laid out along the same axes
//! another way: repeated, permuted, or in part.

use std::array;

use smallvec::SmallVec;

use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::scalar::Scalar;
use crate::shape::Shape;

/// Entries that are brought beside each other before they are worked on: whole rows of two to six.
const BLOCK: usize = 240;

/// A walk over the positions of an array, beside `N` arrays.
#[derive(Debug, Clone)]
pub(crate) struct Walk<const N: usize> {
    /// Innermost first: the extent of an axis, and how far one step along it moves in each array.
    axes: SmallVec<[(usize, [usize; N]); 4]>,
}

impl<const N: usize> Walk<N> {
    /// The walk over `axes`, outermost first. Axes that each array runs through in one go become
    /// one: the fewer axes, the longer the inner loop.
    pub(crate) fn new(axes: impl DoubleEndedIterator<Item = (usize, [usize; N])>) -> Self {
        let mut merged: SmallVec<[(usize, [usize; N]); 4]> = SmallVec::new();
        for (extent, strides) in axes.rev().filter(|&(extent, _)| extent != 1) {
            match merged.last_mut() {
                Some((inner, inner_strides))
                    if strides == inner_strides.map(|s| s.saturating_mul(*inner)) =>
                {
                    // Too large where another extent is 0 and nothing is visited.
                    *inner = inner.saturating_mul(extent);
                }
                _ => merged.push((extent, strides)),
            }
        }
        Self { axes: merged }
    }

    /// Calls `work(entry, [one of each array])` for each entry of `data`, which the walk goes
    /// through from end to end; entries may be worked on at the same time.
    pub(crate) fn zip_mut<D: Send, T: Scalar>(
        &self,
        data: &mut [D],
        from: [&[T]; N],
        work: impl Fn(&mut D, [T; N]) + Send + Sync,
    ) {
        // Entries of an array that do not lie side by side are copied to a buffer, a block at a time. So the
        // loop that works sees slices alone, and the compiler makes vectors of it.
        let columns = self.columns().max(1);
        let rows = ENTRIES_PER_PIECE / columns;
        if rows == 0 {
            // A row has several pieces.
            let steps = self.steps();
            return self.rows_mut(data, |row, starts| {
                let mut buffers = [[T::ZERO; BLOCK]; N];
                for (k, row) in row.chunks_mut(BLOCK).enumerate() {
                    let mut buffers = buffers.iter_mut();
                    let from: [&[T]; N] = array::from_fn(|i| {
                        let buffer = buffers.next().expect("there is one for each array");
                        let from = &from[i][starts[i] + k * BLOCK * steps[i]..];
                        brought(from, steps[i], &mut buffer[..row.len()])
                    });
                    for (k, entry) in row.iter_mut().enumerate() {
                        work(entry, from.map(|from| from[k]));
                    }
                }
            });
        }
        // Either a block has several rows, or a row several blocks.
        let block_rows = (BLOCK / columns).max(1);
        for_each_piece_mut(data, rows * columns, |piece, data| {
            let mut buffers = [[T::ZERO; BLOCK]; N];
            let first = piece * rows;
            for (k, data) in data.chunks_mut(block_rows * columns).enumerate() {
                for (j, data) in data.chunks_mut(BLOCK).enumerate() {
                    let corner = (first + k * block_rows, j * BLOCK);
                    let mut buffers = buffers.iter_mut();
                    let from: [&[T]; N] = array::from_fn(|i| {
                        let buffer = buffers.next().expect("there is one for each array");
                        self.block(i, from[i], corner, &mut buffer[..data.len()], k == 0)
                    });
                    for (k, entry) in data.iter_mut().enumerate() {
                        work(entry, from.map(|from| from[k]));
                    }
                }
            }
        });
    }

    /// The entries of array `i` from `row` and `column` on: where they lie, if they are in one
    /// piece, otherwise in `buffer`, as many as it holds.
    fn block<'a, T: Scalar>(
        &self,
        i: usize,
        from: &'a [T],
        (row, column): (usize, usize),
        buffer: &'a mut [T],
        is_first: bool,
    ) -> &'a [T] {
        let (columns, step) = (self.columns(), self.axes.first().map_or(0, |axis| axis.1[i]));
        let start = self.start(row, i) + column * step;
        // Rows follow each other without a gap where a step along an axis skips all of the axis within it.
        let in_one_piece = |pair: &[(usize, [usize; N])]| pair[1].1[i] == pair[0].0 * pair[0].1[i];
        let is_whole = columns - column >= buffer.len();
        if step == 1 && (is_whole || self.axes.windows(2).all(in_one_piece)) {
            return &from[start..][..buffer.len()];
        }
        // The same rows as in the block before.
        let is_tiled = !is_whole && self.axes[1..].iter().all(|axis| axis.1[i] == 0);
        if is_first || !is_tiled {
            for (row, buffer) in (row..).zip(buffer.chunks_mut(columns)) {
                bring(&from[self.start(row, i) + column * step..], step, buffer);
            }
        }
        buffer
    }

    /// Calls `work(row, starts)` for each row of `data` along the innermost axis, whole or in parts;
    /// `starts` is where the row begins in each array, and [`Walk::steps`] how far its entries lie apart
    /// there. The walk goes through `data` from end to end; rows may be worked on at the same time.
    pub(crate) fn rows_mut<D: Send>(
        &self,
        data: &mut [D],
        work: impl Fn(&mut [D], [usize; N]) + Send + Sync,
    ) {
        let (columns, steps) = (self.columns().max(1), self.steps());
        // Either a piece has several rows, or a row several pieces.
        let piece = match ENTRIES_PER_PIECE / columns {
            0 => ENTRIES_PER_PIECE,
            rows => rows * columns,
        };
        for_each_piece_mut(data, piece, |k, mut data| {
            let (mut row, mut column) = (k * piece / columns, k * piece % columns);
            while !data.is_empty() {
                let (head, rest) = data.split_at_mut((columns - column).min(data.len()));
                let start = self.row(row);
                work(head, array::from_fn(|i| start[i] + column * steps[i]));
                (row, column, data) = (row + 1, 0, rest);
            }
        });
    }

    /// Innermost first: the extent of an axis, and how far one step along it moves in each array.
    pub(crate) fn axes(&self) -> &[(usize, [usize; N])] {
        &self.axes
    }

    /// The length of the innermost axis.
    fn columns(&self) -> usize {
        self.axes.first().map_or(1, |&(extent, _)| extent)
    }

    /// The number of positions.
    pub(crate) fn size(&self) -> usize {
        let extents = || self.axes.iter().map(|&(extent, _)| extent);
        if extents().any(|extent| extent == 0) { 0 } else { extents().product() }
    }

    /// How far a step along the innermost axis moves in each array.
    pub(crate) fn steps(&self) -> [usize; N] {
        self.axes.first().map_or([0; N], |&(_, steps)| steps)
    }

    /// The k-th position in each array.
    #[inline]
    pub(crate) fn position(&self, k: usize) -> [usize; N] {
        match *self.axes {
            [] => [0; N],
            [(_, steps)] => steps.map(|step| k * step),
            [(columns, steps), ..] => {
                let (start, column) = (self.row(k / columns), k % columns);
                array::from_fn(|i| start[i] + column * steps[i])
            }
        }
    }

    /// Where row `row` starts in each array.
    #[inline]
    fn row(&self, mut row: usize) -> [usize; N] {
        match self.axes.get(1..).unwrap_or_default() {
            [(_, strides)] => strides.map(|stride| row * stride),
            outer => outer.iter().fold([0; N], |start, &(extent, strides)| {
                let index = row % extent;
                row /= extent;
                array::from_fn(|i| start[i] + index * strides[i])
            }),
        }
    }

    /// Where row `row` starts in array `i`.
    fn start(&self, mut row: usize, i: usize) -> usize {
        match self.axes.get(1..).unwrap_or_default() {
            [(_, strides)] => row * strides[i],
            outer => outer.iter().fold(0, |start, &(extent, strides)| {
                let index = row % extent;
                row /= extent;
                start + index * strides[i]
            }),
        }
    }

    /// Calls `visit` with the position in each array, for each position of the walk in order.
    #[inline]
    pub(crate) fn for_each(&self, mut visit: impl FnMut([usize; N])) {
        let Some((&(length, steps), outer)) = self.axes.split_first() else {
            return visit([0; N]);
        };
        if self.axes.iter().any(|&(extent, _)| extent == 0) {
            return;
        }
        let mut start = [0; N];
        // As an odometer: an axis that is through goes back to its start, and the next one takes a step.
        let mut counts: SmallVec<[usize; 4]> = SmallVec::from_elem(0, outer.len());
        loop {
            let mut position = start;
            for _ in 0..length {
                visit(position);
                position.iter_mut().zip(steps).for_each(|(position, step)| *position += step);
            }
            let mut axis = 0;
            loop {
                if axis == outer.len() {
                    return;
                }
                let (extent, strides) = outer[axis];
                counts[axis] += 1;
                start.iter_mut().zip(strides).for_each(|(start, stride)| *start += stride);
                if counts[axis] < extent {
                    break;
                }
                counts[axis] = 0;
                start.iter_mut().zip(strides).for_each(|(start, stride)| *start -= stride * extent);
                axis += 1;
            }
        }
    }
}

/// Fills `buffer` with every `step`-th of `from`, or with its first entry where the step is 0.
fn bring<T: Copy>(from: &[T], step: usize, buffer: &mut [T]) {
    match step {
        0 => buffer.fill(from[0]),
        _ => buffer.iter_mut().enumerate().for_each(|(k, to)| *to = from[k * step]),
    }
}

/// Every `step`-th of `from`: where they lie, if they are in one piece, otherwise in `buffer`, as many as
/// it holds.
fn brought<'a, T: Copy>(from: &'a [T], step: usize, buffer: &'a mut [T]) -> &'a [T] {
    if step == 1 {
        return &from[..buffer.len()];
    }
    bring(from, step, buffer);
    buffer
}

/// The axes of the first shape, outermost first, and how far one step along each moves in arrays of all
/// of the shapes.
pub(crate) fn axes<const N: usize>(
    shapes: [&Shape; N],
) -> impl DoubleEndedIterator<Item = (usize, [usize; N])> + ExactSizeIterator + Clone {
    let strides = shapes.map(|shape| shape.strides_in(shapes[0]));
    (0..shapes[0].rank()).map(move |axis| (shapes[0][axis], array::from_fn(|i| strides[i][axis])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn positions<const N: usize>(axes: &[(usize, [usize; N])]) -> Vec<[usize; N]> {
        let mut seen = Vec::new();
        Walk::new(axes.iter().copied()).for_each(|at| seen.push(at));
        seen
    }

    #[test]
    fn a_walk_is_the_nest_of_loops_over_its_axes() {
        let (rows, columns, depth) = (3, 2, 4);
        for strides in [[8, 4, 1], [1, 3, 6], [0, 1, 0], [4, 0, 1], [0, 0, 0]] {
            let axes = [(rows, strides[0]), (columns, strides[1]), (depth, strides[2])];
            let mut expected = Vec::new();
            for k in 0..rows * columns * depth {
                let (i, j, l) = (k / (columns * depth), k / depth % columns, k % depth);
                expected.push([k, i * strides[0] + j * strides[1] + l * strides[2]]);
            }
            let full = [columns * depth, depth, 1];
            let both: Vec<_> =
                axes.iter().zip(full).map(|(&(n, s), full)| (n, [full, s])).collect();
            assert_eq!(positions(&both), expected);
        }
    }

    #[test]
    fn entries_brought_beside_each_other_in_blocks_are_those_of_the_walk() {
        for [a, b, c] in [[1, 500, 3], [7, 90, 2], [1, 3, 500], [40, 50, 20], [3, 9000, 1]] {
            let full = [b * c, c, 1];
            let numbers: Vec<f64> = (0..a * b * c).map(|k| k as f64).collect();
            let repeated = [[0, 0, 1], [0, 1, 0], [b, 1, 0], [0, c, 1], [1, 0, 0], [c, 0, 1]];
            for strides in repeated.into_iter().chain([full, [0; 3], [1, a, a * b]]) {
                let axes = || (0..3).map(|k| ([a, b, c][k], [full[k], strides[k]]));
                let mut sums = vec![0.5; a * b * c];
                let walk = Walk::new(axes());
                walk.zip_mut(&mut sums, [&numbers, &numbers], |sum, [k, at]| *sum += k + 0.25 * at);
                walk.for_each(|[k, at]| {
                    assert_eq!(sums[k], 0.5 + (k as f64) + 0.25 * at as f64, "{strides:?} {k}");
                });
            }
        }
    }

    #[test]
    fn rows_and_positions_are_those_of_the_walk() {
        for [a, b, c] in [[1, 1, 1], [7, 90, 2], [5, 3, 9000], [1, 1, 40_000], [3, 1, 20_000]] {
            let full = [b * c, c, 1];
            for strides in [full, [0, 0, 1], [1, a, a * b], [0, 1, 0], [b, 1, 0]] {
                let walk = Walk::new((0..3).map(|k| ([a, b, c][k], [full[k], strides[k]])));
                let mut seen = vec![usize::MAX; a * b * c];
                let steps = walk.steps();
                walk.rows_mut(&mut seen, |row, [k, at]| {
                    for (column, seen) in row.iter_mut().enumerate() {
                        // The position in the array itself is where the entry is.
                        *seen = (at + column * steps[1]) + 1000 * (k + column * steps[0]);
                    }
                });
                assert_eq!(walk.size(), seen.len());
                walk.for_each(|[k, at]| {
                    assert_eq!(seen[k], at + 1000 * k, "{strides:?} {k}");
                    assert_eq!(walk.position(k), [k, at], "{strides:?} {k}");
                });
            }
        }
    }

    #[test]
    fn no_axes_are_one_position_and_an_empty_axis_none() {
        assert_eq!(positions::<1>(&[]), [[0]]);
        assert_eq!(positions(&[(1, [5])]), [[0]]);
        assert!(positions(&[(2, [0]), (0, [1])]).is_empty());
        assert!(positions(&[(0, [3]), (3, [1])]).is_empty());
    }

    #[test]
    fn axes_in_one_piece_become_one() {
        let walk = Walk::new([(4, [6, 0]), (2, [3, 3]), (3, [1, 1])].into_iter());
        assert_eq!(walk.axes.len(), 2);
    }
}
