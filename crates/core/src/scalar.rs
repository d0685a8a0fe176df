//! The numbers that tensors hold.

use std::fmt::{Debug, Display};
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// A number that kernels compute with: `f32`, `f64`, or anything that behaves as one.
///
/// Comparisons go by value, so that a kernel generic over `Scalar` takes the same branches for a
/// number that carries a derivative.
pub trait Scalar:
    Copy
    + Default
    + PartialEq
    + PartialOrd
    + Debug
    + Display
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + Sum
{
    /// Zero.
    const ZERO: Self;
    /// One.
    const ONE: Self;
    /// Whether the processor has vectors of these numbers: kernels are then compiled for them, too.
    const HAS_VECTORS: bool = false;
    /// Whether there are backward passes over these numbers. Where there are none, a leaf is a constant,
    /// and operations are compiled for their forward pass alone.
    const HAS_BACKWARD: bool = true;
    /// The type for long sums and for geometry that decides coverage: twice the digits for
    /// `f32`, the type itself otherwise.
    type Wide: Scalar<Wide = Self::Wide>;

    /// The nearest representable number.
    fn from_f64(value: f64) -> Self;
    /// The value in `f64`.
    fn to_f64(self) -> f64;
    /// The same number with the digits of [`Scalar::Wide`].
    fn widen(self) -> Self::Wide;
    /// The nearest number to a wide one.
    fn narrow(wide: Self::Wide) -> Self;

    /// e to the power of `self`.
    fn exp(self) -> Self;
    /// Natural logarithm.
    fn ln(self) -> Self;
    /// ln(1 + `self`), accurate near 0.
    fn ln_1p(self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Sine of an angle in radians.
    fn sin(self) -> Self;
    /// Cosine of an angle in radians.
    fn cos(self) -> Self;
    /// The angle of the point `(x, self)` from the x axis, in radians from -pi to pi; `self` is y.
    /// At the origin it has no derivative.
    fn atan2(self, x: Self) -> Self;
    /// Hyperbolic tangent.
    fn tanh(self) -> Self;
    /// Integer power.
    fn powi(self, exponent: i32) -> Self;
    /// Power with an exponent that need not be whole: NaN below 0 where it is not, and 1 for
    /// exponent 0.
    fn powf(self, exponent: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// Whether neither infinite nor NaN.
    fn is_finite(self) -> bool;

    /// Whether both are the same number and carry the same derivative, where they carry one: what `==`
    /// does not ask. A kernel that leaves work out where it would change nothing asks this.
    #[inline]
    fn is_same(self, other: Self) -> bool {
        self == other
    }

    /// The smaller of two, of a number and NaN the number: minimumNumber of IEEE 754-2019, except
    /// that of two zeros it may be either. An instruction, not a choice: a kernel that keeps the
    /// smaller of what is stored and what is new is compiled to whole stores with it.
    fn minimum_number(self, other: Self) -> Self {
        if other < self || self.to_f64().is_nan() { other } else { self }
    }

    /// The smaller of two, and NaN where either is NaN: minimum of IEEE 754-2019, except that of two
    /// zeros it may be either. Kernels are full of it, and the order of zeros cost a tenth of a step.
    #[inline]
    fn minimum_or_nan(self, other: Self) -> Self {
        #[expect(clippy::eq_op, reason = "only a NaN differs from itself")]
        if self < other || self != self { self } else { other }
    }

    /// The larger of two, and NaN where either is NaN: maximum of IEEE 754-2019, except that of two
    /// zeros it may be either.
    #[inline]
    fn maximum_or_nan(self, other: Self) -> Self {
        #[expect(clippy::eq_op, reason = "only a NaN differs from itself")]
        if self > other || self != self { self } else { other }
    }
}

macro_rules! scalar {
    ($t:ident, $wide:ident) => {
        impl Scalar for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const HAS_VECTORS: bool = true;
            type Wide = $wide;

            fn from_f64(value: f64) -> Self {
                value as $t
            }
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            fn widen(self) -> $wide {
                $wide::from(self)
            }
            fn narrow(wide: $wide) -> Self {
                wide as $t
            }
            fn exp(self) -> Self {
                $t::exp(self)
            }
            fn ln(self) -> Self {
                $t::ln(self)
            }
            fn ln_1p(self) -> Self {
                $t::ln_1p(self)
            }
            fn sqrt(self) -> Self {
                $t::sqrt(self)
            }
            fn sin(self) -> Self {
                $t::sin(self)
            }
            fn cos(self) -> Self {
                $t::cos(self)
            }
            fn atan2(self, x: Self) -> Self {
                $t::atan2(self, x)
            }
            fn tanh(self) -> Self {
                $t::tanh(self)
            }
            fn powi(self, exponent: i32) -> Self {
                $t::powi(self, exponent)
            }
            fn powf(self, exponent: Self) -> Self {
                $t::powf(self, exponent)
            }
            fn abs(self) -> Self {
                $t::abs(self)
            }
            fn is_finite(self) -> bool {
                $t::is_finite(self)
            }
            #[inline(always)]
            fn minimum_number(self, other: Self) -> Self {
                $t::min(self, other)
            }
        }
    };
}

scalar!(f32, f64);
scalar!(f64, f64);
