//! Restriction to an interval: `y = min(max(x, low), high)`; `x_bar += y_bar` where
//! `low <= x <= high`, else nothing.
//!
//! # Where it is not smooth
//! At `x = low` and `x = high`, where the slope is taken as 1, so that a parameter that sits on its
//! bound can leave it.

use crate::elementwise::{SlopeFrom, Unary};
use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Clamp<T> {
    low: T,
    high: T,
}

impl<T: Scalar> Unary<T> for Clamp<T> {
    const NAME: &'static str = "clamp";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Input;

    fn value(self, x: T) -> T {
        x.maximum_or_nan(self.low).minimum_or_nan(self.high)
    }
    fn slope(self, x: T) -> T {
        // A NaN is its own value, so it gets its own gradient.
        if x < self.low || x > self.high { T::ZERO } else { T::ONE }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Each entry, or the nearer end of `[low, high]` where it lies outside.
    ///
    /// # Errors
    /// [`TensorError::Bounds`] unless `low <= high`.
    pub fn clamp(self, low: T, high: T) -> Result<Self, TensorError> {
        if low <= high {
            return Ok(self.each(Clamp { low, high }));
        }
        let (low, high) = (low.to_f64(), high.to_f64());
        Err(TensorError::Bounds { operation: "clamp", low, high })
    }
}
