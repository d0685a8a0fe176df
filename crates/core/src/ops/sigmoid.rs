//! Logistic function: `y = 1 / (1 + e^-x)`; `x_bar += e^-x / (1 + e^-x)^2 y_bar`.
//!
//! The slope is not taken as `y (1 - y)`: in `f32` that is 0 from x = 17 on, and a parameter that
//! strayed there would never come back.

use crate::elementwise::{SlopeFrom, Unary};
use crate::logistic::{logistic, logistic_slope};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Sigmoid;

impl<T: Scalar> Unary<T> for Sigmoid {
    const NAME: &'static str = "sigmoid";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        logistic(x)
    }
    fn slope(self, x: T) -> T {
        logistic_slope(x)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The logistic function 1 / (1 + e^-x) of each entry.
    #[must_use]
    pub fn sigmoid(self) -> Self {
        self.each(Sigmoid)
    }
}
