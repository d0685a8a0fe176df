//! Formulas of one triangle in space.

use bokashi_render_ops::glam::DVec3;

/// Whether a face names a vertex twice.
pub(crate) fn repeats_a_vertex([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

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

/// `x / y` between 0 and 1, and 0 where `y` is not positive.
fn share(x: f64, y: f64) -> f64 {
    if y > 0.0 { (x / y).clamp(0.0, 1.0) } else { 0.0 }
}

/// The barycentric coordinates of the point of a triangle that is nearest to `p`: at an edge or a corner
/// those of the others are exactly 0. A triangle without an area gives some point of it.
///
/// # Source
/// Ericson, *Real-Time Collision Detection*, 2005, section 5.1.5: the regions of Voronoi.
pub(crate) fn nearest([a, b, c]: [DVec3; 3], p: DVec3) -> [f64; 3] {
    let (ab, ac) = (b - a, c - a);
    let (d1, d2) = (ab.dot(p - a), ac.dot(p - a));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let (d3, d4) = (ab.dot(p - b), ac.dot(p - b));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let toward_c = d1 * d4 - d3 * d2;
    if toward_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = share(d1, d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let (d5, d6) = (ab.dot(p - c), ac.dot(p - c));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let toward_b = d5 * d2 - d1 * d6;
    if toward_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = share(d2, d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let toward_a = d3 * d6 - d5 * d4;
    if toward_a <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let t = share(d4 - d3, (d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let sum = toward_a + toward_b + toward_c;
    let (v, w) = (share(toward_b, sum), share(toward_c, sum));
    [(1.0 - v - w).max(0.0), v, w]
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
            let found = at(nearest(CORNERS, p)).distance(p);
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
                let weights = nearest(corners, p);
                assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{weights:?}");
                assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-15);
            }
            assert_eq!(quality(corners), 0.0);
        }
    }

    #[test]
    fn equal_sides_have_quality_one() {
        let corners = [DVec3::X, DVec3::Y, DVec3::Z];
        assert!((quality(corners) - 1.0).abs() < 1e-15);
        assert_eq!(area_vector(CORNERS), DVec3::Z);
    }
}
