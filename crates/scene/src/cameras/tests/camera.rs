use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::camera::{distort, fisheye, look_at, to_tensor};
use bokashi_render_ops::{Border, Filter, Size, downsample, pinhole, project, transform_points};
use glam::{DMat4, DQuat, DVec2, DVec3};

use super::super::{Camera, Distortion};
use super::assert_seen;

const SIZE: Size = Size { width: 100, height: 80 };
const INTRINSICS: [f64; 4] = [100.0, 100.0, 49.5, 39.5];

#[test]
fn a_camera_of_opengl_looks_along_minus_z_with_y_up() {
    let pose = DMat4::from_translation(DVec3::new(0.0, 0.0, 4.0));
    let camera = Camera::new(SIZE, INTRINSICS).with_opengl_pose(pose);
    assert_seen(&camera, [0.0, 0.0, 0.0], [49.5, 39.5]);
    assert_seen(&camera, [1.0, 0.0, 0.0], [74.5, 39.5]);
    assert_seen(&camera, [0.0, 1.0, 0.0], [49.5, 14.5]);
    assert_seen(&camera, [1.0, 1.0, 2.0], [99.5, -10.5]);
    assert_eq!(camera.pixel(DVec3::new(0.0, 0.0, 4.0)), None);
    assert_eq!(camera.pixel(DVec3::new(0.0, 0.0, 5.0)), None);
    assert_eq!(camera.opengl_pose(), pose);
}

#[test]
fn a_camera_of_opencv_looks_along_z_with_y_down() {
    let pose = DMat4::from_translation(DVec3::new(0.0, 0.0, -4.0));
    let camera = Camera::new(SIZE, INTRINSICS).with_opencv_pose(pose);
    assert_seen(&camera, [1.0, 0.0, 0.0], [74.5, 39.5]);
    assert_seen(&camera, [0.0, 1.0, 0.0], [49.5, 64.5]);
    assert_eq!(camera.opencv_pose(), pose);
    let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let camera = Camera::new(SIZE, INTRINSICS)
        .with_rotation_and_translation(quarter, DVec3::new(0.0, 0.0, 4.0));
    // The world's x is the camera's y.
    assert_seen(&camera, [1.0, 0.0, 0.0], [49.5, 64.5]);
}

#[test]
fn a_lens_follows_brown_with_the_coefficients_in_opencvs_order() {
    let camera = |lens_camera| {
        let distortion = Distortion::Polynomial(lens_camera);
        Camera { distortion, ..Camera::new(SIZE, INTRINSICS) }
    };
    // x = 1/2 and y = 1/4, r^2 = 5/16.
    let point = [1.0, 0.5, 2.0];
    let s = 0.3125;
    let pixel = |x: f64, y: f64| [49.5 + 100.0 * x, 39.5 + 100.0 * y];
    assert_seen(&camera([0.0; 5]), point, pixel(0.5, 0.25));
    assert_seen(&camera([0.4, 0.0, 0.0, 0.0, 0.0]), point, pixel(0.5625, 0.281_25));
    let f = 1.0 + 0.5 * s * s;
    assert_seen(&camera([0.0, 0.5, 0.0, 0.0, 0.0]), point, pixel(0.5 * f, 0.25 * f));
    let f = 1.0 + 0.5 * s * s * s;
    assert_seen(&camera([0.0, 0.0, 0.0, 0.0, 0.5]), point, pixel(0.5 * f, 0.25 * f));
    // 2 x y = 1/4, r^2 + 2 y^2 = 7/16, r^2 + 2 x^2 = 13/16.
    assert_seen(&camera([0.0, 0.0, 0.1, 0.0, 0.0]), point, pixel(0.525, 0.293_75));
    assert_seen(&camera([0.0, 0.0, 0.0, 0.2, 0.0]), point, pixel(0.6625, 0.3));
}

#[test]
fn the_engine_shows_a_point_where_the_camera_sees_it() {
    let size = Size { width: 64, height: 48 };
    let view = look_at(DVec3::new(1.0, 2.0, 5.0), DVec3::new(0.1, -0.2, 0.3), DVec3::Y);
    let lenses = [
        Distortion::Polynomial([0.1, -0.05, 0.01, -0.02, 0.03]),
        Distortion::Rational([0.1, -0.05, 0.01, -0.02, 0.03, 0.2, 0.1, -0.02]),
        Distortion::Fisheye([0.1, -0.05, 0.03, 0.01]),
    ];
    for distortion in lenses {
        let camera = Camera { distortion, ..Camera::new(size, [70.0, 75.0, 30.0, 25.0]) };
        assert_shown_alike(camera.with_opengl_pose(view.inverse()));
    }
}

fn assert_shown_alike(camera: Camera) {
    let size = camera.size;
    let points = [[0.0, 0.0, 0.0], [0.4, 0.3, -0.2], [-0.7, 0.6, 0.5], [0.2, -0.9, 0.1]];

    let tape = Tape::<f64>::new();
    let positions = tape.constant(&Tensor::from_fn([4, 3], |[i, j]| points[i][j]));
    let view = tape.constant(&to_tensor(&camera.view));
    let seen = transform_points(positions, view).unwrap();
    let coefficients = tape.constant(&Tensor::from(camera.distortion.coefficients()));
    let shown = match camera.distortion {
        Distortion::Fisheye(_) => fisheye(seen, coefficients).unwrap(),
        _ => distort(seen, coefficients).unwrap(),
    };
    let intrinsics = tape.constant(&Tensor::from(camera.intrinsics));
    let projection = pinhole(intrinsics, size, 0.1, 100.0).unwrap();
    let clip = project(shown, projection, None).unwrap().value();
    for (k, point) in points.into_iter().enumerate() {
        let [x, y, w] = [0, 1, 3].map(|column| clip[[k, column]]);
        // Pixels of this project: y of clip space is up, row 0 is on top.
        let pixel = DVec2::new((1.0 + x / w) * 32.0, (1.0 - y / w) * 24.0);
        assert_seen(&camera, point, [pixel.x - 0.5, pixel.y - 0.5]);
    }
}

