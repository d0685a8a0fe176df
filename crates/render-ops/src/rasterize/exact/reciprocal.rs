//! Integrals of polynomials over t and over t^2 along a segment, where t is linear and positive.
//!
//! At the share u of the segment t is `(1 - u) a + u b`. With `m = (a + b) / 2`, `alpha = a / m`,
//! `beta = b / m`, `delta = (b - a) / (a + b)`, `x = delta^2` and z from -1 to 1 along the segment,
//! t is `m (1 + delta z)`. Odd powers of z cancel in pairs. All integrals come from two functions of x:
//!
//! `S_4 = int_0^1 z^4 / (1 - x z^2) dz = sum x^k / (2 k + 5)`, and
//! `S_2 = int_0^1 z^2 / (1 - x z^2) dz = 1/3 + x S_4`.
//!
//! From them as below, with `e = 1 - alpha beta S_2`, `W = S_4 (3 - x) / 2 - 1/6` and
//! `V = (1 - 3 alpha beta S_4) / 2`. Logarithms would cancel where t hardly changes. So the series
//! is summed up to [`MOST_X`], and only beyond it `S_2 = (ln(b / a) / (2 delta) - 1) / x`.

use bokashi_core::Scalar;

/// The series ends after 12 terms: up to here its remainder is below 1e-18. Ends differ by a factor of
/// 1.5.
const MOST_X: f64 = 0.04;

/// Up to here 3 and 6 terms do.
const SMALL_X: [f64; 2] = [1e-6, 1e-3];

/// A segment whose t is `a` at one end and `b` at the other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reciprocal<S> {
    /// `1 / (2 m)`.
    scale: S,
    alpha: S,
    beta: S,
    delta: S,
    s_2: S,
    s_4: S,
}

#[inline(always)]
fn number<S: Scalar>(value: f64) -> S {
    S::from_f64(value)
}

impl<S: Scalar> Reciprocal<S> {
    #[inline(always)]
    pub(super) fn new(a: S, b: S) -> Self {
        let scale = S::ONE / (a + b);
        let (alpha, beta, delta) = ((a + a) * scale, (b + b) * scale, (b - a) * scale);
        let x = delta * delta;
        let third = number::<S>(1.0 / 3.0);
        let (s_2, s_4) = if x <= number(MOST_X) {
            let s_4 = if x <= number(SMALL_X[0]) {
                series::<S, 3>(x)
            } else if x <= number(SMALL_X[1]) {
                series::<S, 6>(x)
            } else {
                series::<S, 12>(x)
            };
            (third + x * s_4, s_4)
        } else {
            let s_2 = ((b / a).ln() / (delta + delta) - S::ONE) / x;
            (s_2, (s_2 - third) / x)
        };
        Self { scale, alpha, beta, delta, s_2, s_4 }
    }

    /// The integrals of `(1 - u)^2`, `u (1 - u)` and `u^2` over t.
    #[inline(always)]
    pub(super) fn over_t(&self) -> [S; 3] {
        let Self { scale, alpha, beta, s_2, .. } = *self;
        let factor = number::<S>(0.5) * scale;
        [
            factor * (S::ONE + beta * beta * s_2),
            factor * (S::ONE - alpha * beta * s_2),
            factor * (S::ONE + alpha * alpha * s_2),
        ]
    }

    /// The integrals of `u (1 - u)^2`, `u^2 (1 - u)` and `u^3` over t^2.
    #[inline(always)]
    pub(super) fn over_t_squared(&self) -> [S; 3] {
        let Self { scale, alpha, beta, delta, s_2, s_4 } = *self;
        let (half, three) = (number::<S>(0.5), number::<S>(3.0));
        let x = delta * delta;
        let e = S::ONE - alpha * beta * s_2;
        let w = half * s_4 * (three - x) - number(1.0 / 6.0);
        let v = half * (S::ONE - three * alpha * beta * s_4);
        let factor = half * scale * scale;
        let twice = delta + delta;
        [
            factor * (e + twice * beta * w),
            factor * (e - twice * alpha * w),
            factor * (S::ONE + alpha * alpha * (three * s_2 - twice / beta * v)),
        ]
    }
}

/// The first terms of `S_4`.
#[inline(always)]
fn series<S: Scalar, const TERMS: usize>(x: S) -> S {
    (0..TERMS).rev().fold(S::ZERO, |sum, k| sum * x + number(COEFFICIENTS[k]))
}

/// `1 / (2 k + 5)`.
const COEFFICIENTS: [f64; 12] = {
    let mut coefficients = [0.0; 12];
    let mut k = 0;
    while k < 12 {
        coefficients[k] = 1.0 / (2 * k + 5) as f64;
        k += 1;
    }
    coefficients
};

#[cfg(test)]
mod tests {
    use super::super::quadrature::nodes;
    use super::*;

    fn integral(f: impl Fn(f64, f64) -> f64) -> f64 {
        nodes(64).into_iter().map(|[u, rest, weight]| weight * f(u, rest)).sum()
    }

    /// Both sides of where formulas change, and all ratios up to the largest.
    #[test]
    fn integrals_are_those_of_a_fine_quadrature() {
        let at_x = |x: f64| (1.0 + x.sqrt()) / (1.0 - x.sqrt());
        let borders = [MOST_X, SMALL_X[0], SMALL_X[1]].map(|x| [at_x(0.999 * x), at_x(1.001 * x)]);
        let powers = (0..=40).map(|k| f64::powi(2.0, k));
        let mild = (1..16).map(|k| 1.0 + f64::powi(10.0, -k));
        for ratio in powers.chain(mild).chain(borders.into_iter().flatten()) {
            for [a, b] in [[1.0, ratio], [ratio, 1.0], [3e-7, 3e-7 * ratio]] {
                let reciprocal = Reciprocal::new(a, b);
                let t = |u: f64, rest: f64| rest * a + u * b;
                let over_t = [
                    integral(|u, rest| rest * rest / t(u, rest)),
                    integral(|u, rest| u * rest / t(u, rest)),
                    integral(|u, rest| u * u / t(u, rest)),
                ];
                let square = |u: f64, rest: f64| t(u, rest) * t(u, rest);
                let over_t_squared = [
                    integral(|u, rest| u * rest * rest / square(u, rest)),
                    integral(|u, rest| u * u * rest / square(u, rest)),
                    integral(|u, rest| u * u * u / square(u, rest)),
                ];
                let of_t = (reciprocal.over_t(), over_t, 1e-13);
                // S_4 loses some digits where the logarithm begins.
                let of_squares = (reciprocal.over_t_squared(), over_t_squared, 3e-13);
                for (found, expected, bound) in [of_t, of_squares] {
                    for (found, expected) in found.into_iter().zip(expected) {
                        let error = (found / expected - 1.0).abs();
                        assert!(error < bound, "{a} {b}: {found} {expected}");
                    }
                }
            }
        }
    }
}
