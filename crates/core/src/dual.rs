//! Dual numbers: forward-mode differentiation of whatever is generic over [`Scalar`].
//!
//! # Forward
//! `(x + x' e)` with `e^2 = 0`: every operation carries the value and its derivative along one
//! direction, `f(x + x' e) = f(x) + f'(x) x' e`.
//!
//! On a `Tape<Dual<T>>` the tangents of the outputs are `J v` for leaves of tangent `v`, and the
//! tangents of the gradients are Hessian-vector products: [`jvp`](crate::jvp) and
//! [`hvp`](crate::hvp).
//!
//! # Where it is not smooth
//! Comparisons go by value, so that a kernel takes the same branch as without tangents; the
//! derivative is the derivative of that branch. `|x|` has slope 1 at 0.
//!
//! # Source
//! Griewank and Walther, *Evaluating Derivatives*, 2nd edition, 2008, chapter 3.

use std::cmp::Ordering;
use std::fmt;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::power::{slope_to_base, slope_to_exponent};
use crate::scalar::Scalar;

/// A number and its derivative along one direction.
///
/// With it backward passes run, too, as [`hvp`](crate::hvp) needs them. Where only tangents are asked for,
/// [`ForwardDual`] has the same bits and less to compile.
#[derive(Debug, Clone, Copy, Default)]
pub struct Dual<T, const HAS_BACKWARD: bool = true> {
    /// The number.
    pub value: T,
    /// Its derivative.
    pub tangent: T,
}

/// A dual number for tangents alone, as of [`jvp`](crate::jvp). On its tape a leaf is a constant and a
/// backward pass is refused, so those of the operations are not compiled.
pub type ForwardDual<T> = Dual<T, false>;

// For one kind alone, so that `Dual::new` says which.
impl<T: Scalar> Dual<T> {
    /// `value + tangent e`.
    pub fn new(value: T, tangent: T) -> Self {
        Self { value, tangent }
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> Dual<T, HAS_BACKWARD> {
    /// `f(x)` of this `x`, from the value `f(x)` and the slope `f'(x)`.
    fn chain(self, value: T, slope: T) -> Self {
        Self { value, tangent: slope * self.tangent }
    }
}

impl<T: PartialEq, const HAS_BACKWARD: bool> PartialEq for Dual<T, HAS_BACKWARD> {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<T: PartialOrd, const HAS_BACKWARD: bool> PartialOrd for Dual<T, HAS_BACKWARD> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl<T: fmt::Display, const HAS_BACKWARD: bool> fmt::Display for Dual<T, HAS_BACKWARD> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} + {} e", self.value, self.tangent)
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> Add for Dual<T, HAS_BACKWARD> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, tangent: self.tangent + other.tangent }
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> Sub for Dual<T, HAS_BACKWARD> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, tangent: self.tangent - other.tangent }
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> Mul for Dual<T, HAS_BACKWARD> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        let tangent = self.tangent * other.value + self.value * other.tangent;
        Self { value: self.value * other.value, tangent }
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> Div for Dual<T, HAS_BACKWARD> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        Self { value, tangent: (self.tangent - value * other.tangent) / other.value }
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> Neg for Dual<T, HAS_BACKWARD> {
    type Output = Self;
    fn neg(self) -> Self {
        Self { value: -self.value, tangent: -self.tangent }
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> AddAssign for Dual<T, HAS_BACKWARD> {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> SubAssign for Dual<T, HAS_BACKWARD> {
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> MulAssign for Dual<T, HAS_BACKWARD> {
    fn mul_assign(&mut self, other: Self) {
        *self = *self * other;
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> Sum for Dual<T, HAS_BACKWARD> {
    fn sum<I: Iterator<Item = Self>>(terms: I) -> Self {
        // As the sums of f32 and f64 do, and for a sum of no terms: from -0.
        terms.fold(-Self::ZERO, Add::add)
    }
}

impl<T: Scalar, const HAS_BACKWARD: bool> Scalar for Dual<T, HAS_BACKWARD> {
    const ZERO: Self = Self { value: T::ZERO, tangent: T::ZERO };
    const ONE: Self = Self { value: T::ONE, tangent: T::ZERO };
    const HAS_BACKWARD: bool = HAS_BACKWARD;
    type Wide = Dual<T::Wide, HAS_BACKWARD>;

    fn from_f64(value: f64) -> Self {
        Self { value: T::from_f64(value), tangent: T::ZERO }
    }
    fn to_f64(self) -> f64 {
        self.value.to_f64()
    }
    fn widen(self) -> Self::Wide {
        Dual { value: self.value.widen(), tangent: self.tangent.widen() }
    }
    fn narrow(wide: Self::Wide) -> Self {
        Self { value: T::narrow(wide.value), tangent: T::narrow(wide.tangent) }
    }

    fn exp(self) -> Self {
        let exp = self.value.exp();
        self.chain(exp, exp)
    }
    fn ln(self) -> Self {
        Self { value: self.value.ln(), tangent: self.tangent / self.value }
    }
    fn ln_1p(self) -> Self {
        Self { value: self.value.ln_1p(), tangent: self.tangent / (T::ONE + self.value) }
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        Self { value: root, tangent: self.tangent / (root + root) }
    }
    fn sin(self) -> Self {
        self.chain(self.value.sin(), self.value.cos())
    }
    fn cos(self) -> Self {
        self.chain(self.value.cos(), -self.value.sin())
    }
    fn atan2(self, x: Self) -> Self {
        let square = self.value * self.value + x.value * x.value;
        let tangent = (x.value * self.tangent - self.value * x.tangent) / square;
        Self { value: self.value.atan2(x.value), tangent }
    }
    fn tanh(self) -> Self {
        // 1 / cosh^2 x = 4 e / (1 + e)^2 with e = exp(-2 |x|): 1 - tanh^2 has no digits in the tails.
        let size = self.value.abs();
        let e = (-(size + size)).exp();
        let slope = T::from_f64(4.0) * e / ((T::ONE + e) * (T::ONE + e));
        self.chain(self.value.tanh(), slope)
    }
    fn powi(self, exponent: i32) -> Self {
        let slope = match exponent {
            0 => T::ZERO,
            n => T::from_f64(f64::from(n)) * self.value.powi(n.saturating_sub(1)),
        };
        self.chain(self.value.powi(exponent), slope)
    }
    fn powf(self, exponent: Self) -> Self {
        let (x, y) = (self.value, exponent.value);
        // A slope that is infinite or NaN says nothing of a number that stays.
        let along = |tangent: T, slope: fn(T, T) -> T| {
            if tangent.is_same(T::ZERO) { T::ZERO } else { slope(x, y) * tangent }
        };
        let of_base = along(self.tangent, slope_to_base);
        Self { value: x.powf(y), tangent: of_base + along(exponent.tangent, slope_to_exponent) }
    }
    fn abs(self) -> Self {
        if self.value < T::ZERO { -self } else { Self { value: self.value.abs(), ..self } }
    }
    fn is_same(self, other: Self) -> bool {
        self.value.is_same(other.value) && self.tangent.is_same(other.tangent)
    }
    fn is_finite(self) -> bool {
        self.value.is_finite()
    }
}
