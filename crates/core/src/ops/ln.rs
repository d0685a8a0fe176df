//! Natural logarithm: `y = ln x`; `x_bar += y_bar / x`.
//!
//! # Where it is not smooth
//! At `x = 0`, where value and slope are infinite. Below, the value is NaN and the slope still
//! `1 / x`, a number: it is the value that tells.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Logarithm;

impl<T: Scalar> Unary<T> for Logarithm {
    const NAME: &'static str = "ln";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.ln()
    }
    fn slope(self, x: T) -> T {
        T::ONE / x
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The natural logarithm of each entry.
    ///
    /// At 0 it is minus infinity with an infinite slope, so that the gradient is infinite, or NaN
    /// where the upstream gradient is 0. Below 0 it is NaN, and the gradient is what the formula
    /// says, `upstream / x`: finite, and without meaning.
    #[must_use]
    pub fn ln(self) -> Self {
        self.each(Logarithm)
    }
}
