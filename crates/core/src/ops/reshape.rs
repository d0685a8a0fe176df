//! The same entries under another shape: `y = x`; `x_bar += y_bar`. The buffer is shared.

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;

struct Reshape {
    shape: Shape,
}

impl<T: Scalar> Op<T> for Reshape {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "reshape"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (shape, entries) = (&self.shape, inputs.data(0).len());
        if shape == inputs.shape(0) {
            outputs.pass(0, "the shape is the same");
        } else if shape.checked_size() == Some(entries) {
            outputs.push_renamed(shape, 0);
        } else {
            return Err(TensorError::Length { shape: shape.clone(), entries });
        }
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        if let Some(x_bar) = gradients.get(0) {
            x_bar.add(kept.only_upstream());
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The same entries, in row-major order, under another shape.
    ///
    /// # Errors
    /// [`TensorError::Length`] unless both shapes have the same number of entries.
    pub fn reshape(self, shape: impl Into<Shape>) -> Result<Self, TensorError> {
        self.tape.apply(Reshape { shape: shape.into() }, &[self])
    }
}

#[cfg(test)]
mod tests {
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn the_buffer_is_shared_and_outlives_the_step() {
        let mut tape = Tape::new();
        let x = tape.leaf_copied(&Tensor::from_flat_fn([2, 3], |k| k as f64));
        let y = x.reshape([6]).unwrap();
        assert_eq!(x.value().data().as_ptr(), y.value().data().as_ptr());
        let held = y.value();
        tape.reset();
        let _ = tape.constant_full([6], 9.0) + tape.constant_full([6], 9.0);
        assert_eq!(held.data(), [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    }

    #[test]
    fn a_shared_buffer_goes_back_to_the_pool_once() {
        let mut tape = Tape::new();
        for _ in 0..3 {
            let x = tape.leaf_copied(&Tensor::full([4], 1.0));
            let y = x.reshape([2, 2]).unwrap().reshape([4]).unwrap();
            let [a, b] = [2.0, 3.0].map(|value| tape.constant_full([4], value));
            assert_eq!([a, b, y].map(|of| of.value()[[3]]), [2.0, 3.0, 1.0]);
            tape.reset();
        }
    }
}
