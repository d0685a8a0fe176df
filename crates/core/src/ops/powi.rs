//! Integer power: `y = x^n`; `x_bar += n x^(n-1) y_bar`.
//!
//! # Where it is not smooth
//! At `x = 0` for `n < 0`, where value and slope are infinite. `x^0` is 1 with slope 0 everywhere.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Power {
    exponent: i32,
}

impl<T: Scalar> Unary<T> for Power {
    const NAME: &'static str = "powi";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn is_identity(self) -> Option<&'static str> {
        (self.exponent == 1).then_some("the exponent is 1")
    }
    fn value(self, x: T) -> T {
        // A square as a product is the same on every machine.
        if self.exponent == 2 { x * x } else { x.powi(self.exponent) }
    }
    fn slope(self, x: T) -> T {
        match self.exponent {
            0 => T::ZERO,
            2 => x + x,
            n => T::from_f64(f64::from(n)) * x.powi(n.saturating_sub(1)),
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Each entry to the power of `exponent`.
    #[must_use]
    pub fn powi(self, exponent: i32) -> Self {
        self.each(Power { exponent })
    }

    /// The square of each entry.
    #[must_use]
    pub fn square(self) -> Self {
        self.powi(2)
    }
}
