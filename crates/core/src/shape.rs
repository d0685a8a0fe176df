//! The shape of a dense row-major array, and how two shapes broadcast.

use std::fmt;
use std::ops::Deref;

use smallvec::SmallVec;

/// No array has so many entries: an allocator may promise the memory, but no machine has it.
const TOO_MANY: u64 = 1 << 40;

/// From so many entries on the allocator is asked first.
const MANY: usize = 1 << 18;

/// Extents per axis, outermost first; `[]` is a scalar. Up to four axes need no allocation.
#[derive(Eq, Default)]
pub struct Shape(SmallVec<[usize; 4]>);

impl Shape {
    /// The number of entries: the product of the extents, 1 for a scalar.
    ///
    /// # Panics
    /// Where it does not fit an index.
    pub fn size(&self) -> usize {
        let size = self.checked_size();
        size.unwrap_or_else(|| panic!("a shape needs fewer entries than fit an index, got {self}"))
    }

    /// [`Shape::size`], or `None` where it does not fit a `usize`.
    pub(crate) fn checked_size(&self) -> Option<usize> {
        if self.0.contains(&0) {
            return Some(0);
        }
        self.0.iter().try_fold(1_usize, |size, &extent| size.checked_mul(extent))
    }

    /// [`Shape::size`], or `None` from [`TOO_MANY`] entries on.
    pub(crate) fn bounded_size(&self) -> Option<usize> {
        self.checked_size().filter(|&size| (size as u64) < TOO_MANY)
    }

    /// The same, of a new buffer for entries of type T: `None` also where the allocator has none of that
    /// size.
    pub(crate) fn size_in_memory<T>(&self) -> Option<usize> {
        let size = self.bounded_size()?;
        let is_small = size < MANY;
        (is_small || Vec::<T>::new().try_reserve_exact(size).is_ok()).then_some(size)
    }

    /// [`Shape::size`] of a new array with entries of type T.
    ///
    /// # Panics
    /// Where there is no memory for it.
    pub(crate) fn size_to_fill<T>(&self) -> usize {
        let size = self.size_in_memory::<T>();
        size.unwrap_or_else(|| {
            panic!("a shape needs fewer entries than fit into memory, got {self}")
        })
    }

    /// Whether the extents are `axes`.
    #[inline]
    pub(crate) fn is(&self, axes: &[usize]) -> bool {
        // Not `==`, which calls a comparison of memory.
        let extents: &[usize] = &self.0;
        extents.len() == axes.len() && extents.iter().zip(axes).all(|(a, b)| a == b)
    }

    /// The number of axes.
    pub fn rank(&self) -> usize {
        self.0.len()
    }

    /// The shape with `axis` removed.
    pub(crate) fn without(&self, axis: usize) -> Self {
        let mut axes = self.0.clone();
        axes.remove(axis);
        Self(axes)
    }

    /// The shape with the extent of `axis` replaced.
    pub(crate) fn with(&self, axis: usize, extent: usize) -> Self {
        let mut axes = self.0.clone();
        axes[axis] = extent;
        Self(axes)
    }

    /// The shape with a new axis of `extent` before `axis`, or at the end.
    pub(crate) fn with_new(&self, axis: usize, extent: usize) -> Self {
        let mut axes = self.0.clone();
        axes.insert(axis, extent);
        Self(axes)
    }

    /// The common shape of two shapes, aligned at their last axes, where an extent of 1 repeats;
    /// `None` where two extents differ and neither is 1.
    pub(crate) fn broadcast(&self, other: &Self) -> Option<Self> {
        let rank = self.rank().max(other.rank());
        let axes = (0..rank)
            .map(|axis| match (self.extent_of(axis, rank), other.extent_of(axis, rank)) {
                (a, b) if a == b => Some(a),
                (1, b) => Some(b),
                (a, 1) => Some(a),
                _ => None,
            })
            .collect::<Option<_>>()?;
        Some(Self(axes))
    }

    /// The extent of `axis` once the shape is padded with leading 1s to `rank` axes.
    fn extent_of(&self, axis: usize, rank: usize) -> usize {
        (axis + self.rank()).checked_sub(rank).map_or(1, |axis| self.0[axis])
    }

    /// How far one step along each axis of `full` moves in an array of this shape: its row-major
    /// stride, or 0 along the axes that it repeats.
    pub(crate) fn strides_in(&self, full: &Self) -> SmallVec<[usize; 4]> {
        let rank = full.rank();
        let mut strides: SmallVec<[usize; 4]> = SmallVec::from_elem(0, rank);
        let mut stride = 1;
        for axis in (0..rank).rev() {
            let extent = self.extent_of(axis, rank);
            if extent == full[axis] {
                strides[axis] = stride;
            }
            // Of an array without entries it is not used, and need not fit.
            stride = stride.saturating_mul(extent);
        }
        strides
    }
}

