//! Hyperbolic tangent: `y = tanh x`; `x_bar += y_bar / cosh^2 x`.
//!
//! The slope is not taken as `1 - y^2`, which loses its digits in both tails. With the logistic
//! function `s`, `tanh x = 2 s(2x) - 1`, so it is `4 s'(2x)`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::logistic::logistic_slope;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Tangent;

impl<T: Scalar> Unary<T> for Tangent {
    const NAME: &'static str = "tanh";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.tanh()
    }
    fn slope(self, x: T) -> T {
        T::from_f64(4.0) * logistic_slope(x + x)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The hyperbolic tangent of each entry.
    #[must_use]
    pub fn tanh(self) -> Self {
        self.each(Tangent)
    }
}
