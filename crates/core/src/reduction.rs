//! Sums and means of all entries, or along one axis, formed in [`Scalar::Wide`].

use crate::axis::{blocks, reduced, spread_along, sum_along};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::summation::sum;

/// A sum, or a mean: `y = sum_k x_k / n`, with 1 or the number of entries as n; `x_bar_k += y_bar / n`.
pub(crate) struct Reduction {
    pub(crate) name: &'static str,
    /// The axis, or all of them.
    pub(crate) axis: Option<usize>,
    pub(crate) is_mean: bool,
}

impl Reduction {
    /// `shape` seen as `[outer, number of entries of one sum, inner]`.
    fn blocks(&self, shape: &Shape) -> Result<[usize; 3], TensorError> {
        self.axis.map_or(Ok([1, shape.size(), 1]), |axis| blocks(shape, axis, self.name))
    }
}

impl<T: Scalar> Op<T> for Reduction {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        self.name
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (shape, x) = (inputs.shape(0), inputs.data(0));
        let blocks = self.blocks(shape)?;
        let [_, count, _] = blocks;
        if self.is_mean && count == 0 {
            let rule = "at least one entry to take the mean of".into();
            return Err(TensorError::Shape { operation: self.name, rule, shape: shape.clone() });
        }
        let count = T::Wide::from_f64(count as f64);
        let round = |total| T::narrow(if self.is_mean { total / count } else { total });
        match self.axis {
            None => outputs.push([])[0] = round(sum::<T>(x.len(), |k| x[k].widen())),
            Some(axis) => {
                let results = outputs.try_push(self.name, reduced(shape, axis)?)?;
                sum_along(x, blocks, results, round);
            }
        }
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let y_bar = kept.only_upstream();
        let blocks = self.blocks(kept.input_shape(0)).expect("the forward pass found the axis");
        let [_, count, _] = blocks;
        let count = T::from_f64(count as f64);
        let share = |y_bar: T| if self.is_mean { y_bar / count } else { y_bar };
        match self.axis {
            None => {
                let share = share(y_bar[0]);
                x_bar.add_zipped([], |[]| share);
            }
            Some(_) => spread_along(y_bar, blocks, x_bar.entries(), share),
        }
    }
}
