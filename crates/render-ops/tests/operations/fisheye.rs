use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::camera::{fisheye_angle, fisheye_limit, fisheye_radius};
use bokashi_render_ops::fisheye;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// Radii are angles; a lens that goes on to 150 degrees; one that turns round at about 79 degrees.
const LENSES: [[f64; 4]; 3] =
    [[0.0; 4], [0.05, -0.01, 0.003, -0.0001], [-0.15, -0.01, 0.003, -0.002]];

fn shown(lens: [f64; 4], points: &[[f64; 3]]) -> Vec<DVec3> {
    let tape = Tape::new();
    let points = tape.constant(&Tensor::from(points.to_vec()));
    let found = fisheye(points, tape.constant(&Tensor::from(lens))).unwrap().value();
    found.data().chunks(3).map(DVec3::from_slice).collect()
}

/// A point at an angle off the axis, in some direction around it.
fn point_at_angle(angle: f64, around: f64, distance: f64) -> [f64; 3] {
    let (sin, cos) = angle.sin_cos();
    [sin * around.cos(), sin * around.sin(), cos].map(|x| distance * x)
}

#[test]
fn points_are_shown_as_opencv_says() {
    // cv2.fisheye.projectPoints, OpenCV 5.0.0: the identity for the camera matrix, rotation and translation 0.
    let points = [
        [0.3, -0.4, 2.0],
        [1.1, 0.9, 1.6],
        [0.0, 0.0, 3.0],
        [-2.0, 1.0, 0.5],
        [1e-5, 2e-5, 1.0],
        [3.0, 0.2, 0.3],
    ];
    let expected = [
        (
            [0.05, -0.01, 0.003, -0.0005],
            [
                [0.14742306662760718, -0.1965640888368096],
                [0.5756203618820451, 0.4709621142671278],
                [0.0, 0.0],
                [-1.2935257636173862, 0.6467628818086931],
                [9.999999998583335e-06, 1.999999999716667e-05],
                [1.5867570966048512, 0.10578380644032342],
            ],
        ),
        (
            [-0.03, 0.002, -0.0004, 0.00002],
            [
                [0.14672360293057657, -0.1956314705741021],
                [0.5535165345124037, 0.45287716460105754],
                [0.0, 0.0],
                [-1.1474394245289576, 0.5737197122644788],
                [9.999999998183335e-06, 1.999999999636667e-05],
                [1.381189573158581, 0.09207930487723874],
            ],
        ),
    ];
    for (lens, expected) in expected {
        for ((found, [x, y]), point) in shown(lens, &points).into_iter().zip(expected).zip(points) {
            let distance = DVec3::from(point).length();
            let expected = distance * DVec3::new(x, y, 1.0);
            assert!(found.abs_diff_eq(expected, 1e-14 * distance), "{found} {expected}");
        }
    }
}

#[test]
fn a_fisheye_sees_behind_itself() {
    for angle in [1.0, FRAC_PI_2, 2.0, 2.6] {
        let found = shown([0.0; 4], &[point_at_angle(angle, 0.7, 3.0)])[0];
        let expected = 3.0 * DVec3::new(angle * 0.7_f64.cos(), angle * 0.7_f64.sin(), 1.0);
        assert!(found.abs_diff_eq(expected, 1e-14), "{found} and not {expected}");
    }
}

#[test]
fn the_limit_is_where_radii_turn_round_and_150_degrees_at_most() {
    assert_eq!(fisheye_limit([0.0; 4]), PI * 5.0 / 6.0);
    // 1 - 3 s / 12, and 1 - 9 s^4 / (9 * 256).
    for lens in [[-1.0 / 12.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, -1.0 / 2304.0]] {
        assert!((fisheye_limit(lens) - 2.0).abs() < 1e-14);
    }
    let lens = LENSES[2];
    let limit = fisheye_limit(lens);
    assert!((1.3..1.4).contains(&limit), "{limit}");
    assert!(fisheye_radius(limit, lens) > fisheye_radius(limit + 1e-3, lens));
    for angle in [0.0, 0.3, 1.2] {
        let found = fisheye_angle(fisheye_radius(angle, lens), lens).unwrap();
        assert!((found - angle).abs() < 1e-12, "{found} and not {angle}");
    }
    assert_eq!(fisheye_angle(1.01 * fisheye_radius(limit, lens), lens), None);
    assert_eq!(fisheye_angle(f64::NAN, lens), None);
}

#[test]
fn what_lies_farther_out_is_shown_farther_out_and_beyond_the_image_ends_behind() {
    for lens in LENSES {
        let limit = fisheye_limit(lens);
        // The angle that a pinhole would see.
        let angles: Vec<_> = (1..=1000)
            .map(|k| shown(lens, &[point_at_angle(PI * k as f64 / 1000.0, 0.4, 2.0)])[0])
            .map(|found| found.truncate().length().atan2(found.z))
            .collect();
        assert!(angles.windows(2).all(|pair| pair[0] < pair[1]), "{lens:?}");
        assert!((angles[999] - PI).abs() < 1e-12);
        // No leap at the limit; and around the axis behind the camera all directions meet.
        let beside =
            [1.0 - 1e-12, 1.0 + 1e-12].map(|share| point_at_angle(share * limit, 0.4, 2.0));
        let [inside, outside] = [0, 1].map(|k| shown(lens, &beside)[k]);
        assert!(inside.abs_diff_eq(outside, 1e-9), "{inside} {outside}");
        let meet =
            shown(lens, &[0.0, 2.0, 4.0].map(|around| point_at_angle(PI - 1e-10, around, 1.0)));
        let axis = shown(lens, &[[0.0, 0.0, -1.0]])[0];
        assert!(axis.truncate().length() == 0.0 && axis.z < 0.0, "{axis}");
        assert!(meet.iter().all(|found| found.abs_diff_eq(axis, 1e-8)), "{meet:?}");
    }
}

#[test]
fn points_of_any_size_have_a_result() {
    for lens in LENSES {
        assert_eq!(shown(lens, &[[0.0; 3]]), [DVec3::ZERO]);
        for point in [[0.3, 0.2, 1.0], [3.0, 2.0, -1.0], [0.0, 0.0, -1.0]] {
            let expected = shown(lens, &[point])[0];
            for scale in [1e-250, 1e-90, 1e90, 1e250] {
                let found = shown(lens, &[point.map(|x| scale * x)])[0] / scale;
                assert!(found.abs_diff_eq(expected, 1e-14 * expected.length()), "{found}");
            }
        }
    }
}
