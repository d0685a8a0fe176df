//! Euclidean lengths that neither over- nor underflow before the result does.
//!
//! `|x| = sqrt(sum_k x_k^2)`. Where the sum of squares is too large, or so small that squares have lost
//! digits, it is formed again from `2^-e x_k`, with `2^e` the size of the largest entry. In `f32` no
//! sum of squares is, since it is formed in [`Scalar::Wide`].

use crate::scalar::Scalar;
use crate::summation::inner_product;

/// From here on a sum of squares has all its digits: what a square loses to underflow, at most 2^-1074,
/// is far below the rounding of such a sum, even of as many squares as fit into memory.
const SMALLEST: f64 = f64::from_bits((1023 - 960) << 52);
/// The largest `e` for which both `2^e` and `2^-e` are normal numbers.
const LARGEST_EXPONENT: i32 = 1022;

/// The length of a vector, in two factors: its size times `2^exponent`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Length<W> {
    /// The length of `2^-exponent` times the vector.
    size: W,
    exponent: i32,
}

/// `2^exponent`, for an exponent of a normal number.
#[inline]
fn power_of_two<W: Scalar>(exponent: i32) -> W {
    W::from_f64(f64::from_bits(((1023 + i64::from(exponent)) as u64) << 52))
}

impl<W: Scalar> Length<W> {
    /// The length of a vector with the sum of squares `squares`, formed of `entries` as they are.
    #[inline]
    pub(crate) fn new<E: Iterator<Item = W>>(squares: W, entries: impl Fn() -> E) -> Self {
        if (SMALLEST..=f64::MAX).contains(&squares.to_f64()) {
            return Self { size: squares.sqrt(), exponent: 0 };
        }
        Self::from_extreme(squares, entries)
    }

    /// The same where `squares` is not to be trusted.
    #[cold]
    fn from_extreme<E: Iterator<Item = W>>(squares: W, entries: impl Fn() -> E) -> Self {
        let as_is = |size| Self { size, exponent: 0 };
        let largest = entries().fold(0.0_f64, |a, x| a.maximum_or_nan(x.to_f64().abs()));
        if largest == 0.0 {
            // The root of 0 would have a tangent of NaN.
            return as_is(W::ZERO);
        }
        if !largest.is_finite() {
            return as_is(squares.sqrt());
        }
        let exponent = (largest.to_bits() >> 52) as i32 - 1023;
        let exponent = exponent.clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT);
        let factor = power_of_two::<W>(-exponent);
        let squares: W = entries().map(|x| (x * factor) * (x * factor)).sum();
        Self { size: squares.sqrt(), exponent }
    }

    /// The length.
    #[inline]
    pub(crate) fn value(self) -> W {
        self.size * power_of_two(self.exponent)
    }

    /// `2^-exponent x`: an entry in the measure of [`Length::size`].
    #[inline]
    pub(crate) fn scaled(self, x: W) -> W {
        x * power_of_two(-self.exponent)
    }

    /// `x` divided by the size, 0 for the size 0. So `divide(scaled(x))` is `x` divided by the length.
    #[inline]
    pub(crate) fn divide(self, x: W) -> W {
        if self.size == W::ZERO { x * W::ZERO } else { x / self.size }
    }
}

/// The length of `x`.
#[inline(always)]
pub(crate) fn length<T: Scalar>(x: &[T]) -> Length<T::Wide> {
    Length::new(inner_product(x, x), || x.iter().map(|x| x.widen()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dual::Dual;

    #[test]
    fn a_power_of_two_times_a_vector_has_that_times_its_length() {
        let vector = [3.0, -4.0, 12.0, 0.5];
        let plain = length(&vector).value();
        // From -537 down to -541 squares have lost digits, and their sum is not yet 0.
        for exponent in
            [-1070, -1022, -600, -540, -538, -537, -481, -480, -479, 0, 500, 511, 512, 1018]
        {
            let factor = |e: i32| 2.0_f64.powi(e / 2) * 2.0_f64.powi(e - e / 2);
            let scaled = vector.map(|x| x * factor(exponent));
            // Down there the vector itself has lost digits.
            let tolerance = if exponent < -1022 { 0.1 } else { 0.0 };
            let (found, exact) = (length(&scaled), plain * factor(exponent));
            assert!((found.value() - exact).abs() <= tolerance * exact, "2^{exponent}");
            let along = found.divide(found.scaled(scaled[2])) - 12.0 / plain;
            assert!(along.abs() <= tolerance, "2^{exponent}");
        }
    }

    #[test]
    fn a_length_beyond_the_largest_number_still_divides() {
        let vector = [f64::MAX, -f64::MAX, f64::MAX, f64::MAX];
        let found = length(&vector);
        assert_eq!(found.value(), f64::INFINITY);
        assert_eq!(vector.map(|x| found.divide(found.scaled(x))), [0.5, -0.5, 0.5, 0.5]);
        let denormal = f64::from_bits(1);
        let found = length(&[denormal, 0.0]);
        assert_eq!((found.value(), found.divide(found.scaled(denormal))), (denormal, 1.0));
    }

    #[test]
    fn what_is_zero_has_length_zero_and_what_is_no_number_none() {
        assert_eq!((length::<f64>(&[]).value(), length(&[0.0_f64, -0.0]).divide(0.0)), (0.0, 0.0));
        assert_eq!(length(&[1.0_f64, f64::NEG_INFINITY]).value(), f64::INFINITY);
        for vector in [[f64::NAN, 1.0], [f64::INFINITY, f64::NAN], [0.0, f64::NAN]] {
            assert!(length(&vector).value().is_nan());
        }
        assert!(length(&[0.0_f64]).divide(f64::NAN).is_nan());
        let zero = Dual::new(0.0, 1.0);
        let found = length(&[zero]);
        assert_eq!((found.value().tangent, found.divide(zero).tangent), (0.0, 0.0));
    }
}
