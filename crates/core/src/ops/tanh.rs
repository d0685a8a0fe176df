//! Hyperbolic tangent: `y = tanh x`; `x_bar += (1 - y^2) y_bar`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Tangent;

impl<T: Scalar> Unary<T> for Tangent {
    const NAME: &'static str = "tanh";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Output;

    fn value(self, x: T) -> T {
        x.tanh()
    }
    fn slope(self, y: T) -> T {
        (T::ONE - y) * (T::ONE + y)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The hyperbolic tangent of each entry.
    #[must_use]
    pub fn tanh(self) -> Self {
        self.each(Tangent)
    }
}
