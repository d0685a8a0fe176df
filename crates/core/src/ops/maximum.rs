//! The larger of each pair of entries of two arrays: `z = maximum(x, y)`; the larger entry gets
//! `z_bar`.
//!
//! # Where it is not smooth
//! At `x = y`, where each side gets half of `z_bar`: the middle of the subgradients. So swapped
//! arguments have swapped gradients. A NaN on either side makes value and slopes NaN.

use std::cmp::Ordering;

use crate::broadcast::Binary;
use crate::error::TensorError;
use crate::preference::share;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Larger;

impl<T: Scalar> Binary<T> for Larger {
    const NAME: &'static str = "maximum";
    const LEFT_SLOPE_FROM: [bool; 2] = [true, true];
    const RIGHT_SLOPE_FROM: [bool; 2] = [true, true];

    fn value(self, x: T, y: T) -> T {
        // As IEEE 754-2019 has it, -0 is smaller than 0.
        if x == y && !x.to_f64().is_sign_negative() { x } else { x.maximum_or_nan(y) }
    }
    fn left_slope(self, x: T, y: T) -> T {
        share(x, y, Ordering::Greater)
    }
    fn right_slope(self, x: T, y: T) -> T {
        share(y, x, Ordering::Greater)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The larger of `self` and `other`, entry by entry, with broadcasting.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn maximum(self, other: Self) -> Result<Self, TensorError> {
        self.pairwise(other, Larger)
    }
}
