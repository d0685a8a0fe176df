//! Whether two faces cross.
//!
//! They cross where an edge of one passes through the inside of the other, which the signs of volumes tell. A sign that
//! rounding could have turned counts as 0. So faces that touch do not cross, and neither do faces in one plane.
//!
//! # Source
//! Shewchuk, *Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates*, 1997, for the
//! bound of rounding.

use bokashi_render_ops::glam::DVec3;

/// Six times the volume of (a, b, c, d), and 0 where its sign is in doubt. It is positive where d lies below the face
/// (a, b, c), which is seen counterclockwise from above.
#[inline]
fn volume([a, b, c]: [DVec3; 3], d: DVec3) -> f64 {
    // (7 + 56 eps) eps, eps = 2^-53, of the sum of the products' magnitudes.
    const BOUND: f64 = 7.771_561_172_376_104e-16;
    let (a, b, c) = (a - d, b - d, c - d);
    let (by_cx, bx_cy) = (b.y * c.x, b.x * c.y);
    let (cx_ay, cy_ax) = (c.x * a.y, c.y * a.x);
    let (ax_by, ay_bx) = (a.x * b.y, a.y * b.x);
    let volume = a.z * (bx_cy - by_cx) + b.z * (cx_ay - cy_ax) + c.z * (ax_by - ay_bx);
    let magnitude = a.z.abs() * (bx_cy.abs() + by_cx.abs())
        + b.z.abs() * (cx_ay.abs() + cy_ax.abs())
        + c.z.abs() * (ax_by.abs() + ay_bx.abs());
    if volume.abs() > BOUND * magnitude { volume } else { 0.0 }
}

/// Whether one number is positive and the other negative.
#[inline]
fn differ(x: f64, y: f64) -> bool {
    (x > 0.0 && y < 0.0) || (x < 0.0 && y > 0.0)
}

/// Whether the line through `p` and `q` passes through the inside of the triangle.
fn pierces(p: DVec3, q: DVec3, [a, b, c]: [DVec3; 3]) -> bool {
    let sides = [[a, b], [b, c], [c, a]].map(|[from, to]| volume([p, q, from], to));
    sides.iter().all(|side| *side > 0.0) || sides.iter().all(|side| *side < 0.0)
}

/// Whether two faces cross, each given by its vertex indices and positions. Of faces that share a vertex only the
/// edges that face it can pass through the other. Faces that share an edge never cross.
pub(crate) fn cross(
    (f, f_points): (&[u32; 3], &[DVec3; 3]),
    (g, g_points): (&[u32; 3], &[DVec3; 3]),
) -> bool {
    let mut shared = 0;
    let mut corners = [0; 2];
    for j in 0..3 {
        for k in 0..3 {
            if f[j] == g[k] {
                (shared, corners) = (shared + 1, [j, k]);
            }
        }
    }
    if shared > 1 {
        return false;
    }
    let beyond = g_points.map(|point| volume(*f_points, point));
    if ![[0, 1], [1, 2], [2, 0]].iter().any(|[j, k]| differ(beyond[*j], beyond[*k])) {
        return false;
    }
    let before = f_points.map(|point| volume(*g_points, point));
    let some = |side: &[f64; 3], own: &[DVec3; 3], other: &[DVec3; 3], corner: usize| {
        (0..3).filter(|k| shared == 0 || *k == corner).any(|facing| {
            let [j, k] = [1, 2].map(|step| (facing + step) % 3);
            differ(side[j], side[k]) && pierces(own[j], own[k], *other)
        })
    };
    some(&beyond, g_points, f_points, corners[1]) || some(&before, f_points, g_points, corners[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    const FLAT: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    fn upright(x: f64, y: f64, low: f64) -> [DVec3; 3] {
        [DVec3::new(x, y, low), DVec3::new(x, y, 1.0), DVec3::new(x + 3.0, y + 3.0, 1.0)]
    }

    #[test]
    fn an_edge_through_the_inside_crosses_and_one_that_touches_does_not() {
        let crosses = |g: [DVec3; 3]| {
            let found = cross((&[0, 1, 2], &FLAT), (&[3, 4, 5], &g));
            assert_eq!(found, cross((&[3, 4, 5], &g), (&[0, 1, 2], &FLAT)));
            found
        };
        assert!(crosses(upright(0.25, 0.25, -1.0)));
        assert!(crosses(upright(0.25, 0.25, -1e-9)));
        assert!(!crosses(upright(0.25, 0.25, 0.0)));
        assert!(!crosses(upright(0.25, 0.25, 0.1)));
        assert!(!crosses(upright(0.7, 0.7, -1.0)));
        // Through the edge of the other: in doubt, so no.
        assert!(!crosses(upright(0.5, 0.5, -1.0)));
        assert!(!crosses(FLAT.map(|p| 0.5 * p)));
    }

    #[test]
    fn faces_with_one_vertex_in_common_cross_by_the_edge_that_faces_it() {
        let away = [DVec3::ZERO, DVec3::new(0.5, 0.2, 1.0), DVec3::new(0.5, 0.2, -1.0)];
        assert!(cross((&[0, 1, 2], &FLAT), (&[0, 4, 5], &away)));
        let beside = away.map(|p| DVec3::new(p.x, -p.y, p.z));
        assert!(!cross((&[0, 1, 2], &FLAT), (&[0, 4, 5], &beside)));
        let above = [DVec3::ZERO, DVec3::new(0.5, 0.2, 1.0), DVec3::new(0.5, 0.2, 0.5)];
        assert!(!cross((&[0, 1, 2], &FLAT), (&[0, 4, 5], &above)));
        assert!(!cross((&[0, 1, 2], &FLAT), (&[0, 1, 5], &away)));
    }
}
