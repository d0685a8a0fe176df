//! Mean of all entries, or along one axis: `m = sum_k x_k / n`; `x_bar_k += m_bar / n`.
//!
//! Summed and divided in [`Scalar::Wide`]. A mean of nothing is an error.

use crate::error::TensorError;
use crate::reduction::Reduction;
use crate::scalar::Scalar;
use crate::var::Var;

/// The mean along an axis, or of all entries.
const fn op(axis: Option<usize>) -> Reduction {
    Reduction { name: "mean", axis, is_mean: true }
}

impl<T: Scalar> Var<'_, T> {
    /// The mean of all entries, of shape `[]`.
    ///
    /// # Errors
    /// [`TensorError::Shape`] where there is no entry.
    pub fn mean(self) -> Result<Self, TensorError> {
        self.tape.apply(op(None), &[self])
    }

    /// The means along `axis`, which is removed from the shape.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis; [`TensorError::Shape`] where its extent
    /// is 0.
    pub fn mean_axis(self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(op(Some(axis)), &[self])
    }
}
