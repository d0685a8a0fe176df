//! Dense row-major arrays.

use std::fmt;
use std::ops::{Index, IndexMut};
use std::sync::Arc;

use crate::entries::Entries;
use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::shape::Shape;

/// A dense row-major array. Cloning shares the buffer; writing to one that is shared, or somebody else's, copies it
/// first.
#[derive(Clone)]
pub struct Tensor<T> {
    shape: Shape,
    data: Entries<T>,
}

impl<T: Scalar> Tensor<T> {
    /// The array of `shape` with the entries of `data`, row-major.
    ///
    /// # Errors
    /// [`TensorError::Length`] unless `data` has as many entries as the shape.
    pub fn new(shape: impl Into<Shape>, data: Vec<T>) -> Result<Self, TensorError> {
        let shape = shape.into();
        if shape.checked_size() != Some(data.len()) {
            return Err(TensorError::Length { shape, entries: data.len() });
        }
        Ok(Self { shape, data: data.into() })
    }

    /// The array of `shape` with the entries of `owner`, row-major, which are read where they lie: those of an array of
    /// another library, or of a file that is mapped.
    ///
    /// `owner` has to give the same entries each time: they may change only once nobody holds the tensor any more.
    ///
    /// # Errors
    /// [`TensorError::Length`] unless there are as many entries as the shape has.
    pub fn from_owner(
        shape: impl Into<Shape>,
        owner: Arc<dyn AsRef<[T]> + Send + Sync>,
    ) -> Result<Self, TensorError> {
        let (shape, data) = (shape.into(), Entries::from(owner));
        if shape.checked_size() != Some(data.len()) {
            return Err(TensorError::Length { shape, entries: data.len() });
        }
        Ok(Self { shape, data })
    }

    /// The array of `shape` whose entry at `[i, j, ...]` is `entry([i, j, ...])`, row by row:
    ///
    /// ```
    /// let identity = bokashi_core::Tensor::from_fn([3, 3], |[i, j]| f64::from(i == j));
    /// assert_eq!((identity[[1, 1]], identity[[1, 2]]), (1.0, 0.0));
    /// ```
    ///
    /// # Panics
    /// Where the shape has more entries than fit into memory.
    pub fn from_fn<const N: usize>(
        shape: [usize; N],
        mut entry: impl FnMut([usize; N]) -> T,
    ) -> Self {
        let mut index = [0; N];
        Self::from_flat_fn(shape, |_| {
            let here = entry(index);
            for axis in (0..N).rev() {
                index[axis] += 1;
                if index[axis] < shape[axis] {
                    break;
                }
                index[axis] = 0;
            }
            here
        })
    }

    /// The array of `shape` whose k-th entry in row-major order is `entry(k)`.
    ///
    /// # Panics
    /// Where the shape has more entries than fit into memory.
    pub fn from_flat_fn(shape: impl Into<Shape>, entry: impl FnMut(usize) -> T) -> Self {
        let shape = shape.into();
        let data: Vec<_> = (0..shape.size_to_fill::<T>()).map(entry).collect();
        Self { shape, data: data.into() }
    }

    /// The array of `shape` with every entry `value`.
    ///
    /// # Panics
    /// Where the shape has more entries than fit into memory.
    pub fn full(shape: impl Into<Shape>, value: T) -> Self {
        let shape = shape.into();
        let data = vec![value; shape.size_to_fill::<T>()];
        Self { shape, data: data.into() }
    }

    /// The array of `shape` with every entry 0.
    ///
    /// # Panics
    /// As [`Tensor::full`].
    pub fn zeros(shape: impl Into<Shape>) -> Self {
        Self::full(shape, T::ZERO)
    }

    /// The array of shape `[]` with the one entry `value`.
    pub fn scalar(value: T) -> Self {
        Self::full([], value)
    }

    /// The shape.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// The number of entries.
    pub fn size(&self) -> usize {
        self.data.len()
    }

    /// The entries, row-major.
    pub fn data(&self) -> &[T] {
        &self.data
    }

    /// The entries for writing; copies the buffer first where it is shared or somebody else's.
    pub fn data_mut(&mut self) -> &mut [T] {
        self.data.make_mut()
    }

    /// The only entry: the value of a scalar, whatever its rank.
    ///
    /// # Panics
    /// Unless there is exactly one entry.
    #[track_caller]
    pub fn item(&self) -> T {
        only(&self.shape, &self.data)
    }

    /// The same entries under another shape; the buffer is shared.
    ///
    /// # Errors
    /// [`TensorError::Length`] unless both shapes have the same number of entries.
    pub fn reshaped(&self, shape: impl Into<Shape>) -> Result<Self, TensorError> {
        let shape = shape.into();
        if shape.checked_size() != Some(self.size()) {
            return Err(TensorError::Length { shape, entries: self.size() });
        }
        Ok(Self { shape, data: self.data.clone() })
    }

    /// The array of `f(entry)`.
    pub fn map<U: Scalar>(&self, mut f: impl FnMut(T) -> U) -> Tensor<U> {
        Tensor::from_flat_fn(&self.shape, |k| f(self.data[k]))
    }

    /// The same array in another precision.
    pub fn cast<U: Scalar>(&self) -> Tensor<U> {
        self.map(|entry| U::from_f64(entry.to_f64()))
    }

    /// Whether every entry is finite.
    pub fn is_finite(&self) -> bool {
        self.data.iter().all(|entry| entry.is_finite())
    }

    /// A tensor around a buffer of the right length.
    pub(crate) fn from_parts(shape: Shape, data: Entries<T>) -> Self {
        debug_assert_eq!(shape.size(), data.len());
        Self { shape, data }
    }

    /// Shape and buffer, given up.
    pub(crate) fn into_parts(self) -> (Shape, Entries<T>) {
        (self.shape, self.data)
    }
}

/// The only one of `entries`, those of an array of `shape`.
#[track_caller]
pub(crate) fn only<T: Copy>(shape: &Shape, entries: &[T]) -> T {
    let &[entry] = entries else { panic!("`item` needs exactly one entry, got shape {shape}") };
    entry
}

impl<T> Tensor<T> {
    /// Where the entry at `index` is.
    #[track_caller]
    fn offset_of<const N: usize>(&self, index: [usize; N]) -> usize {
        let is_within =
            self.shape.rank() == N && index.iter().zip(&*self.shape).all(|(i, n)| i < n);
        assert!(is_within, "an index needs to lie within shape {}, got {index:?}", self.shape);
        index.iter().zip(&*self.shape).fold(0, |offset, (i, extent)| offset * extent + i)
    }
}

/// The entry at an index: `t[[i, j]]` of a matrix.
///
/// # Panics
/// Unless the index has an entry per axis and lies within the shape.
impl<T, const N: usize> Index<[usize; N]> for Tensor<T> {
    type Output = T;

    #[track_caller]
    fn index(&self, index: [usize; N]) -> &T {
        &self.data[self.offset_of(index)]
    }
}

/// The entry at an index for writing; copies the buffer first where it is shared.
///
/// # Panics
/// As for reading.
impl<T: Clone, const N: usize> IndexMut<[usize; N]> for Tensor<T> {
    #[track_caller]
    fn index_mut(&mut self, index: [usize; N]) -> &mut T {
        let offset = self.offset_of(index);
        &mut self.data.make_mut()[offset]
    }
}

impl<T: PartialEq> PartialEq for Tensor<T> {
    fn eq(&self, other: &Self) -> bool {
        self.shape == other.shape && *self.data == *other.data
    }
}

impl<T: fmt::Debug> fmt::Debug for Tensor<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Tensor{} {:?}", self.shape, self.data)
    }
}
