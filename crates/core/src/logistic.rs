//! The logistic function, behind sigmoid, softplus and tanh.
//!
//! Exponentials are taken of `-|x|`, so that they never overflow. No difference from 1 is formed, so
//! value and slope keep their digits in both tails.

use crate::scalar::Scalar;

/// `1 / (1 + e^-x)`.
pub(crate) fn logistic<T: Scalar>(x: T) -> T {
    let e = (-x.abs()).exp();
    if x < T::ZERO { e / (T::ONE + e) } else { T::ONE / (T::ONE + e) }
}

/// The derivative of [`logistic`], `e^-x / (1 + e^-x)^2`, which is even.
pub(crate) fn logistic_slope<T: Scalar>(x: T) -> T {
    let e = (-x.abs()).exp();
    let s = T::ONE + e;
    e / (s * s)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ARGUMENTS: [f64; 7] = [0.0, 1e-9, 0.3, 1.0, 7.5, 40.0, 1000.0];

    #[test]
    fn the_logistic_of_x_and_of_minus_x_add_up_to_one() {
        for x in ARGUMENTS {
            assert!((logistic(x) + logistic(-x) - 1.0).abs() <= f64::EPSILON);
        }
    }

    #[test]
    fn the_slope_is_the_product_of_both_tails() {
        for x in ARGUMENTS {
            let product = logistic(x) * logistic(-x);
            assert!((logistic_slope(x) - product).abs() <= 4.0 * f64::EPSILON * product);
            assert_eq!(logistic_slope(x), logistic_slope(-x));
        }
        assert!(logistic_slope(40.0_f32) > 0.0);
    }

    #[test]
    fn a_nan_is_not_masked() {
        assert!(logistic(f64::NAN).is_nan() && logistic_slope(f64::NAN).is_nan());
    }
}