#[test]
fn a_smaller_image_shows_a_point_in_the_same_place() {
    let camera = Camera::new(SIZE, [100.0, 110.0, 47.3, 41.7]);
    let distortion = Distortion::Polynomial([0.1, 0.0, 0.0, 0.0, 0.0]);
    let camera = Camera { distortion, ..camera };
    let smaller = camera.scaled(4);
    assert_eq!(smaller.size, Size { width: 25, height: 20 });
    let point = DVec3::new(0.3, -0.2, 1.7);
    let [large, small] = [camera, smaller].map(|camera| camera.pixel(point).unwrap());
    assert!(((large + 0.5) / 4.0 - 0.5).abs_diff_eq(small, 1e-12));
    assert_eq!(camera.scaled(1), camera);
    // What is left over is cut off.
    assert_eq!(camera.scaled(3).size, Size { width: 33, height: 26 });
    assert_eq!(camera.scaled(3).intrinsics[2], (47.3 + 0.5) / 3.0 - 0.5);
    assert_eq!(camera.scaled(200).size, Size { width: 1, height: 1 });
}

#[test]
fn whole_cameras_show_points_where_opencv_does() {
    // cv2.fisheye.projectPoints and cv2.projectPoints, OpenCV 5.0.0, with the rotation vector (0.1, -0.2, 0.3).
    let size = Size { width: 320, height: 240 };
    let (axis, shift) = (DVec3::new(0.1, -0.2, 0.3), DVec3::new(0.05, -0.1, 2.0));
    let points = [[0.4, 0.3, -0.2], [-0.7, 0.6, 0.5], [1.9, -0.9, -0.9]];
    for (distortion, expected) in [
        (
            Distortion::Fisheye([0.05, -0.01, 0.003, -0.0005]),
            [
                [221.2038165798464, 169.69865126066497],
                [52.45687377069818, 144.58722113814912],
                [483.22322176564836, 76.63761002690663],
            ],
        ),
        (
            Distortion::Rational([0.5, 0.2, -0.01, 0.02, 0.01, 0.8, 0.35, 0.02]),
            [
                [221.79758345710178, 169.65459197833601],
                [55.58761766331996, 143.62576919322782],
                [529.8444717651007, 65.03840000617163],
            ],
        ),
    ] {
        let camera = Camera { distortion, ..Camera::new(size, [310.0, 305.0, 162.3, 118.9]) };
        let camera = camera.with_rotation_and_translation(DQuat::from_scaled_axis(axis), shift);
        for (point, expected) in points.into_iter().zip(expected) {
            assert_seen(&camera, point, expected);
        }
    }
}

#[test]
fn what_the_formula_of_a_lens_does_not_reach_is_not_seen() {
    let camera = |distortion| Camera { distortion, ..Camera::new(SIZE, INTRINSICS) };
    // The polynomial turns round at r = 1, at 2/3.
    let lens_camera = camera(Distortion::Polynomial([-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0]));
    assert_seen(&lens_camera, [0.5, 0.0, 1.0], [49.5 + 100.0 * 0.5 * (1.0 - 0.25 / 3.0), 39.5]);
    assert_eq!(lens_camera.pixel(DVec3::new(1.1, 0.0, 1.0)), None);
    // A fisheye sees behind itself, up to 150 degrees.
    let lens_camera = camera(Distortion::Fisheye([0.0; 4]));
    let at = |angle: f64| [2.0 * angle.sin(), 0.0, 2.0 * angle.cos()];
    assert_seen(&lens_camera, at(2.5), [49.5 + 250.0, 39.5]);
    assert_eq!(lens_camera.pixel(DVec3::from(at(2.7))), None);
    assert_eq!(lens_camera.angle_at(0, -50.0), Some(-0.5));
    assert_eq!(camera(Distortion::NONE).angle_at(1, 100.0), Some(std::f64::consts::FRAC_PI_4));
}

#[test]
fn a_resized_image_shows_a_point_in_the_same_place() {
    let camera = Camera::new(SIZE, [100.0, 110.0, 47.3, 41.7]);
    let other = camera.resized(Size { width: 51, height: 20 });
    let point = DVec3::new(0.3, -0.2, 1.7);
    let [lens_camera, found] = [camera, other].map(|camera| camera.pixel(point).unwrap());
    assert!(((lens_camera + 0.5) * DVec2::new(0.51, 0.25) - 0.5).abs_diff_eq(found, 1e-12));
}

#[test]
fn a_ramp_that_is_reduced_is_the_ramp_of_the_smaller_camera() {
    // Each pixel has its x in the camera's plane z = 1 as its value.
    let camera = Camera::new(Size { width: 8, height: 4 }, [10.0, 10.0, 2.7, 1.0]);
    let ramp = |camera: &Camera| {
        let [fx, _, cx, _] = camera.intrinsics;
        let extents = [camera.size.height, camera.size.width, 1];
        Tensor::from_fn(extents, move |[_, column, _]| (column as f64 - cx) / fx)
    };
    let tape = Tape::<f64>::new();
    let image = tape.constant(&ramp(&camera));
    let found = downsample(image, 2, &Filter::Box, Border::default()).unwrap().value();
    let expected = ramp(&camera.scaled(2));
    assert_eq!(found.shape(), expected.shape());
    for (found, expected) in found.data().iter().zip(expected.data()) {
        assert!((found - expected).abs() < 1e-12, "{found} instead of {expected}");
    }
}
