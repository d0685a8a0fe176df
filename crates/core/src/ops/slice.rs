//! Part of an axis: `y_i = x_(start + i)`, `i < end - start`; `x_bar_(start + i) += y_bar_i`.

use std::ops::Range;

use crate::axis::blocks;
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;

struct Slice {
    axis: usize,
    range: Range<usize>,
}

impl Slice {
    const NAME: &'static str = "slice";

    /// Where in `x: [outer, extent, inner]` each part lies, one per outer index.
    fn parts(&self, [outer, extent, inner]: [usize; 3]) -> impl Iterator<Item = Range<usize>> {
        let (start, end) = (self.range.start * inner, self.range.end * inner);
        (0..outer).map(move |block| {
            let first = block * extent * inner;
            first + start..first + end
        })
    }
}

impl<T: Scalar> Op<T> for Slice {
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
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let blocks = blocks(shape, self.axis, Self::NAME)?;
        let [_, extent, _] = blocks;
        let Range { start, end } = self.range;
        if start > end || end > extent {
            let range = self.range.clone();
            return Err(TensorError::Range { operation: Self::NAME, range, extent });
        }
        if (start, end) == (0, extent) {
            outputs.pass(0, "the whole axis");
            return Ok(());
        }
        let mut y = outputs.push(shape.with(self.axis, end - start));
        for part in self.parts(blocks) {
            let (head, rest) = y.split_at_mut(part.len());
            head.copy_from_slice(&x[part]);
            y = rest;
        }
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let (x_bar, mut y_bar) = (x_bar.entries(), kept.only_upstream());
        let blocks = blocks(kept.input_shape(0), self.axis, Self::NAME);
        for part in self.parts(blocks.expect("the forward pass found the axis")) {
            let (head, rest) = y_bar.split_at(part.len());
            x_bar[part].iter_mut().zip(head).for_each(|(x_bar, &y_bar)| *x_bar += y_bar);
            y_bar = rest;
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The entries whose index along `axis` lies in `range`.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis; [`TensorError::Range`] unless the range
    /// lies within it.
    pub fn slice(self, axis: usize, range: Range<usize>) -> Result<Self, TensorError> {
        self.tape.apply(Slice { axis, range }, &[self])
    }
}
