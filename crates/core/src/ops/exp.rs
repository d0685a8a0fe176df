//! Exponential: `y = e^x`; `x_bar += y y_bar`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Exponential;

impl<T: Scalar> Unary<T> for Exponential {
    const NAME: &'static str = "exp";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Output;

    fn value(self, x: T) -> T {
        x.exp()
    }
    fn slope(self, y: T) -> T {
        y
    }
}

impl<T: Scalar> Var<'_, T> {
    /// e to the power of each entry.
    #[must_use]
    pub fn exp(self) -> Self {
        self.each(Exponential)
    }
}