/// Shapes are copied and compared several times per operation: with up to four axes in a few
/// instructions, where the general way makes calls.
impl Clone for Shape {
    #[inline]
    fn clone(&self) -> Self {
        let (axes, rank) = match *self.0 {
            [] => ([0; 4], 0),
            [a] => ([a, 0, 0, 0], 1),
            [a, b] => ([a, b, 0, 0], 2),
            [a, b, c] => ([a, b, c, 0], 3),
            [a, b, c, d] => ([a, b, c, d], 4),
            _ => return Self(self.0.clone()),
        };
        Self(SmallVec::from_buf_and_len(axes, rank))
    }
}

impl PartialEq for Shape {
    #[inline]
    fn eq(&self, other: &Self) -> bool {
        self.is(other)
    }
}

impl AsRef<[usize]> for Shape {
    #[inline]
    fn as_ref(&self) -> &[usize] {
        &self.0
    }
}

impl Deref for Shape {
    type Target = [usize];

    #[inline]
    fn deref(&self) -> &[usize] {
        &self.0
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.0.iter()).finish()
    }
}

impl fmt::Debug for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl<const N: usize> From<[usize; N]> for Shape {
    fn from(axes: [usize; N]) -> Self {
        Self(SmallVec::from_slice(&axes))
    }
}

impl From<&[usize]> for Shape {
    fn from(axes: &[usize]) -> Self {
        Self(SmallVec::from_slice(axes))
    }
}

impl From<&Shape> for Shape {
    fn from(shape: &Shape) -> Self {
        shape.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape(axes: &[usize]) -> Shape {
        Shape::from(axes)
    }

    #[test]
    fn an_extent_of_zero_leaves_no_entries_however_large_the_others_are() {
        let huge = 1 << 40;
        for axes in [[0, huge, huge], [huge, 0, huge], [huge, huge, 0]] {
            assert_eq!(shape(&axes).size(), 0);
            assert_eq!(shape(&axes).checked_size(), Some(0));
            assert_eq!(shape(&axes).strides_in(&shape(&axes)).len(), 3);
        }
    }

    #[test]
    fn broadcasting_aligns_last_axes_and_repeats_extent_one() {
        type Case = (&'static [usize], &'static [usize], Option<&'static [usize]>);
        let cases: &[Case] = &[
            (&[], &[], Some(&[])),
            (&[2, 3], &[], Some(&[2, 3])),
            (&[2, 3], &[3], Some(&[2, 3])),
            (&[2, 1], &[1, 3], Some(&[2, 3])),
            (&[0], &[1], Some(&[0])),
            (&[2, 3], &[2], None),
            (&[0], &[2], None),
        ];
        for (left, right, expected) in cases {
            assert_eq!(shape(left).broadcast(&shape(right)), expected.map(shape));
            assert_eq!(shape(right).broadcast(&shape(left)), expected.map(shape));
        }
    }

    #[test]
    fn no_memory_holds_a_trillion_entries() {
        for axes in [&[1 << 20, 1 << 20][..], &[1 << 40], &[1 << 63], &[1 << 40, 1 << 40]] {
            let found = [shape(axes).bounded_size(), shape(axes).size_in_memory::<bool>()];
            assert_eq!(found, [None; 2]);
        }
        let small = shape(&[1 << 10, 1 << 10]);
        assert_eq!([small.bounded_size(), small.size_in_memory::<f64>()], [Some(1 << 20); 2]);
        assert_eq!(shape(&[(1 << 40) - 1]).bounded_size(), Some((1 << 40) - 1));
    }

    #[test]
    fn a_shape_without_entries_is_whole_however_large_its_axes() {
        let none = shape(&[0, 1 << 40, 1 << 40]);
        assert_eq!((none.size(), none.strides_in(&none).len()), (0, 3));
    }

    #[test]
    fn strides_are_zero_along_repeated_axes() {
        let full = shape(&[4, 2, 3]);
        assert_eq!(shape(&[2, 1]).strides_in(&full).as_slice(), [0, 1, 0]);
        assert_eq!(full.strides_in(&full).as_slice(), [6, 3, 1]);
        assert_eq!(shape(&[]).strides_in(&full).as_slice(), [0, 0, 0]);
    }
}
