//! The smaller of each pair of entries of two arrays: `z = minimum(x, y)`; the smaller entry gets
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
struct Smaller;

impl<T: Scalar> Binary<T> for Smaller {
    const NAME: &'static str = "minimum";
    const LEFT_SLOPE_FROM: [bool; 2] = [true, true];
    const RIGHT_SLOPE_FROM: [bool; 2] = [true, true];

    fn value(self, x: T, y: T) -> T {
        // As IEEE 754-2019 has it, -0 is smaller than 0.
        if x == y && x.to_f64().is_sign_negative() { x } else { x.minimum_or_nan(y) }
    }
    fn left_slope(self, x: T, y: T) -> T {
        share(x, y, Ordering::Less)
    }
    fn right_slope(self, x: T, y: T) -> T {
        share(y, x, Ordering::Less)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The smaller of `self` and `other`, entry by entry, with broadcasting.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn minimum(self, other: Self) -> Result<Self, TensorError> {
        self.pairwise(other, Smaller)
    }
}
