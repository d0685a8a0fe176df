//! Hyperbolic tangent: `y = tanh x`; `x_bar += y_bar / cosh^2 x`.
//!
//! The slope is not taken as `1 - y^2`, which loses its digits in both tails. With the logistic
//! function `s`, `tanh x = 2 s(2x) - 1`, so it is `4 s'(2x)`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::logistic::logistic_slope;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Tangent;

impl<T: Scalar> Unary<T> for Tangent {
    const NAME: &'static str = "tanh";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.tanh()
    }
    fn slope(self, x: T) -> T {
        T::from_f64(4.0) * logistic_slope(x + x)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The hyperbolic tangent of each entry.
    #[must_use]
    pub fn tanh(self) -> Self {
        self.each(Tangent)
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;

    #[test]
    fn far_out_the_value_saturates_and_the_slope_keeps_its_digits() {
        assert_eq!(value_and_slope(0.0, |x| x.tanh()), [0.0, 1.0]);
        assert_eq!(value_and_slope(-1000.0, |x| x.tanh()), [-1.0, 0.0]);
        let [value, slope] = value_and_slope(25.0_f64, |x| x.tanh());
        assert_eq!(value, 1.0);
        assert!((slope / (4.0 * (-50.0_f64).exp()) - 1.0).abs() < 1e-14);
    }
}
