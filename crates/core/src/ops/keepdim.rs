//! An axis of extent 1, where a reduction removed one: a reshape.

use crate::axis::with_new_axis;
use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::var::Var;

impl<T: Scalar> Var<'_, T> {
    /// The same entries with an axis of extent 1 before `axis`, or at the end: what a reduction along
    /// `axis` removed, so that its result broadcasts against its input.
    ///
    /// ```
    /// # let tape = bokashi_core::Tape::<f64>::new();
    /// # let x = tape.leaf_full([5, 3], 2.0);
    /// let centred = x.try_sub(x.mean_axis(1)?.keepdim(1)?)?;
    /// # assert_eq!(centred.value(), bokashi_core::Tensor::zeros([5, 3]));
    /// # Ok::<(), bokashi_core::TensorError>(())
    /// ```
    ///
    /// # Errors
    /// [`TensorError::Value`] where `axis` is beyond the rank.
    pub fn keepdim(self, axis: usize) -> Result<Self, TensorError> {
        self.reshape(with_new_axis(&self.shape(), axis, 1, "keepdim")?)
    }
}
