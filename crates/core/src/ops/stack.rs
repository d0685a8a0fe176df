//! Arrays of one shape side by side along a new axis; each gets its own part of the upstream gradient.

use crate::axis::{blocks, with_new_axis};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::joining::{add_part, join};
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;

struct Stack {
    axis: usize,
}

impl Stack {
    const NAME: &'static str = "stack";
}

impl<T: Scalar> Op<T> for Stack {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (shape, count) = (inputs.shape(0), inputs.len());
        if let Some(other) = (1..count).map(|i| inputs.shape(i)).find(|other| *other != shape) {
            return Err(TensorError::Mismatch {
                operation: Self::NAME,
                rule: "parts of one shape".into(),
                shapes: Box::new([shape.clone(), other.clone()]),
            });
        }
        let stacked = with_new_axis(shape, self.axis, count, Self::NAME)?;
        if count == 1 {
            outputs.push_renamed(stacked, 0);
            return Ok(());
        }
        let [_, _, inner] = blocks(&stacked, self.axis, Self::NAME)?;
        join(inputs, |_| inner, outputs.try_push(Self::NAME, stacked)?);
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let [_, count, inner] = blocks(kept.output_shape(0), self.axis, Self::NAME)
            .expect("the forward pass made the axis");
        for i in 0..kept.input_count() {
            if let Some(x_bar) = gradients.get(i) {
                let [start, end, size] = [i, i + 1, count].map(|n| inner.saturating_mul(n));
                add_part(x_bar, kept.only_upstream(), start..end, size);
            }
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// `parts` of one shape side by side along a new axis, which stands before `axis`, or at the end:
    /// three of `[n]` along axis 1 are `[n, 3]`.
    ///
    /// # Errors
    /// [`TensorError::Inputs`] without any part; [`TensorError::Mismatch`] unless all have one shape;
    /// [`TensorError::Value`] where `axis` is beyond their rank.
    pub fn stack(parts: &[Self], axis: usize) -> Result<Self, TensorError> {
        let Some(first) = parts.first() else {
            let (operation, rule) = (Stack::NAME, "at least one part".into());
            return Err(TensorError::Inputs { operation, rule, given: 0 });
        };
        first.tape.apply(Stack { axis }, parts)
    }
}
