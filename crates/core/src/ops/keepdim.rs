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

#[cfg(test)]
mod tests {
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn the_buffer_is_shared_and_the_shape_that_of_the_reduced_array_with_extent_one() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn([2, 3, 4], |k| k as f64));
        for axis in 0..3 {
            let sum = x.sum_axis(axis).unwrap();
            let kept = sum.keepdim(axis).unwrap();
            let mut expected = [2, 3, 4];
            expected[axis] = 1;
            assert_eq!(*kept.shape(), expected);
            assert_eq!(kept.value().data().as_ptr(), sum.value().data().as_ptr());
            let gradients = kept.square().sum().backward().unwrap();
            let apart = sum.square().sum().backward().unwrap();
            assert_eq!(gradients.get(x), apart.get(x));
        }
        let message = "keepdim needs a new axis up to the rank 3, got 4";
        assert_eq!(x.keepdim(4).unwrap_err().to_string(), message);
        assert_eq!(*tape.leaf_scalar(1.0).keepdim(0).unwrap().shape(), [1]);
    }
}
