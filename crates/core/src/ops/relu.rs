//! Rectifier: `y = max(x, 0)`; `x_bar += y_bar` where `x > 0`, else nothing.
//!
//! # Where it is not smooth
//! At `x = 0`, where the slope is taken as 0.

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Rectifier;

impl<T: Scalar> Unary<T> for Rectifier {
    const NAME: &'static str = "relu";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Output;

    fn value(self, x: T) -> T {
        x.maximum_or_nan(T::ZERO)
    }
    fn slope(self, y: T) -> T {
        if y > T::ZERO {
            T::ONE
        } else {
            // 0, or a NaN, which is not masked.
            y * T::ZERO
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Each entry, or 0 where it is negative. The slope at 0 is 0: what was cut off does not come back
    /// by itself, other than with [`Var::clamp`].
    #[must_use]
    pub fn relu(self) -> Self {
        self.each(Rectifier)
    }
}
