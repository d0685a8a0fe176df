//! A face in space: its edges, its normal, its angles.
//!
//! # Formulas
//! `e_k = p_(k+2) - p_(k+1)` is the edge that faces corner k, indices modulo 3, and
//! `c = e_1 x e_2 = e_2 x e_0 = e_0 x e_1`: twice the area, along the normal `n = c / |c|` of the side
//! from which the corners run counter-clockwise. The product of the two shorter edges has the fewest
//! rounding errors: of a needle, two sides are alike, and differ by one that has all its digits.
//!
//! The angle at corner k is `theta_k = atan2(|c|, -e_(k+1) . e_(k+2))`.
//!
//! # Backward
//! From `c_bar`: `p_bar_k = c_bar x e_k`. From the angles, with `q_k = n x e_k / |e_k|^2`:
//! `p_bar_k = (theta_bar_k - theta_bar_(k+2)) q_(k+1) + (theta_bar_k - theta_bar_(k+1)) q_(k+2)`.
//!
//! # Scale
//! Edges are multiplied by a power of two that brings the longest one near 1. So normals and angles
//! have the same bits for a face of any size, and no product leaves the range of the numbers.
//!
//! # Degenerate faces
//! A face has no normal where `|c|` is no larger than a bound on its rounding error, `8 eps |a| |b|`
//! with the two shorter edges a and b. Nor has it one where an edge is shorter than 2^-450 of the
//! longest: products of these would leave the range of the numbers.

use bokashi_core::Scalar;

use crate::vector::{
    ROUNDING, Vector3, across, cross, difference, dot, larger, largest, power_of_two_to_1, scaled,
};

/// The square of the shortest edge that a face may have whose longest edge is near 1.
const SHORTEST: f64 = f64::from_bits(123 << 52);

/// A face that is not degenerate. All lengths are times `factor`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facet<S> {
    /// Edge k faces corner k.
    pub(crate) edges: [Vector3<S>; 3],
    /// A power of two.
    pub(crate) factor: S,
    /// The corner that faces the longest edge.
    pub(crate) apex: usize,
    /// The unit normal.
    pub(crate) normal: Vector3<S>,
    /// Twice the area.
    pub(crate) area: S,
    /// A bound on the error of the normal.
    pub(crate) doubt: S,
}

impl<S: Scalar<Wide = S>> Facet<S> {
    /// The face with these corners in the rows of `positions: [V, 3]`; `None` where it is degenerate.
    #[inline(always)]
    pub(crate) fn new<T: Scalar<Wide = S>>(positions: &[T], face: [u32; 3]) -> Option<Self> {
        let rows = positions.as_chunks::<3>().0;
        let corners = face.map(|vertex| rows[vertex as usize].map(T::widen));
        let (edges, factor) = edges(corners);
        let squares = edges.map(|edge| dot(edge, edge));
        let apex = match () {
            () if squares[0] >= squares[1] && squares[0] >= squares[2] => 0,
            () if squares[1] >= squares[2] => 1,
            () => 2,
        };
        let [next, last] = [1, 2].map(|k| (apex + k) % 3);
        let c = cross(edges[next], edges[last]);
        let (square, bound) = (dot(c, c), squares[next] * squares[last]);
        let is_short = [next, last].iter().any(|&k| squares[k].to_f64() < SHORTEST);
        if is_short || square <= S::from_f64(ROUNDING * ROUNDING) * bound {
            return None;
        }
        let area = square.sqrt();
        let normal = c.map(|entry| entry / area);
        let doubt = S::from_f64(ROUNDING) * bound.sqrt() / area;
        Some(Self { edges, factor, apex, normal, area, doubt })
    }

    /// The angles at the corners, in radians.
    #[inline(always)]
    pub(crate) fn angles(&self) -> [S; 3] {
        let [e0, e1, e2] = self.edges;
        [[e1, e2], [e2, e0], [e0, e1]].map(|[a, b]| self.area.atan2(-dot(a, b)))
    }

    /// The gradient with respect to c from that with respect to the normal.
    #[inline(always)]
    pub(crate) fn pull_back_normal(&self, normal_bar: Vector3<S>) -> Vector3<S> {
        scaled(S::ONE / self.area, across(self.normal, normal_bar))
    }

    /// The gradients of the corners, without `factor`, from that with respect to c.
    #[inline(always)]
    pub(crate) fn pull_back_cross(&self, c_bar: Vector3<S>) -> [Vector3<S>; 3] {
        self.edges.map(|edge| cross(c_bar, edge))
    }

    /// The gradients of the corners, without `factor`, from those of the angles.
    #[inline(always)]
    pub(crate) fn pull_back_angles(&self, bars: [S; 3]) -> [Vector3<S>; 3] {
        let turned = |edge| scaled(S::ONE / dot(edge, edge), cross(self.normal, edge));
        let q = self.edges.map(turned);
        [0, 1, 2].map(|k| {
            let [next, last] = [(k + 1) % 3, (k + 2) % 3];
            let [by_next, by_last] = [bars[k] - bars[last], bars[k] - bars[next]];
            [0, 1, 2].map(|i| by_next * q[next][i] + by_last * q[last][i])
        })
    }
}

