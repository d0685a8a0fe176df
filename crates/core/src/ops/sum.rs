//! Sum of all entries, or along one axis: `s = sum_k x_k`; `x_bar_k += s_bar`.
//!
//! Summed in [`Scalar::Wide`], so in `f32` a sum is rounded once. A sum of nothing is 0.

use crate::axis::{blocks, reduced, spread_along, sum_along};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::summation::sum;
use crate::var::Var;

struct Sum {
    /// The axis, or all of them.
    axis: Option<usize>,
}

impl Sum {
    const NAME: &'static str = "sum";
}

impl<T: Scalar> Op<T> for Sum {
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
        let Some(axis) = self.axis else {
            outputs.push(Shape::default())[0] = T::narrow(sum::<T>(x.len(), |k| x[k].widen()));
            return Ok(());
        };
        let blocks = blocks(shape, axis, Self::NAME)?;
        let sums = outputs.try_push(Self::NAME, reduced(shape, axis)?)?;
        sum_along(x, blocks, sums, T::narrow);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let s_bar = kept.only_upstream();
        match self.axis {
            None => x_bar.add_zipped([], |[]| s_bar[0]),
            Some(axis) => {
                let blocks = blocks(kept.input_shape(0), axis, Self::NAME);
                let blocks = blocks.expect("the forward pass found the axis");
                spread_along(s_bar, blocks, x_bar.entries(), |s_bar| s_bar);
            }
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The sum of all entries, of shape `[]`.
    #[must_use]
    pub fn sum(self) -> Self {
        self.tape.apply(Sum { axis: None }, &[self]).expect("any entries have a sum")
    }

    /// The sums along `axis`, which is removed from the shape.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis.
    pub fn sum_axis(self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(Sum { axis: Some(axis) }, &[self])
    }
}

#[cfg(test)]
mod tests {
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn a_sum_of_nothing_is_zero() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&Tensor::zeros([2, 0]));
        assert_eq!(x.sum().item(), 0.0);
        assert_eq!(x.sum_axis(1).unwrap().value(), Tensor::zeros([2]));
        assert_eq!(x.sum_axis(0).unwrap().value(), Tensor::zeros([0]));
        assert_eq!(x.sum().backward().unwrap().get_or_zeros(x).size(), 0);
    }

    #[test]
    fn sums_along_every_axis_by_hand() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn([2, 3], |k| k as f64));
        assert_eq!(x.sum().item(), 15.0);
        assert_eq!(x.sum_axis(0).unwrap().value(), Tensor::new([3], vec![3.0, 5.0, 7.0]).unwrap());
        assert_eq!(x.sum_axis(1).unwrap().value(), Tensor::new([2], vec![3.0, 12.0]).unwrap());
    }

    #[test]
    fn a_sum_in_f32_is_rounded_once() {
        let tape = Tape::<f32>::new();
        let tenths = tape.leaf(&Tensor::full([1 << 20], 0.1));
        let exact = f64::from(0.1_f32) * f64::from(1 << 20);
        assert_eq!(tenths.sum().item(), exact as f32);
    }
}
