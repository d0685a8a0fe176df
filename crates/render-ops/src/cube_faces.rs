//! The faces of a cube map: +x, -x, +y, -y, +z, -z in this order, laid out as in OpenGL.
//!
//! # Solid angles
//! A rectangle from a corner of the middle to `(s, t)` on a face at distance 1 is seen from the middle under
//! the solid angle `atan2(s t, sqrt(s^2 + t^2 + 1))`; a texel is four of them, with signs.
//!
//! # Source
//! OpenGL 4.6, section 8.13, for the faces and their axes.

/// Per face the axes along which s and t grow: an axis and its sign.
pub(crate) const AXES: [[(usize, f64); 2]; 6] = [
    [(2, -1.0), (1, -1.0)],
    [(2, 1.0), (1, -1.0)],
    [(0, 1.0), (2, 1.0)],
    [(0, 1.0), (2, -1.0)],
    [(0, 1.0), (1, -1.0)],
    [(0, -1.0), (1, -1.0)],
];

/// The direction to the place (s, t) of a face, whose sides are at -1 and 1. Its component along the
/// face's normal is 1.
pub(crate) fn direction(face: usize, [s, t]: [f64; 2]) -> [f64; 3] {
    let mut direction = [0.0; 3];
    direction[face / 2] = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
    let [(s_axis, s_sign), (t_axis, t_sign)] = AXES[face];
    direction[s_axis] = s_sign * s;
    direction[t_axis] = t_sign * t;
    direction
}

/// s or t of a line, in texels from the border of a face with so many of them along a side.
pub(crate) fn ratio(position: f64, extent: usize) -> f64 {
    2.0 * position / extent as f64 - 1.0
}

/// The direction to the middle of a texel.
pub(crate) fn towards_texel(face: usize, [row, column]: [isize; 2], extent: usize) -> [f64; 3] {
    direction(face, [column, row].map(|position| ratio(position as f64 + 0.5, extent)))
}

/// The solid angle of a rectangle on a face, between these s and t.
pub(crate) fn solid_angle([s0, s1]: [f64; 2], [t0, t1]: [f64; 2]) -> f64 {
    let corner = |s: f64, t: f64| (s * t).atan2((s * s + t * t + 1.0).sqrt());
    corner(s1, t1) - corner(s0, t1) - corner(s1, t0) + corner(s0, t0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solid_angles_of_all_texels_are_the_sphere() {
        for extent in [1, 2, 7, 64] {
            let side = |k: usize| [k, k + 1].map(|k| ratio(k as f64, extent));
            let texels = (0..extent * extent).map(|k| (side(k % extent), side(k / extent)));
            let face: f64 = texels.map(|(s, t)| solid_angle(s, t)).sum();
            approx::assert_relative_eq!(6.0 * face, 4.0 * std::f64::consts::PI, epsilon = 1e-12);
        }
    }

    #[test]
    fn corners_are_where_the_table_of_opengl_has_them() {
        // By hand: upper left, upper right, lower left.
        let corners = [
            [[1.0, 1.0, 1.0], [1.0, 1.0, -1.0], [1.0, -1.0, 1.0]],
            [[-1.0, 1.0, -1.0], [-1.0, 1.0, 1.0], [-1.0, -1.0, -1.0]],
            [[-1.0, 1.0, -1.0], [1.0, 1.0, -1.0], [-1.0, 1.0, 1.0]],
            [[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, -1.0, -1.0]],
            [[-1.0, 1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, -1.0, 1.0]],
            [[1.0, 1.0, -1.0], [-1.0, 1.0, -1.0], [1.0, -1.0, -1.0]],
        ];
        for (face, expected) in corners.into_iter().enumerate() {
            let found = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]].map(|at| direction(face, at));
            assert_eq!(found, expected, "face {face}");
        }
    }

    #[test]
    fn places_on_shared_edges_have_the_same_direction() {
        // The right edge of +z is the left edge of +x.
        for t in [-1.0, -0.3, 1.0] {
            assert_eq!(direction(4, [1.0, t]), direction(0, [-1.0, t]));
        }
        let all = (0..6).map(|face| direction(face, [0.0; 2]));
        assert_eq!(all.map(|d| d.iter().sum::<f64>()).sum::<f64>(), 0.0);
    }
}
