//! Walks over an array in row-major order beside arrays that are laid out along the same axes
//! another way: repeated, permuted, or in part.

use smallvec::SmallVec;

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
                Some((inner, inner_strides)) if strides == inner_strides.map(|s| s * *inner) => {
                    *inner *= extent;
                }
                _ => merged.push((extent, strides)),
            }
        }
        Self { axes: merged }
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
        let mut counts: SmallVec<[usize; 4]> = SmallVec::from_elem(0, outer.len());
        loop {
            let mut at = start;
            for _ in 0..length {
                visit(at);
                at.iter_mut().zip(steps).for_each(|(at, step)| *at += step);
            }
            let mut axis = 0;
            loop {
                if axis == outer.len() {
                    return;
                }
                let (extent, strides) = outer[axis];
                counts[axis] += 1;
                start.iter_mut().zip(strides).for_each(|(at, stride)| *at += stride);
                if counts[axis] < extent {
                    break;
                }
                counts[axis] = 0;
                start.iter_mut().zip(strides).for_each(|(at, stride)| *at -= stride * extent);
                axis += 1;
            }
        }
    }
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
