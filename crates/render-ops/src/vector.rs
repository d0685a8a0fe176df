//! Vectors of three numbers, and their directions.
//!
//! # Directions
//! `n = v / |v|`, and backward `v_bar = (n_bar - n (n . n_bar)) / |v|`. A vector is multiplied first by
//! the power of two that brings its largest entry into [1, 2). So its direction has the same bits
//! whatever power of two it is multiplied by, and no square leaves the range of the numbers.

use bokashi_core::Scalar;

/// More than the relative rounding error of a cross product of differences, against the product of
/// their lengths: three roundings of each of two products.
pub(crate) const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A vector of three numbers.
pub(crate) type Vector3<S> = [S; 3];

/// `a + b`.
#[inline(always)]
pub(crate) fn sum<S: Scalar>(a: Vector3<S>, b: Vector3<S>) -> Vector3<S> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline(always)]
pub(crate) fn difference<S: Scalar>(a: Vector3<S>, b: Vector3<S>) -> Vector3<S> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `s a`.
#[inline(always)]
pub(crate) fn scaled<S: Scalar>(s: S, a: Vector3<S>) -> Vector3<S> {
    a.map(|entry| s * entry)
}

/// `a + s b`.
#[inline(always)]
pub(crate) fn plus<S: Scalar>(a: Vector3<S>, s: S, b: Vector3<S>) -> Vector3<S> {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// `a . b`.
#[inline(always)]
pub(crate) fn dot<S: Scalar>(a: Vector3<S>, b: Vector3<S>) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a x b`.
#[inline(always)]
pub(crate) fn cross<S: Scalar>(a: Vector3<S>, b: Vector3<S>) -> Vector3<S> {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// `a` without its component along the unit vector `n`.
#[inline(always)]
pub(crate) fn across<S: Scalar>(n: Vector3<S>, a: Vector3<S>) -> Vector3<S> {
    difference(a, scaled(dot(n, a), n))
}

/// The gradient of a vector of a length above 0 from that of its direction `unit`; 0 where the length is 0.
#[inline(always)]
pub(crate) fn direction_bar<S: Scalar>(
    unit: Vector3<S>,
    length: S,
    unit_bar: Vector3<S>,
) -> Vector3<S> {
    if length == S::ZERO {
        return [S::ZERO; 3];
    }
    scaled(S::ONE / length, across(unit, unit_bar))
}

/// The largest size of an entry. A NaN may count or not.
#[inline(always)]
pub(crate) fn largest<S: Scalar>(a: Vector3<S>) -> S {
    larger(larger(a[0].abs(), a[1].abs()), a[2].abs())
}

/// The larger of two numbers; either one where one is NaN. It is a single instruction.
#[inline(always)]
pub(crate) fn larger<S: Scalar>(a: S, b: S) -> S {
    if a > b { a } else { b }
}

/// The power of two that brings a positive number into [1, 2). It brings a subnormal number near it,
/// and numbers from 2^1023 on into [2, 4); it is the smallest one for what is not finite.
#[inline(always)]
pub(crate) fn power_of_two_to_1<S: Scalar>(number: S) -> S {
    let exponent = number.to_f64().to_bits() >> 52 & 0x7ff;
    S::from_f64(f64::from_bits(2046_u64.saturating_sub(exponent).max(1) << 52))
}

/// Where a vector points.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Direction<S> {
    /// The vector divided by its length.
    pub(crate) unit: Vector3<S>,
    /// The length of the vector times `factor`.
    pub(crate) length: S,
    /// A power of two.
    pub(crate) factor: S,
}

impl<S: Scalar> Direction<S> {
    /// The direction of `v`; `None` where v is zero. A vector that is not finite has NaN in its
    /// direction.
    #[inline(always)]
    pub(crate) fn new(v: Vector3<S>) -> Option<Self> {
        Self::beyond(v, S::ZERO)
    }

    /// The direction of `v`; `None` where v is no longer than `error`.
    #[inline(always)]
    pub(crate) fn beyond(v: Vector3<S>, error: S) -> Option<Self> {
        let factor = power_of_two_to_1(largest(v));
        let v = scaled(factor, v);
        let length = dot(v, v).sqrt();
        // What is not finite is let through.
        if length <= factor * error && length.is_finite() {
            return None;
        }
        Some(Self { unit: v.map(|entry| entry / length), length, factor })
    }

    /// The gradient with respect to the vector from the one with respect to its unit vector.
    #[inline(always)]
    pub(crate) fn pull_back(&self, unit_bar: Vector3<S>) -> Vector3<S> {
        scaled(self.factor / self.length, across(self.unit, unit_bar))
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use glam::DVec3;

    use super::*;

    const A: [f64; 3] = [0.3, -1.7, 0.6];
    const B: [f64; 3] = [-0.9, 0.4, 2.1];

    #[test]
    fn products_are_glams() {
        let [a, b] = [A, B].map(DVec3::from_array);
        assert_eq!(dot(A, B), a.dot(b));
        assert_eq!(cross(A, B), a.cross(b).to_array());
        assert_eq!(sum(A, B), (a + b).to_array());
        assert_eq!(scaled(2.5, difference(A, B)), ((a - b) * 2.5).to_array());
        assert_eq!(plus(A, 2.5, B), (a + 2.5 * b).to_array());
        let unit = b.normalize();
        assert_relative_eq!(dot(across(unit.to_array(), A), B), 0.0, epsilon = 1e-15);
    }

    #[test]
    fn directions_have_the_same_bits_at_any_scale() {
        let unit = Direction::new(A).unwrap().unit;
        assert_relative_eq!(dot(unit, unit), 1.0, epsilon = 4e-16);
        for power in [-1000, -500, -1, 1, 500, 1000] {
            let scale = f64::powi(2.0, power);
            let there = Direction::new(scaled(scale, A)).unwrap();
            assert_eq!(there.unit, unit);
            assert_eq!(there.length / there.factor, scale * Direction::new(A).unwrap().length);
            let (bar, plain) = (there.pull_back(B), Direction::new(A).unwrap().pull_back(B));
            assert_eq!(scaled(scale, bar), plain);
        }
        for tiny in [f64::from_bits(1), f64::MIN_POSITIVE, f64::MAX] {
            assert_eq!(Direction::new([0.0, -tiny, 0.0]).unwrap().unit, [0.0, -1.0, 0.0]);
        }
    }

    #[test]
    fn nothing_points_nowhere_and_a_nan_is_not_masked() {
        assert!(Direction::new([0.0, -0.0, 0.0]).is_none());
        assert!(Direction::beyond([3e-20, 4e-20, 0.0], 5e-20).is_none());
        assert!(Direction::beyond([3e-20, 4e-20, 0.0], 4e-20).is_some());
        for bad in [f64::NAN, f64::INFINITY] {
            assert!(Direction::new([1.0, bad, 0.0]).unwrap().unit[1].is_nan());
        }
    }
}
