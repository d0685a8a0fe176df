//! Cameras and rotations.

use std::f64::consts::FRAC_1_SQRT_2;

use proptest::prelude::*;
use proptest::sample::select;

/// Matrices from world to clip space, as columns: `clip = sum_k column_k p_k`. They are perspective
/// cameras (OpenGL's depth range) that look at the origin from all around, at 0.2 to 6 units. Some
/// stand within what they see, or have a near plane through it. Some have a narrow or a wide view.
pub fn camera() -> BoxedStrategy<[[f64; 4]; 4]> {
    let distance = prop_oneof![4 => 1.5..6.0_f64, 1 => 0.2..0.8];
    let direction = [-1.0..1.0, -1.0..1.0, -1.0..1.0];
    let half_width = prop_oneof![4 => 0.3..0.8, 1 => select(&[0.02, 3.0][..])];
    let near = prop_oneof![3 => 0.05..0.2, 1 => 0.8..1.2];
    (distance, direction, half_width, near, 0.5..2.0)
        .prop_map(|(distance, direction, half_width, near, aspect)| {
            let back = unit(direction).unwrap_or([0.0, 0.0, 1.0]);
            // Up is y, or x for who looks along y.
            let up = if back[1].abs() < 0.99 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
            let right = unit(cross(up, back)).expect("up is not along the view");
            let up = cross(back, right);
            let far = near + 12.0;
            let (x, y) = (1.0 / (half_width * aspect), 1.0 / half_width);
            let depth = (near + far) / (near - far);
            let shift = 2.0 * near * far / (near - far);
            // In view space: x' = <right, p>, y' = <up, p>, z' = <back, p> - distance.
            let column = |k: usize, offset: f64| {
                let z = back[k] + offset;
                [x * right[k], y * up[k], depth * z, -z]
            };
            let z = -distance;
            [column(0, 0.0), column(1, 0.0), column(2, 0.0), [0.0, 0.0, depth * z + shift, -z]]
        })
        .boxed()
}

/// Unit quaternions `(x, y, z, w)`: of all directions; half turns; angles of 1e-8; quarter turns
/// about an axis; of either sign.
pub fn unit_quaternion() -> BoxedStrategy<[f64; 4]> {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let entry = || -1.0..1.0;
    let all = [entry(), entry(), entry(), entry()].prop_filter_map("a direction", |q| {
        let length = q.iter().map(|entry| entry * entry).sum::<f64>().sqrt();
        (length > 0.1).then(|| q.map(|entry| entry / length))
    });
    let axis = || [entry(), entry(), entry()].prop_filter_map("an axis", unit);
    let special = prop_oneof![
        axis().prop_map(|[x, y, z]| [x, y, z, 0.0]),
        axis().prop_map(|axis| {
            let [x, y, z] = axis.map(|entry| 5e-9 * entry);
            [x, y, z, 1.0]
        }),
        select(axes.to_vec()).prop_map(|axis| {
            let [x, y, z] = axis.map(|entry: f64| FRAC_1_SQRT_2 * entry);
            [x, y, z, FRAC_1_SQRT_2]
        }),
    ];
    (prop_oneof![all, special], any::<bool>())
        .prop_map(|(q, negative)| if negative { q.map(|entry: f64| -entry) } else { q })
        .boxed()
}

fn cross([ax, ay, az]: [f64; 3], [bx, by, bz]: [f64; 3]) -> [f64; 3] {
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

/// `v` at length 1, unless it is close to 0.
fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = v.iter().map(|entry| entry * entry).sum::<f64>().sqrt();
    (length > 0.1).then(|| v.map(|entry| entry / length))
}

#[cfg(test)]
mod tests {
    use super::super::draws;
    use super::*;

    fn clip(camera: &[[f64; 4]; 4], [x, y, z]: [f64; 3]) -> [f64; 4] {
        let [a, b, c, d] = camera;
        std::array::from_fn(|k| a[k] * x + b[k] * y + c[k] * z + d[k])
    }

    #[test]
    fn cameras_look_at_the_origin() {
        for camera in draws(camera(), 200) {
            let [x, y, z, w] = clip(&camera, [0.0; 3]);
            assert!(x.abs() < 1e-12 && y.abs() < 1e-12 && w > 0.1);
            // Farther along the view: deeper, by less than all of the range.
            let [.., z_far, w_far] = clip(&camera, [-0.1, 0.2, 0.1]);
            assert!(w_far > 0.0 || w < 0.5);
            assert!(z <= w && (w_far <= 0.0 || z_far <= w_far));
        }
    }

    #[test]
    fn what_lies_on_the_near_plane_has_depth_minus_one() {
        // Along the view, z' = -near gives z / w = -1: w is linear in the place on the axis, so the
        // place of w = near is found from two others.
        for camera in draws(camera(), 50) {
            // Back direction: minus the w row.
            let back = [-camera[0][3], -camera[1][3], -camera[2][3]];
            let at = |t: f64| clip(&camera, back.map(|entry| entry * t));
            let [.., z0, w0] = at(0.0);
            let [.., z1, w1] = at(1.0);
            assert!((w0 - w1 - 1.0).abs() < 1e-12, "one unit towards the eye");
            // z + w = 0 at this t.
            let t = (z0 + w0) / ((z0 + w0) - (z1 + w1));
            let near = at(t)[3];
            assert!((0.04..1.3).contains(&near), "{near}");
        }
    }

    #[test]
    fn some_cameras_stand_within_what_they_see() {
        let distances: Vec<f64> = draws(camera(), 200).iter().map(|c| c[3][3]).collect();
        assert!(distances.iter().any(|d| *d < 0.5) && distances.iter().any(|d| *d > 4.0));
    }

    #[test]
    fn quaternions_are_of_length_one_and_hit_the_special_ones() {
        let all = draws(unit_quaternion(), 300);
        for q in &all {
            let length = q.iter().map(|entry| entry * entry).sum::<f64>();
            assert!((length - 1.0).abs() < 1e-14);
        }
        let some = |kind: fn(&[f64; 4]) -> bool| all.iter().filter(|q| kind(q)).count() > 5;
        assert!(some(|q| q[3] == 0.0) && some(|q| q[3] < 0.0));
        assert!(some(|q| q[3].abs() == 1.0 && q[0] != 0.0));
        assert!(some(|q| q[3].abs() == FRAC_1_SQRT_2));
    }
}
