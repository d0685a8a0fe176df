//! Logistic function: `y = 1 / (1 + e^-x)`; `x_bar += y (1 - y) y_bar`.
//!
//! The exponential is taken of `-|x|`, so that it never overflows.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Logistic;

impl<T: Scalar> Unary<T> for Logistic {
    const NAME: &'static str = "sigmoid";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Output;

    fn value(self, x: T) -> T {
        let e = (-x.abs()).exp();
        if x < T::ZERO { e / (T::ONE + e) } else { T::ONE / (T::ONE + e) }
    }
    fn slope(self, y: T) -> T {
        y * (T::ONE - y)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The logistic function 1 / (1 + e^-x) of each entry.
    #[must_use]
    pub fn sigmoid(self) -> Self {
        self.each(Logistic)
    }
}
