//! Product of two arrays: `z = x y`; `x_bar += y z_bar`, `y_bar += x z_bar`.

use std::ops::Mul;

use crate::broadcast::Binary;
use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Product;

impl<T: Scalar> Binary<T> for Product {
    const NAME: &'static str = "mul";
    const LEFT_SLOPE_FROM: [bool; 2] = [false, true];
    const RIGHT_SLOPE_FROM: [bool; 2] = [true, false];

    fn value(self, x: T, y: T) -> T {
        x * y
    }
    fn left_slope(self, _x: T, y: T) -> T {
        y
    }
    fn right_slope(self, x: T, _y: T) -> T {
        x
    }
}

impl<T: Scalar> Var<'_, T> {
    /// `self * other`, entry by entry, with broadcasting.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn try_mul(self, other: Self) -> Result<Self, TensorError> {
        self.pairwise(other, Product)
    }
}

/// `self * other`, with broadcasting; panics unless the shapes broadcast.
impl<'t, T: Scalar> Mul for Var<'t, T> {
    type Output = Self;

    #[track_caller]
    fn mul(self, other: Self) -> Self {
        match self.try_mul(other) {
            Ok(product) => product,
            Err(error) => panic!("{error}"),
        }
    }
}
