//! Truth values from comparisons of variables. They go by value, and have no gradient.

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::mask::Mask;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::parallel::for_each_zipped_mut;
use crate::scalar::Scalar;
use crate::var::Var;
use crate::walk::{Walk, axes};

/// What holds of each pair of entries. It has no output: its result is what it saves.
struct Comparison<F> {
    name: &'static str,
    holds: F,
}

impl<T: Scalar, F: Fn(T, T) -> bool + Copy + Send + Sync + 'static> Op<T> for Comparison<F> {
    type Saved = Mask;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        self.name
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        _outputs: &mut Outputs<'_, T>,
        saved: &mut Mask,
    ) -> Result<(), TensorError> {
        let (left, right) = (inputs.shape(0), inputs.shape(1));
        let (x, y) = (inputs.data(0), inputs.data(1));
        let shape = left.broadcast(right).ok_or_else(|| TensorError::Broadcast {
            operation: self.name,
            shapes: Box::new([left.clone(), right.clone()]),
        })?;
        let walk = Walk::new(axes([&shape, left, right]).map(|(n, [_, i, j])| (n, [i, j])));
        let is_whole = left == right;
        let truth = saved.renew(shape, self.name)?;
        let holds = |truth: &mut bool, [x, y]: [T; 2]| *truth = (self.holds)(x, y);
        if is_whole {
            for_each_zipped_mut(truth, [x, y], holds);
        } else {
            walk.zip_mut(truth, [x, y], holds);
        }
        Ok(())
    }

    fn backward(&self, _: &Kept<'_, T>, _: &mut Mask, _: &mut Accumulators<'_, T>) {}

    fn saved_bytes(&self, saved: &Mask) -> usize {
        saved.data().len()
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Records where `holds` of each pair of entries.
    fn compare(
        self,
        other: Self,
        name: &'static str,
        holds: impl Fn(T, T) -> bool + Copy + Send + Sync + 'static,
    ) -> Result<Mask, TensorError> {
        let op = Comparison { name, holds };
        Ok(self.tape.record_with(op, &[self, other], Mask::clone)?.1)
    }

    /// Where `self < other`, with broadcasting; nowhere beside a NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn is_less(self, other: Self) -> Result<Mask, TensorError> {
        self.compare(other, "is_less", |x, y| x < y)
    }

    /// Where `self <= other`, with broadcasting; nowhere beside a NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn is_at_most(self, other: Self) -> Result<Mask, TensorError> {
        self.compare(other, "is_at_most", |x, y| x <= y)
    }

    /// Where `self > other`, with broadcasting; nowhere beside a NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn is_greater(self, other: Self) -> Result<Mask, TensorError> {
        self.compare(other, "is_greater", |x, y| x > y)
    }

    /// Where `self >= other`, with broadcasting; nowhere beside a NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn is_at_least(self, other: Self) -> Result<Mask, TensorError> {
        self.compare(other, "is_at_least", |x, y| x >= y)
    }

    /// Where an entry is neither infinite nor NaN.
    pub fn is_finite(self) -> Mask {
        self.compare(self, "is_finite", |x, _| x.is_finite()).expect("a shape is its own")
    }
}