/// The edges, times the power of two that brings the largest coordinate of any of them into [1, 2).
#[inline(always)]
fn edges<S: Scalar>(corners: [Vector3<S>; 3]) -> ([Vector3<S>; 3], S) {
    let between =
        |[p, q, r]: [Vector3<S>; 3]| [difference(r, q), difference(p, r), difference(q, p)];
    let edges = between(corners);
    let size = |[a, b, c]: [Vector3<S>; 3]| larger(larger(largest(a), largest(b)), largest(c));
    let length = size(edges);
    if length.is_finite() {
        let factor = power_of_two_to_1(length);
        return (edges.map(|edge| scaled(factor, edge)), factor);
    }
    // Corners near either end of the range, farther apart than any number.
    let quarter = S::from_f64(0.25);
    let edges = between(corners.map(|corner| scaled(quarter, corner)));
    let factor = power_of_two_to_1(size(edges));
    (edges.map(|edge| scaled(factor, edge)), factor * quarter)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use glam::DVec3;

    use super::*;

    const FACE: [f64; 9] = [0.3, -0.2, 0.9, 1.4, 0.1, -0.6, -0.5, 0.8, 0.2];

    fn facet(positions: &[f64]) -> Option<Facet<f64>> {
        Facet::new(positions, [0, 1, 2])
    }

    #[test]
    fn normal_area_and_angles_are_glams() {
        let [p, q, r] = [0, 3, 6].map(|k| DVec3::from_slice(&FACE[k..]));
        let facet = facet(&FACE).unwrap();
        let c = (q - p).cross(r - p);
        assert_relative_eq!(facet.area, facet.factor * facet.factor * c.length(), epsilon = 1e-15);
        for (found, expected) in facet.normal.into_iter().zip(c.normalize().to_array()) {
            assert_relative_eq!(found, expected, epsilon = 1e-15);
        }
        let corners = [[p, q, r], [q, r, p], [r, p, q]];
        for (found, [at, a, b]) in facet.angles().into_iter().zip(corners) {
            assert_relative_eq!(found, (a - at).angle_between(b - at), epsilon = 1e-14);
        }
    }

    #[test]
    fn any_size_gives_the_same_bits() {
        let here = facet(&FACE).unwrap();
        for power in [-1000, -300, -100, 100, 300, 1022] {
            let there = facet(&FACE.map(|x| f64::powi(2.0, power) * x)).unwrap();
            assert_eq!(there.edges, here.edges);
            assert_eq!((there.normal, there.angles()), (here.normal, here.angles()));
        }
        // As far apart as numbers can be.
        let far = facet(&FACE.map(|x| f64::MAX.copysign(x))).unwrap();
        let near = facet(&FACE.map(|x| 1.0_f64.copysign(x))).unwrap();
        for k in 0..3 {
            assert_relative_eq!(far.normal[k], near.normal[k], epsilon = 1e-15);
        }
    }

    #[test]
    fn turned_corners_give_the_same_normal_and_swapped_ones_its_opposite() {
        let normal = |face| Facet::new(&FACE, face).unwrap().normal;
        assert_eq!(normal([1, 2, 0]), normal([0, 1, 2]));
        assert_eq!(normal([2, 0, 1]), normal([0, 1, 2]));
        assert_eq!(normal([0, 2, 1]), normal([0, 1, 2]).map(|entry: f64| -entry));
    }

    #[test]
    fn faces_without_an_area_are_degenerate_at_any_scale() {
        for size in [1e-300, 1e-30, 1.0, 1e30, 1e300] {
            for corners in [
                [0.0; 9],
                [1.0, 2.0, 3.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
                [0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9],
                [1.0, 1.0 / 3.0, 0.1, 2.0, 2.0 / 3.0, 0.2, 3.0, 1.0, 0.3],
            ] {
                assert!(facet(&corners.map(|x| size * x)).is_none(), "{size} {corners:?}");
            }
        }
        assert!(Facet::new(&FACE, [0, 1, 1]).is_none());
    }

    #[test]
    fn a_needle_keeps_the_digits_of_its_normal() {
        // In the plane of u and v, both of whole numbers: exact up to the size of the corners.
        let (u, v) = (DVec3::new(3.0, -2.0, 1.0), DVec3::new(1.0, 4.0, 5.0));
        let expected = u.cross(v).normalize();
        for width in [1e-3, 1e-7, 1e-12].map(|width: f64| f64::powi(2.0, width.log2() as i32)) {
            let tip = DVec3::new(1.0, 2.0, -1.0);
            for corners in [[tip, tip + u, tip + u + width * v], [tip + u, tip, tip + width * v]] {
                let corners: Vec<f64> = corners.iter().flat_map(DVec3::to_array).collect();
                let facet = facet(&corners).unwrap();
                let sign = DVec3::from(facet.normal).dot(expected).signum();
                let error = (DVec3::from(facet.normal) - sign * expected).length();
                assert!(error <= 4e-16, "{width:e}: {error:e}");
            }
        }
    }
}
