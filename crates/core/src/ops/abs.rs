//! Absolute value: `y = |x|`; `x_bar += sign(x) y_bar`.
//!
//! # Where it is not smooth
//! At `x = 0`, where the slope is taken as 0, the middle of the subgradients.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Absolute;

impl<T: Scalar> Unary<T> for Absolute {
    const NAME: &'static str = "abs";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.abs()
    }
    fn slope(self, x: T) -> T {
        // Three choices side by side, of which one is not zero: signs can't be foretold.
        let positive = if x > T::ZERO { T::ONE } else { T::ZERO };
        let negative = if x < T::ZERO { T::ONE } else { T::ZERO };
        let nan = if (x >= T::ZERO) | (x < T::ZERO) { T::ZERO } else { x };
        positive - negative + nan
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The absolute value of each entry.
    #[must_use]
    pub fn abs(self) -> Self {
        self.each(Absolute)
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;

    #[test]
    fn the_slope_is_the_sign_and_zero_at_zero() {
        let inf = f64::INFINITY;
        let cases = [(-2.5, 2.5, -1.0), (0.0, 0.0, 0.0), (1e300, 1e300, 1.0), (-inf, inf, -1.0)];
        for (x, value, slope) in cases {
            assert_eq!(value_and_slope(x, |x| x.abs()), [value, slope]);
        }
    }

    #[test]
    fn a_nan_is_not_masked() {
        assert!(value_and_slope(f64::NAN, |x| x.abs()).iter().all(|x| x.is_nan()));
    }
}
