//! Directions of any length.
//!
//! # Forward
//! `u = d / |d|`. The length is taken of `d / m`, with m the largest of the absolute components, so it
//! neither overflows nor underflows.
//!
//! # Backward
//! `d_bar = (u_bar - (u_bar . u) u) / |d|`.

use bokashi_core::Scalar;

/// `a . b`.
#[inline(always)]
pub(crate) fn dot<T: Scalar>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a x b`.
#[inline(always)]
pub(crate) fn cross<T: Scalar>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a + by b`.
#[inline(always)]
pub(crate) fn plus<T: Scalar>(a: [T; 3], by: T, b: [T; 3]) -> [T; 3] {
    [a[0] + by * b[0], a[1] + by * b[1], a[2] + by * b[2]]
}

/// A unit vector and the length of what it was made of. Of a zero, or of what is not finite, it is not
/// finite either.
#[inline(always)]
pub(crate) fn unit<T: Scalar>(d: [T; 3]) -> ([T; 3], T) {
    let largest = d[0].abs().maximum_or_nan(d[1].abs()).maximum_or_nan(d[2].abs());
    let scaled = [d[0] / largest, d[1] / largest, d[2] / largest];
    let root = dot(scaled, scaled).sqrt();
    let inverse = T::ONE / root;
    (scaled.map(|entry| entry * inverse), largest * root)
}

/// The gradient of a direction from that of its unit vector.
#[inline(always)]
pub(crate) fn pull_back_unit<T: Scalar>(unit: [T; 3], length: T, unit_bar: [T; 3]) -> [T; 3] {
    let along = dot(unit, unit_bar);
    plus(unit_bar, -along, unit).map(|entry| entry / length)
}
