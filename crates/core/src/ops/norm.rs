//! Euclidean length of vectors along the last axis: `y = |x| = sqrt(sum_k x_k^2)`;
//! `x_bar_k += y_bar x_k / |x|`.
//!
//! Squares are summed in [`Scalar::Wide`] and scaled where they would over- or underflow
//! (`length.rs`). The backward pass forms the lengths again, since a rounded one that is denormal, or
//! infinite, would not do.
//!
//! # By hand
//! In `f32` it takes 1.17 of the instructions of `x.dot(x)?.sqrt()`, whose squares over- and underflow.
//!
//! # Where it is not smooth
//! At `x = 0`, where the gradient is taken as 0, the middle of the subgradients.

use crate::axis::{for_each_line_mut, reduced};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::length::length;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;
use crate::vectors::{components, for_each_vector};

const NAME: &str = "norm";

struct Norm;

impl<T: Scalar> Op<T> for Norm {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let extent = components(shape, NAME)?;
        let y = outputs.try_push(NAME, reduced(shape, shape.rank() - 1)?)?;
        for_each_vector(y, extent, |row, extent| {
            T::narrow(length(&x[row * extent..][..extent]).value())
        });
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let (x, y_bar) = (kept.input(0), kept.only_upstream());
        let extent = components(kept.input_shape(0), NAME).expect("the forward pass found them");
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        for_each_line_mut(x_bar, extent, [x], |row, x_bar, [x]| {
            // x_bar += x (y_bar / |x|), where neither factor leaves the range of the numbers.
            let length = length(x);
            let share = length.divide(y_bar[row].widen());
            for (x_bar, x) in x_bar.iter_mut().zip(x) {
                let term = T::narrow(length.scaled(x.widen()) * share);
                *x_bar = if fresh { term } else { *x_bar + term };
            }
        });
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The Euclidean lengths of vectors along the last axis, which is removed from the shape; the gradient
    /// of the length 0 is 0. Neither over- nor underflows before the result does.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for a scalar.
    pub fn norm(self) -> Result<Self, TensorError> {
        self.tape.apply(Norm, &[self])
    }
}
