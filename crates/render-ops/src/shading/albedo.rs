//! How much light a GGX lobe reflects in all.
//!
//! # Forward
//! With `mu = n . v` and `a = roughness^2`, single scattering reflects `F0 (E - E1) + E1` of light that has
//! the same radiance from everywhere: `E = int D G / (n . l) (n . l) dl` is the share without Fresnel's
//! factor, and E1 the same integral times `(1 - v . h)^5`. Both are rational functions here, with
//! `x = mu / A`, `A^2 = a^2 + (1 - a^2) mu^2`: `E = P(x, a) / Q(x, a)` and `E1 = (P(mu, x, r) / Q(mu, x, r))^5`.
//!
//! They were fitted to integrals by 256 x 256 samples of the visible normals, 100 angles and 40 roughnesses
//! from 1/32 to 1. E is off by 0.9 % of itself at most, E1 by 0.007.
//!
//! # Backward
//! By the quotient rule; `dx/dmu = a^2 / A^3`, `dx/da = -mu a (1 - mu^2) / A^3`.
//!
//! # Source
//! Karis, *Real shading in Unreal Engine 4*, SIGGRAPH 2013 course (the two integrals); Heitz, *Sampling
//! the GGX distribution of visible normals*, JCGT 7(4), 2018 (the samples). The fit is our own.

use bokashi_core::Scalar;

/// How an albedo changes with `n . v` and with the roughness.
pub(super) type Slopes<T> = [T; 2];

/// Coefficients of 1, y, y^2, y^3, x, x y, x y^2, x^2, x^2 y, x^3.
const SINGLE: [[f64; 10]; 2] = [
    [
        1.005374,
        -1.314278,
        0.6304391,
        -0.03147736,
        -0.06139544,
        1.104237,
        -0.6674236,
        -0.8710841,
        0.2753488,
        0.1783851,
    ],
    [1.0, -1.269089, 0.5616004, 0.0, 0.1378009, 1.269197, 0.0, -0.8845647, 0.0, 0.0],
];

/// Coefficients of 1, r, r^2, x, x r, x^2, mu, mu r, mu x, mu^2.
const EDGE: [[f64; 10]; 2] = [
    [
        1.007863,
        -0.8845012,
        0.970924,
        -0.8116722,
        0.730599,
        -0.09028138,
        -2.147737,
        -0.4451467,
        2.573249,
        -0.457924,
    ],
    [
        1.0, -0.5205566, 1.556438, -0.7623996, 0.316458, -0.1305518, -2.380545, -0.7456371,
        2.918344, 0.07035497,
    ],
];

/// A cubic polynomial, and its derivatives by x and y.
#[inline(always)]
fn cubic<T: Scalar>(coefficients: [f64; 10], x: T, y: T) -> (T, [T; 2]) {
    let c = coefficients.map(T::from_f64);
    let (two, three) = (T::from_f64(2.0), T::from_f64(3.0));
    let (linear, square) = (c[4] + y * (c[5] + y * c[6]), c[7] + y * c[8]);
    let value = c[0] + y * (c[1] + y * (c[2] + y * c[3])) + x * (linear + x * (square + x * c[9]));
    let by_x = linear + x * (two * square + three * x * c[9]);
    let by_y = c[1] + y * (two * c[2] + three * y * c[3]) + x * (c[5] + two * y * c[6] + x * c[8]);
    (value, [by_x, by_y])
}

/// A quadratic polynomial, and its derivatives by mu, x and r.
#[inline(always)]
fn quadratic<T: Scalar>(coefficients: [f64; 10], mu: T, x: T, r: T) -> (T, [T; 3]) {
    let c = coefficients.map(T::from_f64);
    let two = T::from_f64(2.0);
    let (of_x, of_mu) = (c[3] + r * c[4] + x * c[5], c[6] + r * c[7] + x * c[8] + mu * c[9]);
    let value = c[0] + r * (c[1] + r * c[2]) + x * of_x + mu * of_mu;
    let by_x = of_x + x * c[5] + mu * c[8];
    (value, [of_mu + mu * c[9], by_x, c[1] + two * r * c[2] + x * c[4] + mu * c[7]])
}

/// A quotient and its derivatives.
#[inline(always)]
fn quotient<T: Scalar, const N: usize>(
    (p, p_slopes): (T, [T; N]),
    (q, q_slopes): (T, [T; N]),
) -> (T, [T; N]) {
    let inverse = T::ONE / q;
    let value = p * inverse;
    (value, std::array::from_fn(|k| (p_slopes[k] - value * q_slopes[k]) * inverse))
}

/// `mu / A`, and how it changes with mu and the roughness.
#[inline(always)]
fn spread<T: Scalar>(mu: T, roughness: T) -> (T, Slopes<T>) {
    let a = roughness * roughness;
    let square = a * a + (T::ONE - a * a) * mu * mu;
    let length = square.sqrt();
    let share = a / (square * length);
    let by_a = -(mu * share * (T::ONE - mu * mu));
    (mu / length, [a * share, by_a * (roughness + roughness)])
}

/// The share E of light from everywhere that a lobe reflects without Fresnel's factor.
#[inline(always)]
pub(super) fn single<T: Scalar>(mu: T, roughness: T) -> (T, Slopes<T>) {
    let (x, [x_by_mu, x_by_roughness]) = spread(mu, roughness);
    let a = roughness * roughness;
    let (value, [by_x, by_a]) = quotient(cubic(SINGLE[0], x, a), cubic(SINGLE[1], x, a));
    (value, [by_x * x_by_mu, by_x * x_by_roughness + by_a * (roughness + roughness)])
}

/// What a lobe loses, `1 - E`, to the last digit: summed in wide numbers, since E is near 1.
#[inline(always)]
pub(super) fn lost<T: Scalar>(mu: T, roughness: T) -> T {
    let (mu, roughness) = (mu.widen(), roughness.widen());
    let (x, _) = spread(mu, roughness);
    let a = roughness * roughness;
    T::narrow(T::Wide::ONE - cubic(SINGLE[0], x, a).0 / cubic(SINGLE[1], x, a).0)
}

/// The share with the factor `(1 - v . h)^5`: E1.
#[inline(always)]
pub(super) fn edge<T: Scalar>(mu: T, roughness: T) -> (T, Slopes<T>) {
    let (x, [x_by_mu, x_by_roughness]) = spread(mu, roughness);
    let (p, q) = (quadratic(EDGE[0], mu, x, roughness), quadratic(EDGE[1], mu, x, roughness));
    let (root, [by_mu, by_x, by_roughness]) = quotient(p, q);
    let fourth = root * root * (root * root);
    let factor = T::from_f64(5.0) * fourth;
    let slopes = [by_mu + by_x * x_by_mu, by_roughness + by_x * x_by_roughness];
    (fourth * root, slopes.map(|slope| factor * slope))
}
