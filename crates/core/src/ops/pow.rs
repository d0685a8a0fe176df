//! Power of two arrays: `z = x^y`; `x_bar += y x^(y-1) z_bar`, `y_bar += x^y ln x z_bar`.
//!
//! # Where it is not smooth
//! At `x = 0` and below, as `power.rs` has it: `0^0` is 1 with slopes of 0, `0^y` is 0 with slope 0 to
//! `y > 0`, and below 0 a power is NaN unless `y` is whole.

use crate::broadcast::Binary;
use crate::error::TensorError;
use crate::power::{slope_to_base, slope_to_exponent};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Power;

impl<T: Scalar> Binary<T> for Power {
    const NAME: &'static str = "pow";
    const LEFT_SLOPE_FROM: [bool; 2] = [true, true];
    const RIGHT_SLOPE_FROM: [bool; 2] = [true, true];

    fn value(self, x: T, y: T) -> T {
        x.powf(y)
    }
    fn left_slope(self, x: T, y: T) -> T {
        slope_to_base(x, y)
    }
    fn right_slope(self, x: T, y: T) -> T {
        slope_to_exponent(x, y)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// `self` to the power of `exponent`, entry by entry, with broadcasting.
    ///
    /// At 0 the slope to the exponent is 0 for exponents of 0 and above; the slope to the base is
    /// infinite for exponents between 0 and 1. Below 0 a power is NaN unless the exponent is whole, and
    /// the gradient of the exponent is NaN in any case: hold it constant there, or use [`Var::powf`].
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn pow(self, exponent: Self) -> Result<Self, TensorError> {
        self.pairwise(exponent, Power)
    }
}
