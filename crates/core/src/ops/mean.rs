//! Mean of all entries, or along one axis: `m = sum_k x_k / n`; `x_bar_k += m_bar / n`.
//!
//! Summed and divided in [`Scalar::Wide`]. A mean of nothing is an error.

use crate::axis::{blocks, reduced, spread_along, sum_along};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::summation::sum;
use crate::var::Var;

struct Mean {
    /// The axis, or all of them.
    axis: Option<usize>,
}

impl Mean {
    const NAME: &'static str = "mean";

    /// `shape` seen as `[outer, number of entries of one mean, inner]`.
    fn blocks(&self, shape: &Shape) -> Result<[usize; 3], TensorError> {
        self.axis.map_or(Ok([1, shape.size(), 1]), |axis| blocks(shape, axis, Self::NAME))
    }
}

impl<T: Scalar> Op<T> for Mean {
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
        let (shape, x) = (inputs.shape(0), inputs.data(0));
        let blocks = self.blocks(shape)?;
        let [_, count, _] = blocks;
        if count == 0 {
            let rule = "at least one entry to take the mean of".into();
            return Err(TensorError::Shape { operation: Self::NAME, rule, shape: shape.clone() });
        }
        let count = T::Wide::from_f64(count as f64);
        match self.axis {
            None => {
                let total = sum::<T>(x.len(), |k| x[k].widen());
                outputs.push(Shape::default())[0] = T::narrow(total / count);
            }
            Some(axis) => {
                let means = outputs.try_push(Self::NAME, reduced(shape, axis)?)?;
                sum_along(x, blocks, means, |total| T::narrow(total / count));
            }
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let m_bar = kept.only_upstream();
        let blocks = self.blocks(kept.input_shape(0)).expect("the forward pass found the axis");
        let [_, count, _] = blocks;
        let count = T::from_f64(count as f64);
        match self.axis {
            None => {
                let share = m_bar[0] / count;
                x_bar.add_zipped([], |[]| share);
            }
            Some(_) => spread_along(m_bar, blocks, x_bar.entries(), |m_bar| m_bar / count),
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The mean of all entries, of shape `[]`.
    ///
    /// # Errors
    /// [`TensorError::Shape`] where there is no entry.
    pub fn mean(self) -> Result<Self, TensorError> {
        self.tape.apply(Mean { axis: None }, &[self])
    }

    /// The means along `axis`, which is removed from the shape.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis; [`TensorError::Shape`] where its extent
    /// is 0.
    pub fn mean_axis(self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(Mean { axis: Some(axis) }, &[self])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn the_mean_of_equal_numbers_is_that_number() {
        let tape = Tape::<f32>::new();
        let tenths = tape.leaf(&Tensor::full([7, 1000], 0.1));
        assert_eq!(tenths.mean().unwrap().item(), 0.1);
        assert_eq!(tenths.mean_axis(0).unwrap().value(), Tensor::full([1000], 0.1));
        assert_eq!(tenths.mean_axis(1).unwrap().value(), Tensor::full([7], 0.1));
    }

    #[test]
    fn every_entry_gets_the_same_share() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn([2, 4], |k| k as f64));
        let all = x.mean().unwrap().backward().unwrap();
        assert_eq!(all.get(x), Some(&Tensor::full([2, 4], 1.0 / 8.0)));
        let rows = x.mean_axis(1).unwrap().sum().backward().unwrap();
        assert_eq!(rows.get(x), Some(&Tensor::full([2, 4], 1.0 / 4.0)));
    }

    #[test]
    fn a_mean_of_nothing_is_refused() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&Tensor::zeros([2, 0]));
        let message = "mean needs at least one entry to take the mean of, got shape [2, 0]";
        assert_eq!(x.mean().unwrap_err().to_string(), message);
        assert_eq!(x.mean_axis(1).unwrap_err().to_string(), message);
        assert_eq!(x.mean_axis(0).unwrap().shape(), Shape::from([0]));
        assert!(x.mean_axis(2).is_err());
    }
}
