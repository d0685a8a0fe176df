//! Stumpff's functions: the coefficients of the exponential of a rotation.
//!
//! # Forward
//! `c_k(s) = sum_j (-s)^j / (2 j + k)!`. With an angle a and `s = a^2`: `c_0 = cos a`, `c_1 = sin a / a`,
//! `c_2 = (1 - cos a) / a^2`, `c_3 = (a - sin a) / a^3`. They are smooth in s, at 0 too, and
//! `c_k = 1 / k! - s c_(k + 2)`.
//!
//! # Slopes
//! `dc_k/ds = (k c_(k + 2) - c_(k + 1)) / 2`.
//!
//! # Source
//! Stiefel and Scheifele, *Linear and Regular Celestial Mechanics*, 1971, section 11.

use bokashi_core::Scalar;

/// Below this, `c_4` and `c_5` are series; above it the formulas with sines lose at most a digit.
const SERIES_UP_TO: f64 = 4.0;

/// Terms of the series: the first that is left out is below 1e-17 of the sum.
const TERMS: u32 = 12;

/// `c_1` to `c_5` at `s`, from 0 up: at index k - 1.
pub(super) fn stumpff<S: Scalar>(s: S) -> [S; 5] {
    let [one, half, sixth] = [1.0, 0.5, 1.0 / 6.0].map(S::from_f64);
    if s.to_f64() < SERIES_UP_TO {
        let [c4, c5] = [4, 5].map(|k| series(k, s));
        let [c2, c3] = [half - s * c4, sixth - s * c5];
        return [one - s * c3, c2, c3, c4, c5];
    }
    let angle = s.sqrt();
    let c1 = angle.sin() / angle;
    let [c2, c3] = [(one - angle.cos()) / s, (one - c1) / s];
    [c1, c2, c3, (half - c2) / s, (sixth - c3) / s]
}

/// `c_k`, by Horner's rule: `(1 - s / ((k + 1) (k + 2)) (1 - s / ((k + 3) (k + 4)) (...))) / k!`.
fn series<S: Scalar>(k: u32, s: S) -> S {
    let nested = (0..TERMS).rev().fold(S::ONE, |inner, j| {
        let divisor = f64::from((k + 2 * j + 1) * (k + 2 * j + 2));
        S::ONE - s * inner / S::from_f64(divisor)
    });
    nested / S::from_f64((1..=k).map(f64::from).product())
}

/// `dc_k/ds` for k = 1, 2, 3, from `c_1` to `c_5`.
pub(super) fn slopes<S: Scalar>(c: &[S; 5]) -> [S; 3] {
    let half = S::from_f64(0.5);
    [1, 2, 3].map(|k| half * (S::from_f64(k as f64) * c[k + 1] - c[k]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn series_and_sines_meet_to_rounding() {
        let (below, above) = (SERIES_UP_TO * (1.0 - 1e-15), SERIES_UP_TO);
        for (below, above) in stumpff(below).into_iter().zip(stumpff(above)) {
            approx::assert_relative_eq!(below, above, max_relative = 3e-15);
        }
        for (below, above) in slopes(&stumpff(below)).into_iter().zip(slopes(&stumpff(above))) {
            approx::assert_relative_eq!(below, above, max_relative = 3e-14);
        }
    }

    #[test]
    fn at_zero_they_are_reciprocals_of_factorials() {
        assert_eq!(stumpff(0.0), [1.0, 0.5, 1.0 / 6.0, 1.0 / 24.0, 1.0 / 120.0]);
        let expected = [-1.0 / 6.0, -1.0 / 24.0, -1.0 / 120.0];
        for (slope, expected) in slopes(&stumpff(0.0)).into_iter().zip(expected) {
            approx::assert_relative_eq!(slope, expected, max_relative = 1e-15);
        }
    }

    #[test]
    fn they_are_sines_and_cosines_over_powers_of_the_angle() {
        for angle in [0.3_f64, 1.0, 1.9, 2.1, 3.0, 40.0] {
            let [c1, c2, c3, ..] = stumpff(angle * angle);
            let (sin, cos) = angle.sin_cos();
            approx::assert_relative_eq!(c1, sin / angle, max_relative = 1e-15);
            let expected = 2.0 * (angle / 2.0).sin().powi(2) / (angle * angle);
            approx::assert_relative_eq!(c2, expected, max_relative = 1e-14);
            approx::assert_relative_eq!(c1 * angle + c3 * angle.powi(3), angle, epsilon = 1e-13);
            approx::assert_relative_eq!(1.0 - angle * angle * c2, cos, epsilon = 1e-13);
        }
    }
}
