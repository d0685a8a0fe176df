//! Softplus: `y = ln(1 + e^x)`; `x_bar += y_bar / (1 + e^-x)`.
//!
//! Evaluated as `max(x, 0) + ln(1 + e^-|x|)`, which neither overflows nor cancels. Its inverse is
//! `x = y + ln(1 - e^-y)`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::logistic::logistic;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Softplus;

impl<T: Scalar> Unary<T> for Softplus {
    const NAME: &'static str = "softplus";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.maximum_or_nan(T::ZERO) + (-x.abs()).exp().ln_1p()
    }
    fn slope(self, x: T) -> T {
        logistic(x)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The softplus ln(1 + e^x) of each entry: positive, and x for large x.
    #[must_use]
    pub fn softplus(self) -> Self {
        self.each(Softplus)
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;

    #[test]
    fn far_out_it_is_zero_and_the_identity() {
        assert_eq!(value_and_slope(1000.0, |x| x.softplus()), [1000.0, 1.0]);
        assert_eq!(value_and_slope(-1000.0, |x| x.softplus()), [0.0, 0.0]);
        assert_eq!(value_and_slope(0.0, |x| x.softplus()), [2.0_f64.ln(), 0.5]);
    }

    #[test]
    fn the_left_tail_is_the_exponential() {
        let [value, slope] = value_and_slope(-50.0_f64, |x| x.softplus());
        assert_eq!(value, (-50.0_f64).exp());
        assert!((slope / value - 1.0).abs() < 1e-15);
    }

    #[test]
    fn a_nan_is_not_masked() {
        assert!(value_and_slope(f64::NAN, |x| x.softplus()).iter().all(|x| x.is_nan()));
    }
}
