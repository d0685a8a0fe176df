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
