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

#[cfg(test)]
mod tests {
    use crate::broadcast::value_and_slopes;
    use crate::tape::Tape;

    #[test]
    fn value_and_slopes_by_hand() {
        let of = |x: f64, y| value_and_slopes(x, y, |x, y| x.pow(y).unwrap());
        assert_eq!(of(2.0, 3.0), [8.0, 12.0, 8.0 * 2.0_f64.ln()]);
        assert_eq!(of(1.0, -7.0), [1.0, -7.0, 0.0]);
        assert_eq!(of(4.0, 0.5)[..2], [2.0, 0.25]);
    }

    #[test]
    fn zero_to_a_positive_power_is_zero_with_slope_zero_to_the_exponent() {
        let of = |y: f64| value_and_slopes(0.0, y, |x, y| x.pow(y).unwrap());
        assert_eq!(of(2.5), [0.0, 0.0, 0.0]);
        assert_eq!(of(1.0), [0.0, 1.0, 0.0]);
        assert_eq!(of(0.5), [0.0, f64::INFINITY, 0.0]);
        assert_eq!(of(0.0), [1.0, 0.0, 0.0]);
        let infinite = f64::INFINITY;
        assert_eq!(of(-1.0), [infinite, -infinite, -infinite]);
    }

    #[test]
    fn a_constant_exponent_of_negative_numbers_does_no_harm() {
        let tape = Tape::new();
        let (x, three) = (tape.leaf_scalar(-2.0), tape.constant_scalar(3.0));
        let cube = x.pow(three).unwrap();
        assert_eq!(cube.item(), -8.0);
        assert_eq!(cube.backward().unwrap().get_or_zeros(x).item(), 12.0);
        assert!(value_and_slopes(-2.0, 3.0_f64, |x, y| x.pow(y).unwrap())[2].is_nan());
        assert!(value_and_slopes(-2.0, 0.5_f64, |x, y| x.pow(y).unwrap())[0].is_nan());
    }
}
