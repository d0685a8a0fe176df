//! Natural logarithm: `y = ln x`; `x_bar += y_bar / x`.
//!
//! # Where it is not smooth
//! At `x = 0`, where value and slope are infinite; NaN below, as the logarithm is.

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
    #[must_use]
    pub fn ln(self) -> Self {
        self.each(Logarithm)
    }
}
