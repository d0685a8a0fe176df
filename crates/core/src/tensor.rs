//! Dense row-major arrays.

use std::fmt;
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

    /// The array of `shape` whose k-th entry in row-major order is `entry(k)`.
    ///
    /// # Panics
    /// Where the shape has more entries than fit an index.
    pub fn from_fn(shape: impl Into<Shape>, entry: impl FnMut(usize) -> T) -> Self {
        let shape = shape.into();
        let data = (0..shape.size()).map(entry).collect();
        Self { shape, data: Arc::new(data) }
    }

    /// The array of `shape` with every entry `value`.
    pub fn full(shape: impl Into<Shape>, value: T) -> Self {
        let shape = shape.into();
        let data = vec![value; shape.size()];
        Self { shape, data: Arc::new(data) }
    }

    /// The array of `shape` with every entry 0.
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

    /// The first entry: the value of a scalar.
    ///
    /// # Panics
    /// Where there is no entry.
    pub fn item(&self) -> T {
        self.data[0]
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
        Tensor::from_fn(&self.shape, |k| f(self.data[k]))
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
    fn writing_to_a_shared_buffer_leaves_the_other_holder_alone() {
        let a = Tensor::full([2], 1.0_f64);
        let mut b = a.clone();
        b.data_mut()[0] = 2.0;
        assert_eq!(a.data(), [1.0, 1.0]);
        assert_eq!(b.data(), [2.0, 1.0]);
    }

    #[test]
    fn reshaping_keeps_entries_and_count() {
        let a = Tensor::from_fn([2, 3], |k| k as f32);
        assert_eq!(a.reshaped([3, 2]).unwrap().data(), a.data());
        assert!(a.reshaped([4]).is_err());
    }
}
