//! Power with a constant exponent: `y = x^a`; `x_bar += a x^(a-1) y_bar`.
//!
//! # Where it is not smooth
//! At `x = 0` for `a < 1`, where the slope is infinite; `x^0` is 1 with slope 0 everywhere. Below 0
//! value and slope are NaN unless `a` is whole.

use crate::elementwise::{SlopeFrom, Unary};
use crate::power::slope_to_base;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Power<T> {
    exponent: T,
}

impl<T: Scalar> Unary<T> for Power<T> {
    const NAME: &'static str = "powf";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn is_identity(self) -> Option<&'static str> {
        self.exponent.is_same(T::ONE).then_some("the exponent is 1")
    }
    fn value(self, x: T) -> T {
        x.powf(self.exponent)
    }
    fn slope(self, x: T) -> T {
        slope_to_base(x, self.exponent)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Each entry to the power of `exponent`, a constant: a tone curve, say. NaN below 0 unless the
    /// exponent is whole. For an exponent with a gradient see [`Var::pow`].
    ///
    /// Where the exponent lies between 0 and 1 the slope at 0 is infinite, so the gradient is infinite,
    /// or NaN where the upstream gradient is 0.
    #[must_use]
    pub fn powf(self, exponent: T) -> Self {
        self.each(Power { exponent })
    }
}
