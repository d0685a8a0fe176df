//! Arrays one after another along an axis; each gets its own part of the upstream gradient.

use crate::axis::blocks;
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::joining::{add_part, join};
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;

struct Concat {
    axis: usize,
}

impl Concat {
    const NAME: &'static str = "concat";
}

impl<T: Scalar> Op<T> for Concat {
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
        let shape = inputs.shape(0);
        let [_, mut extent, inner] = blocks(shape, self.axis, Self::NAME)?;
        for other in (1..inputs.len()).map(|i| inputs.shape(i)) {
            let joined = other.get(self.axis).copied().unwrap_or_default();
            if other.rank() != shape.rank() || other.with(self.axis, shape[self.axis]) != *shape {
                return Err(TensorError::Mismatch {
                    operation: Self::NAME,
                    rule: "shapes that agree outside the joined axis".into(),
                    shapes: Box::new([shape.clone(), other.clone()]),
                });
            }
            extent += joined;
        }
        if inputs.len() == 1 {
            outputs.pass(0, "a single part");
            return Ok(());
        }
        let length = |i: usize| inputs.shape(i)[self.axis] * inner;
        join(inputs, length, outputs.try_push(Self::NAME, shape.with(self.axis, extent))?);
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let z_bar = kept.only_upstream();
        let [_, extent, inner] = blocks(kept.output_shape(0), self.axis, Self::NAME)
            .expect("the forward pass found the axis");
        let mut start = 0;
        for i in 0..kept.input_count() {
            let length = kept.input_shape(i)[self.axis].saturating_mul(inner);
            let end = length.saturating_add(start);
            if let Some(x_bar) = gradients.get(i) {
                add_part(x_bar, z_bar, start..end, extent.saturating_mul(inner));
            }
            start = end;
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// `parts` one after another along `axis`.
    ///
    /// # Errors
    /// [`TensorError::Inputs`] without any part; [`TensorError::Axis`] unless there is such an
    /// axis; [`TensorError::Mismatch`] unless the shapes agree outside it.
    pub fn concat(parts: &[Self], axis: usize) -> Result<Self, TensorError> {
        let Some(first) = parts.first() else {
            let (operation, rule) = (Concat::NAME, "at least one part".into());
            return Err(TensorError::Inputs { operation, rule, given: 0 });
        };
        first.tape.apply(Concat { axis }, parts)
    }
}
