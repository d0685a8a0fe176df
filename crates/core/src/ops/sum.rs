//! Sum of all entries, or along one axis: `s = sum_k x_k`; `x_bar_k += s_bar`.
//!
//! Summed in [`Scalar::Wide`], so in `f32` a sum is rounded once. A sum of nothing is 0.

use crate::error::TensorError;
use crate::reduction::Reduction;
use crate::scalar::Scalar;
use crate::var::Var;

/// The sum along an axis, or of all entries.
const fn op(axis: Option<usize>) -> Reduction {
    Reduction { name: "sum", axis, is_mean: false }
}

impl<T: Scalar> Var<'_, T> {
    /// The sum of all entries, of shape `[]`.
    #[must_use]
    pub fn sum(self) -> Self {
        self.tape.apply(op(None), &[self]).expect("any entries have a sum")
    }

    /// The sums along `axis`, which is removed from the shape.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis.
    pub fn sum_axis(self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(op(Some(axis)), &[self])
    }
}
