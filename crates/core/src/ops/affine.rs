//! Scale and shift by constants: `y = a x + b`; `x_bar += a y_bar`.
//!
//! Serves `-x` and the operators between a variable and a number, except division. Where nothing
//! is added, `b` is -0, the neutral number of addition: 0 would turn a product of -0 into +0.

use std::ops::{Add, Mul, Neg, Sub};

use crate::elementwise::{SlopeFrom, Unary};
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Affine<T> {
    a: T,
    b: T,
}

impl<T: Scalar> Unary<T> for Affine<T> {
    const NAME: &'static str = "affine";
    const SLOPE_FROM: SlopeFrom = SlopeFrom::Nothing;

    fn value(self, x: T) -> T {
        self.a * x + self.b
    }
    fn slope(self, _x: T) -> T {
        self.a
    }
}

impl<T: Scalar> Var<'_, T> {
    /// `a self + b` with constants `a` and `b`.
    #[must_use]
    pub fn affine(self, a: T, b: T) -> Self {
        self.each(Affine { a, b })
    }
}

impl<T: Scalar> Neg for Var<'_, T> {
    type Output = Self;

    fn neg(self) -> Self {
        self.affine(-T::ONE, -T::ZERO)
    }
}

impl<T: Scalar> Add<T> for Var<'_, T> {
    type Output = Self;

    fn add(self, number: T) -> Self {
        self.affine(T::ONE, number)
    }
}

impl<T: Scalar> Sub<T> for Var<'_, T> {
    type Output = Self;

    fn sub(self, number: T) -> Self {
        self.affine(T::ONE, -number)
    }
}

impl<T: Scalar> Mul<T> for Var<'_, T> {
    type Output = Self;

    fn mul(self, number: T) -> Self {
        self.affine(number, -T::ZERO)
    }
}

macro_rules! number_on_the_left {
    ($t:ty) => {
        impl<'t> Add<Var<'t, $t>> for $t {
            type Output = Var<'t, $t>;

            fn add(self, x: Var<'t, $t>) -> Var<'t, $t> {
                x.affine(1.0, self)
            }
        }

        impl<'t> Sub<Var<'t, $t>> for $t {
            type Output = Var<'t, $t>;

            fn sub(self, x: Var<'t, $t>) -> Var<'t, $t> {
                x.affine(-1.0, self)
            }
        }

        impl<'t> Mul<Var<'t, $t>> for $t {
            type Output = Var<'t, $t>;

            fn mul(self, x: Var<'t, $t>) -> Var<'t, $t> {
                x.affine(self, -0.0)
            }
        }
    };
}

number_on_the_left!(f32);
number_on_the_left!(f64);
