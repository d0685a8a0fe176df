//! Quotient of two arrays: `z = x / y`; `x_bar += z_bar / y`, `y_bar -= x z_bar / y^2`.
//!
//! # Where it is not smooth
//! At `y = 0`, where value and gradients are infinite or NaN, as division is.

use std::ops::Div;

use crate::broadcast::Binary;
use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Quotient;

impl<T: Scalar> Binary<T> for Quotient {
    const NAME: &'static str = "div";
    const LEFT_SLOPE_FROM: [bool; 2] = [false, true];
    const RIGHT_SLOPE_FROM: [bool; 2] = [true, true];

    fn value(self, x: T, y: T) -> T {
        x / y
    }
    fn left_slope(self, _x: T, y: T) -> T {
        T::ONE / y
    }
    fn right_slope(self, x: T, y: T) -> T {
        // Not x / (y y), whose denominator over- and underflows long before the quotient does.
        -(x / y) / y
    }
}

impl<T: Scalar> Var<'_, T> {
    /// `self / other`, entry by entry, with broadcasting.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn try_div(self, other: Self) -> Result<Self, TensorError> {
        self.pairwise(other, Quotient)
    }
}

/// `self / other`, with broadcasting; panics unless the shapes broadcast.
impl<'t, T: Scalar> Div for Var<'t, T> {
    type Output = Self;

    #[track_caller]
    fn div(self, other: Self) -> Self {
        match self.try_div(other) {
            Ok(quotient) => quotient,
            Err(error) => panic!("{error}"),
        }
    }
}

/// `self / number`; the number is a constant.
impl<T: Scalar> Div<T> for Var<'_, T> {
    type Output = Self;

    fn div(self, number: T) -> Self {
        self / self.tape.constant_scalar(number)
    }
}

macro_rules! number_on_the_left {
    ($t:ty) => {
        impl<'t> Div<Var<'t, $t>> for $t {
            type Output = Var<'t, $t>;

            fn div(self, x: Var<'t, $t>) -> Var<'t, $t> {
                x.tape.constant_scalar(self) / x
            }
        }
    };
}

number_on_the_left!(f32);
number_on_the_left!(f64);
