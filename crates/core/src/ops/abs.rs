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
