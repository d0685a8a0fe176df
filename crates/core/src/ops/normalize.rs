//! Vectors along the last axis divided by their Euclidean length: `y = x / |x|`;
//! `x_bar += (y_bar - y <y, y_bar>) / |x|`.
//!
//! Formed in [`Scalar::Wide`], and scaled where squares would over- or underflow (`length.rs`).
//!
//! # Where it is not smooth
//! At `x = 0`, where `y` is 0 and the gradient is taken as 0.

use crate::axis::{for_each_line_mut, for_each_short_line_mut};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::length::length;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;
use crate::vectors::components;

const NAME: &str = "normalize";

struct Normalize;

/// Adds to the gradient of a vector `x`, or writes it, from that of `x / |x|`.
#[inline(always)]
fn pull_back<T: Scalar>(x_bar: &mut [T], [x, y_bar]: [&[T]; 2], fresh: bool) {
    let length = length(x);
    let per_size = length.divide(T::Wide::ONE);
    let mut product = T::Wide::ZERO;
    for (x, y_bar) in x.iter().zip(y_bar) {
        product += length.scaled(x.widen()) * y_bar.widen();
    }
    let share = product * per_size * per_size;
    for ((x_bar, x), y_bar) in x_bar.iter_mut().zip(x).zip(y_bar) {
        let across = y_bar.widen() - length.scaled(x.widen()) * share;
        let term = T::narrow(length.scaled(across * per_size));
        *x_bar = if fresh { term } else { *x_bar + term };
    }
}

impl<T: Scalar> Op<T> for Normalize {
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
        for_each_line_mut(outputs.push(shape), extent, [x], |_, y, [x]| {
            let length = length(x);
            for (y, x) in y.iter_mut().zip(x) {
                *y = T::narrow(length.divide(length.scaled(x.widen())));
            }
        });
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        // Lengths are formed again: that is quicker than to read them.
        Keep::NOTHING.input(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let extent = components(kept.input_shape(0), NAME).expect("the forward pass found them");
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        let from = [kept.input(0), kept.only_upstream()];
        match extent {
            // By itself, so that its loops are of a known length.
            3 => for_each_short_line_mut::<T, 3, 2>(x_bar, from, |_, x_bar, from| {
                pull_back(x_bar, from, fresh);
            }),
            _ => for_each_line_mut(x_bar, extent, from, |_, x_bar, from| {
                pull_back(x_bar, from, fresh);
            }),
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Vectors along the last axis divided by their Euclidean lengths, in the same shape. A vector of zeros
    /// stays, and has the gradient 0. Nothing over- or underflows before the result does.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for a scalar.
    pub fn normalize(self) -> Result<Self, TensorError> {
        self.tape.apply(Normalize, &[self])
    }
}
