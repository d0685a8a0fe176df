//! Truth values with a shape: which entries of an array are meant. They have no gradient.

use std::fmt;
use std::ops::Not;
use std::sync::Arc;

use crate::error::TensorError;
use crate::shape::Shape;
use crate::walk::{Walk, axes};

/// A dense row-major array of truth values. Cloning shares the buffer.
///
/// It comes from a list, from a function, or from a comparison of variables
/// ([`Var::is_less`](crate::Var::is_less)), and serves [`Mask::select`]. A slope that is infinite or NaN
/// stays out of the gradient where the argument is chosen, too:
///
/// ```
/// # use bokashi_core::{Tape, Tensor};
/// let tape = Tape::<f64>::new();
/// let x = tape.leaf(&Tensor::from([0.0, 4.0]));
/// let [zero, one] = [0.0, 1.0].map(|number| tape.constant_scalar(number));
/// let is_positive = x.is_greater(zero)?;
/// let root = is_positive.select(x, one)?.sqrt();
/// let root = is_positive.select(root, zero)?;
/// assert_eq!(root.value(), Tensor::from([0.0, 2.0]));
/// assert_eq!(root.sum().backward()?.get(x), Some(&Tensor::from([0.0, 0.25])));
/// # Ok::<(), bokashi_core::TensorError>(())
/// ```
#[derive(Clone, PartialEq, Eq)]
pub struct Mask {
    shape: Shape,
    truth: Arc<Vec<bool>>,
}

impl Mask {
    /// The array of `shape` with the entries of `truth`, row-major.
    ///
    /// # Errors
    /// [`TensorError::Length`] unless `truth` has as many entries as the shape.
    pub fn new(shape: impl Into<Shape>, truth: impl Into<Vec<bool>>) -> Result<Self, TensorError> {
        let (shape, truth) = (shape.into(), truth.into());
        if shape.checked_size() != Some(truth.len()) {
            return Err(TensorError::Length { shape, entries: truth.len() });
        }
        Ok(Self { shape, truth: Arc::new(truth) })
    }

    /// The array of `shape` whose k-th entry in row-major order is `entry(k)`.
    ///
    /// # Panics
    /// Where the shape has more entries than fit into memory.
    pub fn from_flat_fn(shape: impl Into<Shape>, entry: impl FnMut(usize) -> bool) -> Self {
        let shape = shape.into();
        let truth = Arc::new((0..shape.size_to_fill::<bool>()).map(entry).collect());
        Self { shape, truth }
    }

    /// The array of `shape` whose entry at `[i, j, ...]` is `entry([i, j, ...])`.
    ///
    /// # Panics
    /// Where the shape has more entries than fit into memory.
    pub fn from_fn<const N: usize>(
        shape: [usize; N],
        mut entry: impl FnMut([usize; N]) -> bool,
    ) -> Self {
        Self::from_flat_fn(shape, |mut k| {
            let mut index = [0; N];
            for (index, extent) in index.iter_mut().zip(shape).rev() {
                (*index, k) = (k % extent, k / extent);
            }
            entry(index)
        })
    }

    /// The array of `shape` with every entry `truth`.
    ///
    /// # Panics
    /// Where the shape has more entries than fit into memory.
    pub fn full(shape: impl Into<Shape>, truth: bool) -> Self {
        Self::from_flat_fn(shape, |_| truth)
    }

    /// The shape.
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// The entries, row-major.
    pub fn data(&self) -> &[bool] {
        &self.truth
    }

    /// How many entries are true.
    pub fn count(&self) -> usize {
        self.truth.iter().filter(|truth| **truth).count()
    }

    /// The same entries under another shape; the buffer is shared.
    ///
    /// # Errors
    /// [`TensorError::Length`] unless both shapes have the same number of entries.
    pub fn reshaped(&self, shape: impl Into<Shape>) -> Result<Self, TensorError> {
        let (shape, entries) = (shape.into(), self.truth.len());
        if shape.checked_size() != Some(entries) {
            return Err(TensorError::Length { shape, entries });
        }
        Ok(Self { shape, truth: Arc::clone(&self.truth) })
    }

    /// True where both are, with broadcasting.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn and(&self, other: &Self) -> Result<Self, TensorError> {
        self.pairwise(other, "and", |a, b| a & b)
    }

    /// True where either is, with broadcasting.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn or(&self, other: &Self) -> Result<Self, TensorError> {
        self.pairwise(other, "or", |a, b| a | b)
    }

    fn pairwise(
        &self,
        other: &Self,
        operation: &'static str,
        function: fn(bool, bool) -> bool,
    ) -> Result<Self, TensorError> {
        let Some(shape) = self.shape.broadcast(&other.shape) else {
            let shapes = Box::new([self.shape.clone(), other.shape.clone()]);
            return Err(TensorError::Broadcast { operation, shapes });
        };
        let Some(size) = shape.size_in_memory::<bool>() else {
            return Err(TensorError::Memory { operation, shape });
        };
        let mut truth = Vec::with_capacity(size);
        let walk = axes([&shape, &self.shape, &other.shape]);
        Walk::new(walk).for_each(|[_, i, j]| truth.push(function(self.truth[i], other.truth[j])));
        Ok(Self { shape, truth: Arc::new(truth) })
    }

    /// Makes this a mask of `shape` and gives its entries for writing: those that were there, where
    /// nobody else holds them.
    ///
    /// # Errors
    /// [`TensorError::Memory`] for more of them than there is room for.
    pub(crate) fn renew(
        &mut self,
        shape: Shape,
        operation: &'static str,
    ) -> Result<&mut [bool], TensorError> {
        let Some(size) = shape.size_in_memory::<bool>() else {
            return Err(TensorError::Memory { operation, shape });
        };
        if Arc::get_mut(&mut self.truth).is_none() {
            self.truth = Arc::default();
        }
        let truth = Arc::get_mut(&mut self.truth).expect("nobody else holds it");
        truth.resize(size, false);
        self.shape = shape;
        Ok(truth)
    }
}

/// A mask without entries.
impl Default for Mask {
    fn default() -> Self {
        Self { shape: [0].into(), truth: Arc::default() }
    }
}

/// True where the mask is not.
impl Not for &Mask {
    type Output = Mask;

    fn not(self) -> Mask {
        let truth = self.truth.iter().map(|truth| !truth).collect();
        Mask { shape: self.shape.clone(), truth: Arc::new(truth) }
    }
}

/// True where the mask is not.
impl Not for Mask {
    type Output = Self;

    fn not(self) -> Self {
        !&self
    }
}

/// `[n]`.
impl From<Vec<bool>> for Mask {
    fn from(truth: Vec<bool>) -> Self {
        Self { shape: [truth.len()].into(), truth: Arc::new(truth) }
    }
}

/// `[n]`.
impl From<&[bool]> for Mask {
    fn from(truth: &[bool]) -> Self {
        truth.to_vec().into()
    }
}

/// `[N]`.
impl<const N: usize> From<[bool; N]> for Mask {
    fn from(truth: [bool; N]) -> Self {
        truth.to_vec().into()
    }
}

impl fmt::Debug for Mask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Mask{} {:?}", self.shape, self.truth)
    }
}
