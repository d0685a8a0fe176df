//! Square root: `y = sqrt x`; `x_bar += y_bar / (2 y)`.
//!
//! # Where it is not smooth
//! At `x = 0`, where the slope is infinite, and `x_bar` NaN where `y_bar` is 0; below, value and
//! slope are NaN.

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
    /// The square root of each entry: NaN below 0, with a gradient of NaN.
    ///
    /// At 0 the slope is infinite, so the gradient is infinite too, or NaN where the upstream
    /// gradient is 0: a length `(x * x).sum().sqrt()` at `x = 0` has the gradient NaN. Add a small
    /// number under the root where that can happen.
    #[must_use]
    pub fn sqrt(self) -> Self {
        self.each(SquareRoot)
    }
}
