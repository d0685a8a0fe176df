//! Directions of any length.
//!
//! # Forward
//! `u = d / |d|`. The length is taken of `d / m`, with m the largest of the absolute components, so it
//! neither overflows nor underflows.
//!
//! # Backward
//! `d_bar = (u_bar - (u_bar . u) u) / |d|`.

use bokashi_core::Scalar;

use crate::vector::{Vector3, across, dot, scaled};

/// A unit vector and the length of what it was made of. Of a zero, or of what is not finite, it is not
/// finite either: in a loop that becomes vectors nothing is refused along the way.
#[inline(always)]
pub(super) fn unit<T: Scalar>(d: Vector3<T>) -> (Vector3<T>, T) {
    let largest = d[0].abs().maximum_or_nan(d[1].abs()).maximum_or_nan(d[2].abs());
    let near_1 = d.map(|entry| entry / largest);
    let root = dot(near_1, near_1).sqrt();
    (scaled(T::ONE / root, near_1), largest * root)
}

/// The gradient of a direction from that of its unit vector.
#[inline(always)]
pub(super) fn pull_back_unit<T: Scalar>(
    unit: Vector3<T>,
    length: T,
    unit_bar: Vector3<T>,
) -> Vector3<T> {
    across(unit, unit_bar).map(|entry| entry / length)
}
