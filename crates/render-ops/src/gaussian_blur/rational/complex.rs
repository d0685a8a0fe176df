//! Complex numbers.

use std::ops::{Add, Div, Mul, Sub};

use bokashi_core::Scalar;

/// A complex number, generic over what its parts are.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Complex<S> {
    pub(super) re: S,
    pub(super) im: S,
}

impl<S: Scalar> Complex<S> {
    pub(super) fn real(re: S) -> Self {
        Self { re, im: S::ZERO }
    }

    /// The root with a real part that is not negative.
    pub(super) fn sqrt(self) -> Self {
        let half = S::from_f64(0.5);
        let size = (self.re * self.re + self.im * self.im).sqrt();
        let re = (half * (size + self.re)).sqrt();
        // From the larger of the two parts, so that nothing cancels.
        if self.re >= S::ZERO {
            return Self { re, im: half * self.im / re };
        }
        let im = (half * (size - self.re)).sqrt();
        let im = if self.im < S::ZERO { -im } else { im };
        Self { re: half * self.im / im, im }
    }

    /// The parts, rounded.
    pub(super) fn narrow<T: Scalar<Wide = S>>(self) -> [T; 2] {
        [T::narrow(self.re), T::narrow(self.im)]
    }
}

impl<S: Scalar> Add for Complex<S> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { re: self.re + other.re, im: self.im + other.im }
    }
}

impl<S: Scalar> Sub for Complex<S> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { re: self.re - other.re, im: self.im - other.im }
    }
}

impl<S: Scalar> Mul for Complex<S> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self {
            re: self.re * other.re - self.im * other.im,
            im: self.re * other.im + self.im * other.re,
        }
    }
}

impl<S: Scalar> Div for Complex<S> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let size = other.re * other.re + other.im * other.im;
        let product = self * Self { re: other.re, im: -other.im };
        Self { re: product.re / size, im: product.im / size }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_root_is_a_root_and_a_quotient_a_quotient() {
        for (re, im) in [(3.0, 4.0), (-3.0, 1e-9), (-3.0, -4.0), (1e-12, 2.0), (2.0, 0.0)] {
            let z = Complex::<f64> { re, im };
            let root = z.sqrt();
            assert!(root.re >= 0.0);
            for found in [root * root, (z * root) / root] {
                approx::assert_relative_eq!(found.re, re, epsilon = 1e-14);
                approx::assert_relative_eq!(found.im, im, max_relative = 1e-14);
            }
        }
    }
}
