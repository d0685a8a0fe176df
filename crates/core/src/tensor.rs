//! Dense row-major arrays.

use std::fmt;
use std::ops::{Index, IndexMut};
use std::sync::Arc;

use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::shape::Shape;

/// A dense row-major array. Cloning shares the buffer; writing to a shared buffer copies it first.
#[derive(Clone)]
pub struct Tensor<T> {
    shape: Shape,
    data: Arc<Vec<T>>,
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
        Ok(Self { shape, data: Arc::new(data) })
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
        let mut at = [0; N];
        Self::from_flat_fn(shape, |_| {
            let here = entry(at);
            for axis in (0..N).rev() {
                at[axis] += 1;
                if at[axis] < shape[axis] {
                    break;
                }
                at[axis] = 0;
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
        let data = (0..shape.size_to_fill::<T>()).map(entry).collect();
        Self { shape, data: Arc::new(data) }
    }

    /// The array of `shape` with every entry `value`.
    ///
    /// # Panics
    /// Where the shape has more entries than fit into memory.
    pub fn full(shape: impl Into<Shape>, value: T) -> Self {
        let shape = shape.into();
        let data = vec![value; shape.size_to_fill::<T>()];
        Self { shape, data: Arc::new(data) }
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

    /// The entries for writing; copies the buffer first where it is shared.
    pub fn data_mut(&mut self) -> &mut [T] {
        Arc::make_mut(&mut self.data).as_mut_slice()
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
        Ok(Self { shape, data: Arc::clone(&self.data) })
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
    pub(crate) fn from_parts(shape: Shape, data: Arc<Vec<T>>) -> Self {
        debug_assert_eq!(shape.size(), data.len());
        Self { shape, data }
    }

    /// Shape and buffer, given up.
    pub(crate) fn into_parts(self) -> (Shape, Arc<Vec<T>>) {
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
    fn place<const N: usize>(&self, index: [usize; N]) -> usize {
        let is_within =
            self.shape.rank() == N && index.iter().zip(&*self.shape).all(|(i, n)| i < n);
        assert!(is_within, "an index needs to lie within shape {}, got {index:?}", self.shape);
        index.iter().zip(&*self.shape).fold(0, |place, (i, extent)| place * extent + i)
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
        &self.data[self.place(index)]
    }
}

/// The entry at an index for writing; copies the buffer first where it is shared.
///
/// # Panics
/// As for reading.
impl<T: Clone, const N: usize> IndexMut<[usize; N]> for Tensor<T> {
    #[track_caller]
    fn index_mut(&mut self, index: [usize; N]) -> &mut T {
        let place = self.place(index);
        &mut Arc::make_mut(&mut self.data)[place]
    }
}

impl<T: PartialEq> PartialEq for Tensor<T> {
    fn eq(&self, other: &Self) -> bool {
        self.shape == other.shape && self.data == other.data
    }
}

impl<T: fmt::Debug> fmt::Debug for Tensor<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Tensor{} {:?}", self.shape, self.data)
    }
}

#[cfg(test)]
mod tests {
    use std::panic::catch_unwind;

    use super::*;

    #[test]
    fn data_must_fill_the_shape() {
        let error = Tensor::new([2, 3], vec![0.0_f32; 5]).unwrap_err();
        assert_eq!(error.to_string(), "shape [2, 3] needs 6 entries, got 5");
        assert!(Tensor::new([0, 3], Vec::<f32>::new()).is_ok());
        // A product that wraps around is no match.
        let huge = Tensor::new([1 << 33, 1 << 31], Vec::<f32>::new()).unwrap_err();
        assert_eq!(
            huge.to_string(),
            "shape [8589934592, 2147483648] needs more entries than fit an index, got 0"
        );
    }

    #[test]
    fn entries_by_index_are_those_in_row_major_order() {
        let mut t = Tensor::from_fn([2, 3, 2], |[i, j, k]| (100 * i + 10 * j + k) as f64);
        assert_eq!(t.data()[..4], [0.0, 1.0, 10.0, 11.0]);
        assert_eq!((t[[1, 2, 0]], t.data()[10]), (120.0, 120.0));
        let shared = t.clone();
        t[[1, 2, 0]] = 7.0;
        assert_eq!((t[[1, 2, 0]], t.data()[10], shared[[1, 2, 0]]), (7.0, 7.0, 120.0));
        let mut scalar = Tensor::from_fn([], |[]| 3.0_f32);
        scalar[[]] += 1.0;
        assert_eq!((scalar[[]], scalar.item()), (4.0, 4.0));
        assert_eq!(Tensor::from_flat_fn([2, 0], |_| 1.0_f32).size(), 0);
    }

    #[test]
    fn an_index_outside_the_shape_is_refused_even_where_the_buffer_has_a_place() {
        let t = Tensor::<f64>::zeros([2, 3]);
        for wrong in [
            catch_unwind(|| t[[0, 3]]),
            catch_unwind(|| t[[2, 0]]),
            catch_unwind(|| t[[1]]),
            catch_unwind(|| t[[0, 0, 0]]),
        ] {
            let said = *wrong.unwrap_err().downcast::<String>().unwrap();
            assert!(said.starts_with("an index needs to lie within shape [2, 3], got ["), "{said}");
        }
    }

    #[test]
    #[should_panic(expected = "`item` needs exactly one entry, got shape [2]")]
    fn an_item_is_the_only_one() {
        assert_eq!(Tensor::full([1, 1], 5.0_f64).item(), 5.0);
        Tensor::<f32>::zeros([2]).item();
    }

    #[test]
    fn writing_to_a_shared_buffer_leaves_the_other_holder_alone() {
        let a = Tensor::full([2], 1.0_f64);
        let mut b = a.clone();
        b.data_mut()[0] = 2.0;
        assert_eq!(a.data(), [1.0, 1.0]);
        assert_eq!(b.data(), [2.0, 1.0]);
    }

    #[test]
    fn reshaping_keeps_entries_and_count() {
        let a = Tensor::from_flat_fn([2, 3], |k| k as f32);
        assert_eq!(a.reshaped([3, 2]).unwrap().data(), a.data());
        assert!(a.reshaped([4]).is_err());
    }
}
