//! Softplus: `y = ln(1 + e^x)`; `x_bar += y_bar / (1 + e^-x)`.
//!
//! Evaluated as `max(x, 0) + ln(1 + e^-|x|)`, which neither overflows nor cancels. Its inverse is
//! `x = y + ln(1 - e^-y)`.

use crate::elementwise::{SlopeFrom, Unary};
use crate::logistic::logistic;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Softplus;

impl<T: Scalar> Unary<T> for Softplus {
    const NAME: &'static str = "softplus";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.maximum_or_nan(T::ZERO) + (-x.abs()).exp().ln_1p()
    }
    fn slope(self, x: T) -> T {
        logistic(x)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The softplus ln(1 + e^x) of each entry: positive, and x for large x.
    #[must_use]
    pub fn softplus(self) -> Self {
        self.each(Softplus)
    }
}
