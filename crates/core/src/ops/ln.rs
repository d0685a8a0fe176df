//! Natural logarithm: `y = ln x`; `x_bar += y_bar / x`.
//!
//! # Where it is not smooth
//! At `x = 0`, where value and slope are infinite. Below, the value is NaN and the slope still
//! `1 / x`, a number: it is the value that tells.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Logarithm;

impl<T: Scalar> Unary<T> for Logarithm {
    const NAME: &'static str = "ln";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.ln()
    }
    fn slope(self, x: T) -> T {
        T::ONE / x
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The natural logarithm of each entry.
    ///
    /// At 0 it is minus infinity with an infinite slope, so that the gradient is infinite, or NaN
    /// where the upstream gradient is 0. Below 0 it is NaN, and the gradient is what the formula
    /// says, `upstream / x`: finite, and without meaning.
    #[must_use]
    pub fn ln(self) -> Self {
        self.each(Logarithm)
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;

    #[test]
    fn the_logarithm_undoes_the_exponential() {
        for x in [-20.0_f64, -1.0, 0.5, 30.0] {
            let [value, slope] = value_and_slope(x, |x| x.exp().ln());
            assert!((value - x).abs() < 1e-14 * x.abs() && (slope - 1.0).abs() < 1e-15);
        }
    }

    #[test]
    fn zero_and_below_are_infinite_and_nan() {
        assert_eq!(value_and_slope(0.0, |x| x.ln()), [f64::NEG_INFINITY, f64::INFINITY]);
        assert!(value_and_slope(0.0_f64, |x| x.ln() * 0.0)[1].is_nan());
        let [value, slope] = value_and_slope(-2.0_f64, |x| x.ln());
        assert!(value.is_nan() && slope == -0.5);
    }
}
