//! Sum of two arrays: `z = x + y`; `x_bar += z_bar`, `y_bar += z_bar`.

use std::ops::Add;

use crate::broadcast::Binary;
use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Sum;

impl<T: Scalar> Binary<T> for Sum {
    const NAME: &'static str = "add";
    const LEFT_SLOPE_FROM: [bool; 2] = [false, false];
    const RIGHT_SLOPE_FROM: [bool; 2] = [false, false];

    fn value(self, x: T, y: T) -> T {
        x + y
    }
    fn left_slope(self, _x: T, _y: T) -> T {
        T::ONE
    }
    fn right_slope(self, _x: T, _y: T) -> T {
        T::ONE
    }
}

impl<T: Scalar> Var<'_, T> {
    /// `self + other`, entry by entry, with broadcasting.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn try_add(self, other: Self) -> Result<Self, TensorError> {
        self.pairwise(other, Sum)
    }
}

/// `self + other`, with broadcasting; panics unless the shapes broadcast.
impl<'t, T: Scalar> Add for Var<'t, T> {
    type Output = Self;

    #[track_caller]
    fn add(self, other: Self) -> Self {
        match self.try_add(other) {
            Ok(sum) => sum,
            Err(error) => panic!("{error}"),
        }
    }
}
