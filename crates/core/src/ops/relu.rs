//! Rectifier: `y = max(x, 0)`; `x_bar += y_bar` where `x > 0`, else nothing.
//!
//! # Where it is not smooth
//! At `x = 0`, where the slope is taken as 0.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Rectifier;

impl<T: Scalar> Unary<T> for Rectifier {
    const NAME: &'static str = "relu";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Output;

    fn value(self, x: T) -> T {
        x.maximum_or_nan(T::ZERO)
    }
    fn slope(self, y: T) -> T {
        if y > T::ZERO {
            T::ONE
        } else {
            // 0, or a NaN, which is not masked.
            y * T::ZERO
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Each entry, or 0 where it is negative. The slope at 0 is 0: what was cut off does not come back
    /// by itself, other than with [`Var::clamp`].
    #[must_use]
    pub fn relu(self) -> Self {
        self.each(Rectifier)
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;

    #[test]
    fn the_slope_is_one_above_zero_and_zero_elsewhere() {
        let infinite = f64::INFINITY;
        for (x, value, slope) in [
            (2.5, 2.5, 1.0),
            (f64::MIN_POSITIVE, f64::MIN_POSITIVE, 1.0),
            (0.0, 0.0, 0.0),
            (-0.0, 0.0, 0.0),
            (-1.0, 0.0, 0.0),
            (infinite, infinite, 1.0),
            (-infinite, 0.0, 0.0),
        ] {
            assert_eq!(value_and_slope(x, |x| x.relu()), [value, slope]);
        }
        assert_eq!(value_and_slope(-0.0_f64, |x| x.relu())[0].to_bits(), 0);
    }

    #[test]
    fn a_nan_is_not_masked() {
        assert!(value_and_slope(f64::NAN, |x| x.relu()).iter().all(|x| x.is_nan()));
    }
}
