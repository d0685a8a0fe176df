//! Logarithms that loops make vectors of.
//!
//! # Forward
//! `x = 2^e m` with m from `sqrt(1/2)` to `sqrt(2)`, so `log2 x = e + 2 artanh(s) / ln 2`,
//! `s = (m - 1) / (m + 1)`, `artanh(s) = s + s^3 / 3 + s^5 / 5 + ...`. As `|s| < 0.172`, ten terms
//! leave out less than `s^21 / 21 < 5e-18`. A power of 2 comes out exactly.

use bokashi_core::Scalar;

/// Numbers up to this one are taken for zero: the square of what is smaller than 1e-15.
const LEAST: f64 = 1e-30;

/// From this number on they are taken for infinite.
const MOST: f64 = 1e300;

/// The number of terms of the series.
const TERMS: usize = 10;

/// The logarithm of x to the base 2; minus infinity up to [`LEAST`], infinity from
/// [`MOST`] on.
#[inline(always)]
pub(super) fn log2<T: Scalar>(x: T) -> T {
    let bits = x.to_f64().to_bits();
    // Added to a fraction from sqrt(2) on, it carries into the exponent.
    let carry = 2.0_f64.to_bits() - std::f64::consts::SQRT_2.to_bits();
    let exponent = bits.wrapping_add(carry) >> 52;
    // As a number: behind the bits of 2^52 it counts ones.
    let whole = (1_u64 << 52) as f64;
    let e = f64::from_bits(exponent | whole.to_bits()) - (whole + 1023.0);
    let scale = f64::from_bits(2046_u64.wrapping_sub(exponent) << 52);
    let m = x * T::from_f64(scale);
    let s = (m - T::ONE) / (m + T::ONE);
    let square = s * s;
    let mut sum = T::from_f64(1.0 / (2 * TERMS - 1) as f64);
    for k in (0..TERMS - 1).rev() {
        sum = T::from_f64(1.0 / (2 * k + 1) as f64) + square * sum;
    }
    let log = T::from_f64(e) + T::from_f64(2.0 * std::f64::consts::LOG2_E) * s * sum;
    let log = if x < T::from_f64(MOST) { log } else { T::from_f64(f64::INFINITY) };
    if x > T::from_f64(LEAST) { log } else { T::from_f64(f64::NEG_INFINITY) }
}

#[cfg(test)]
mod tests {
    use bokashi_core::Dual;

    use super::*;

    /// Numbers from 1e-29 to 1e29, densest around 1, and both sides of the square roots of 2 and 1/2.
    fn numbers() -> impl Iterator<Item = f64> {
        let spread = (-4000..=4000).map(|k| f64::from(k) / 4000.0);
        let spread = spread.map(|t| 10.0_f64.powf(29.0 * t * t * t));
        let root = std::f64::consts::SQRT_2;
        spread.chain([root.next_down(), root, root.next_up(), 1.0 / root, 0.5 * root])
    }

    #[test]
    fn they_are_those_of_the_standard_library() {
        for x in numbers() {
            approx::assert_relative_eq!(log2(x), x.log2(), epsilon = 2e-16, max_relative = 4e-16);
            let single = x as f32;
            let expected = f64::from(single).log2() as f32;
            approx::assert_relative_eq!(
                log2(single),
                expected,
                epsilon = 1e-7,
                max_relative = 3e-7
            );
        }
    }

    #[test]
    fn powers_of_2_come_out_exactly() {
        for k in -90..=90 {
            assert_eq!(log2(f64::powi(2.0, k)), f64::from(k));
            assert_eq!(log2(f32::powi(2.0, k)), k as f32);
        }
    }

    #[test]
    fn slopes_are_those_of_a_logarithm() {
        for x in numbers() {
            let slope = log2(Dual::new(x, 1.0)).tangent;
            approx::assert_relative_eq!(slope, std::f64::consts::LOG2_E / x, max_relative = 1e-14);
        }
    }

    #[test]
    fn what_is_nothing_or_too_large_is_smaller_or_larger_than_all() {
        for x in [0.0, -0.0, 1e-300, f64::MIN_POSITIVE, 1e-31] {
            assert_eq!(log2(x), f64::NEG_INFINITY);
        }
        assert_eq!(log2(f32::from_bits(1)), f32::NEG_INFINITY);
        for x in [MOST, f64::MAX, f64::INFINITY] {
            assert_eq!(log2(x), f64::INFINITY);
        }
        assert_eq!(log2(f32::INFINITY), f32::INFINITY);
        approx::assert_relative_eq!(log2(f32::MAX), 128.0);
    }
}
