//! Square root: `y = sqrt x`; `x_bar += y_bar / (2 y)`.
//!
//! # Where it is not smooth
//! At `x = 0`, where the slope is infinite; NaN below, as the root is.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct SquareRoot;

impl<T: Scalar> Unary<T> for SquareRoot {
    const NAME: &'static str = "sqrt";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Output;

    fn value(self, x: T) -> T {
        x.sqrt()
    }
    fn slope(self, y: T) -> T {
        T::from_f64(0.5) / y
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The square root of each entry.
    #[must_use]
    pub fn sqrt(self) -> Self {
        self.each(SquareRoot)
    }
}

#[cfg(test)]
mod tests {
    use crate::elementwise::value_and_slope;

    #[test]
    fn value_and_slope_by_hand() {
        assert_eq!(value_and_slope(4.0, |x| x.sqrt()), [2.0, 0.25]);
        assert_eq!(value_and_slope(0.0, |x| x.sqrt()), [0.0, f64::INFINITY]);
        assert!(value_and_slope(-1.0_f64, |x| x.sqrt())[0].is_nan());
    }
}
