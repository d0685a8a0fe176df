//! Formulas of one triangle in space.

use bokashi_render_ops::glam::DVec3;

/// The normal whose length is twice the area.
#[inline]
pub(crate) fn area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// `4 sqrt(3) area / (sum of squared sides)`: 1 for equal sides, 0 without an area.
#[inline]
pub(crate) fn quality([a, b, c]: [DVec3; 3]) -> f64 {
    let sides = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
    if sides > 0.0 { 12_f64.sqrt() * area_vector([a, b, c]).length() / sides } else { 0.0 }
}

/// The corner of a face at which its vertex `vertex` stands.
#[inline]
pub(crate) fn corner_of(face: [u32; 3], vertex: u32) -> usize {
    usize::from(face[1] == vertex) + 2 * usize::from(face[2] == vertex)
}

/// The corners of a face after and before `vertex`.
#[inline]
pub(crate) fn other_corners(face: [u32; 3], vertex: u32) -> [u32; 2] {
    let corner = corner_of(face, vertex);
    [face[(corner + 1) % 3], face[(corner + 2) % 3]]
}

/// A bound on how far rounding moves a point, over its largest coordinate: a few sums and products.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// The barycentrics of the point of a triangle that is nearest to `p`, and the square of its distance.
///
/// The point lies on an edge, or it is the foot of the perpendicular from `p`, where this foot is inside and nearer. On
/// an edge or a corner, to within rounding, the other barycentrics are exactly 0. The distance is measured to the point
/// that is returned. So in a sliver rounding may return a point that is slightly too far, but with its true distance. A
/// triangle without an area counts as its edges.
pub(crate) fn nearest(corners: [DVec3; 3], p: DVec3) -> ([f64; 3], f64) {
    let [a, b, c] = corners;
    let (to_b, to_c, to_p) = (b - a, c - a, p - a);
    let size = corners.iter().fold(p.abs(), |size, corner| size.max(corner.abs()));
    let rounding = ROUNDING * size.max_element();
    let mut best = ([1.0, 0.0, 0.0], f64::INFINITY);
    let mut offer = |weights: [f64; 3]| {
        let found = (to_p - weights[1] * to_b - weights[2] * to_c).length_squared();
        if found < best.1 {
            best = (weights, found);
        }
    };
    // By the corner that an edge faces.
    let mut lengths = [0.0; 3];
    for corner in 0..3 {
        let [from, to] = [1, 2].map(|step| (corner + step) % 3);
        let along = corners[to] - corners[from];
        let length = along.length_squared();
        let share = (p - corners[from]).dot(along) / length;
        let near = rounding / length.sqrt();
        let share = if share > near && share < 1.0 - near { share } else { f64::from(share > 0.5) };
        let mut weights = [0.0; 3];
        (weights[from], weights[to]) = (1.0 - share, share);
        offer(weights);
        lengths[corner] = length;
    }
    let normal = to_b.cross(to_c);
    let square = normal.length_squared();
    if square > 0.0 {
        let v = to_p.cross(to_c).dot(normal) / square;
        let w = to_b.cross(to_p).dot(normal) / square;
        let weights = [1.0 - v - w, v, w];
        // A weight times twice the area is the length of its edge times how far the foot is from there.
        let is_within = |k: usize| {
            let weight = weights[k];
            weight > 0.0 && weight * weight * square > rounding * rounding * lengths[k]
        };
        if (0..3).all(is_within) {
            offer(weights);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    #[test]
    fn the_nearest_point_is_nearer_than_all_others_of_the_triangle() {
        for i in 0..1000 {
            let p = DVec3::new((i % 10) as f64, (i / 10 % 10) as f64, (i / 100) as f64) / 3.0 - 1.0;
            let at = |w: [f64; 3]| (0..3).map(|k| w[k] * CORNERS[k]).sum::<DVec3>();
            let (weights, square) = nearest(CORNERS, p);
            let found = at(weights).distance(p);
            assert!((square.sqrt() - found).abs() < 1e-12, "{p}");
            for (u, v) in (0..=20).flat_map(|u| (0..=20 - u).map(move |v| (u, v))) {
                let (u, v) = (u as f64 / 20.0, v as f64 / 20.0);
                assert!(found <= at([1.0 - u - v, u, v]).distance(p) + 1e-12, "{p}");
            }
        }
    }

    #[test]
    fn a_triangle_without_an_area_gives_one_of_its_points() {
        for corners in [[DVec3::X; 3], [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X]] {
            for p in [DVec3::Y, DVec3::ZERO, 3.0 * DVec3::X, DVec3::splat(0.3)] {
                let (weights, square) = nearest(corners, p);
                assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{weights:?}");
                let found = (0..3).map(|k| weights[k] * corners[k]).sum::<DVec3>();
                assert!((square - found.distance_squared(p)).abs() < 1e-12);
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            }
            assert_eq!(quality(corners), 0.0);
        }
    }

    #[test]
    fn points_on_edges_and_corners_have_weights_that_are_exactly_0() {
        let corners =
            [DVec3::new(0.1, 0.7, -0.3), DVec3::new(1.3, -0.2, 0.4), DVec3::new(0.9, 0.8, 1.7)];
        let normal = area_vector(corners);
        for k in 0..3 {
            let [a, b, c] = [0, 1, 2].map(|step| corners[(k + step) % 3]);
            let outward = (b - a).cross(normal);
            let inward = (c - a).normalize();
            for i in 0..=50 {
                // On the edge, above it, and beyond it.
                let on = a + f64::from(i) / 50.0 * (b - a);
                for p in [on, on + 0.1 * normal, on + 0.3 * outward] {
                    let (weights, _) = nearest(corners, p);
                    assert_eq!(weights[(k + 2) % 3], 0.0, "{weights:?}");
                }
            }
            // A trifle within it is no longer on it.
            let (weights, square) = nearest(corners, 0.5 * (a + b) + 1e-13 * inward);
            assert!(weights.iter().all(|weight| *weight > 0.0) && square < 1e-30, "{weights:?}");
            let beyond = a + 0.2 * (a - b) + 0.2 * (a - c);
            let mut corner = [0.0; 3];
            corner[k] = 1.0;
            for p in [a, beyond, beyond + 0.3 * normal] {
                assert_eq!(nearest(corners, p).0, corner);
            }
        }
    }

    #[test]
    fn each_vertex_has_its_corner_between_two_others() {
        let face = [7, 2, 5];
        assert_eq!(face.map(|vertex| corner_of(face, vertex)), [0, 1, 2]);
        assert_eq!(face.map(|vertex| other_corners(face, vertex)), [[2, 5], [5, 7], [7, 2]]);
    }

    #[test]
    fn equal_sides_have_quality_one() {
        let corners = [DVec3::X, DVec3::Y, DVec3::Z];
        assert!((quality(corners) - 1.0).abs() < 1e-15);
        assert_eq!(area_vector(CORNERS), DVec3::Z);
    }
}
