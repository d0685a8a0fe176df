//! Logistic function: `y = 1 / (1 + e^-x)`; `x_bar += e^-x / (1 + e^-x)^2 y_bar`.
//!
//! The slope is not taken as `y (1 - y)`: in `f32` that is 0 from x = 17 on, and a parameter that
//! strayed there would never come back.

use crate::elementwise::{SlopeFrom, Unary};
use crate::logistic::{logistic, logistic_slope};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Sigmoid;

impl<T: Scalar> Unary<T> for Sigmoid {
    const NAME: &'static str = "sigmoid";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        logistic(x)
    }
    fn slope(self, x: T) -> T {
        logistic_slope(x)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The logistic function 1 / (1 + e^-x) of each entry.
    #[must_use]
    pub fn sigmoid(self) -> Self {
        self.each(Sigmoid)
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;

    #[test]
    fn far_out_the_value_saturates_and_nothing_is_nan() {
        assert_eq!(value_and_slope(1000.0, |x| x.sigmoid()), [1.0, 0.0]);
        assert_eq!(value_and_slope(-1000.0, |x| x.sigmoid()), [0.0, 0.0]);
        assert_eq!(value_and_slope(0.0, |x| x.sigmoid()), [0.5, 0.25]);
    }

    #[test]
    fn a_saturated_value_still_has_its_slope() {
        for x in [20.0_f32, 40.0] {
            let [value, slope] = value_and_slope(x, |x| x.sigmoid());
            assert_eq!(value, 1.0);
            assert!((slope / (-x).exp() - 1.0).abs() < 1e-6);
        }
    }
}
