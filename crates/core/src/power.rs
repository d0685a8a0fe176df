//! Slopes of a power `x^y`, for variables and for dual numbers.
//!
//! `d(x^y)/dx = y x^(y-1)` and `d(x^y)/dy = x^y ln x`.
//!
//! # Where it is not smooth
//! At `x = 0`. The slope to `x` is the limit: 0 for `y > 1`, infinite for `y < 1`; `x^0` is 1
//! everywhere, with slope 0. The slope to `y` is 0 for `y > 0`, since `0^y` is 0 there. At `y = 0` the
//! value jumps from 1 to 0, and the slope is taken as 0, too. For `y < 0` it is infinite.
//!
//! Below `x = 0` a power is defined for whole `y` alone. The slope to `x` is then as above. A slope to
//! `y` does not exist, and is NaN.

use crate::scalar::Scalar;

/// The derivative of `x^y` with respect to `x`.
pub(crate) fn slope_to_base<T: Scalar>(x: T, y: T) -> T {
    // The formula has 0 times infinity there.
    if x == T::ZERO && y == T::ZERO { T::ZERO } else { y * x.powf(y - T::ONE) }
}

/// The derivative of `x^y` with respect to `y`.
pub(crate) fn slope_to_exponent<T: Scalar>(x: T, y: T) -> T {
    let power = x.powf(y);
    // A power of 0 beats the logarithm, of 0 and of infinity alike.
    if power == T::ZERO || (x == T::ZERO && y == T::ZERO) { T::ZERO } else { power * x.ln() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_are_those_of_the_exponential_of_a_logarithm() {
        for (x, y) in [(0.3_f64, 2.7), (1.0, -4.0), (9.0, 0.5), (1e-9, 1e-3)] {
            let power = (y * x.ln()).exp();
            let [to_base, to_exponent] = [y * power / x, power * x.ln()];
            assert!((slope_to_base(x, y) - to_base).abs() <= 1e-14 * to_base.abs());
            assert!((slope_to_exponent(x, y) - to_exponent).abs() <= 1e-14 * to_exponent.abs());
        }
    }

    #[test]
    fn slopes_at_zero_are_limits_where_there_are_some() {
        let base = [2.0, 1.0, 0.5, 0.0, -1.0].map(|y| slope_to_base(0.0, y));
        assert_eq!(base, [0.0, 1.0, f64::INFINITY, 0.0, f64::NEG_INFINITY]);
        let exponent = [2.0, 0.5, 0.0, -1.0].map(|y| slope_to_exponent(0.0, y));
        assert_eq!(exponent, [0.0, 0.0, 0.0, f64::NEG_INFINITY]);
        assert_eq!(slope_to_exponent(f64::INFINITY, -2.0), 0.0);
    }

    #[test]
    fn below_zero_there_is_a_slope_to_the_base_alone() {
        assert_eq!(slope_to_base(-2.0, 3.0), 12.0);
        assert!(slope_to_base(-2.0, 2.5_f64).is_nan() && slope_to_exponent(-2.0, 3.0_f64).is_nan());
    }

    #[test]
    fn a_nan_is_not_masked() {
        for (x, y) in [(f64::NAN, 2.0), (f64::NAN, 0.0), (2.0, f64::NAN), (0.0, f64::NAN)] {
            assert!(slope_to_exponent(x, y).is_nan(), "{x} {y}");
        }
        assert!(slope_to_base(f64::NAN, 2.0).is_nan() && slope_to_base(2.0, f64::NAN).is_nan());
    }
}
