//! Sine: `y = sin x`, `x` in radians; `x_bar += cos x y_bar`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Sine;

impl<T: Scalar> Unary<T> for Sine {
    const NAME: &'static str = "sin";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.sin()
    }
    fn slope(self, x: T) -> T {
        x.cos()
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The sine of each entry, in radians.
    #[must_use]
    pub fn sin(self) -> Self {
        self.each(Sine)
    }
}
