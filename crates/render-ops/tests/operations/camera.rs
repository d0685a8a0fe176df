//! Laws of cameras: where points whose pixels are known are seen, and what matrices are.

use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::camera::{
    distortion_radius, from_tensor, look_at, opencv_to_opengl_pose, opencv_to_opengl_view,
    opengl_to_opencv_pose, opengl_to_opencv_view, perspective, to_tensor, undistorted,
};
use bokashi_render_ops::{
    Mesh, Size, affine_inverse, distort, orthographic, pinhole, project, rasterize, rigid, se3,
    transform_points,
};
use glam::{DMat4, DQuat, DVec2, DVec3};

const SIZE: Size = Size { width: 8, height: 6 };

/// The matrix of a variable.
fn matrix(variable: Var<'_, f64>) -> DMat4 {
    from_tensor(&variable.value()).unwrap()
}

fn vector<'t>(tape: &'t Tape<f64>, entries: &[f64]) -> Var<'t, f64> {
    tape.leaf(&Tensor::from(entries))
}

/// Where `camera` shows a point, in pixels of this project, and its z / w.
fn seen(camera: DMat4, point: DVec3) -> DVec3 {
    let ndc = camera.project_point3(point);
    let [width, height] = [SIZE.width, SIZE.height].map(|extent| extent as f64);
    DVec3::new(0.5 * (ndc.x + 1.0) * width, 0.5 * (1.0 - ndc.y) * height, ndc.z)
}

fn assert_near(found: DMat4, expected: DMat4, tolerance: f64) {
    assert!(found.abs_diff_eq(expected, tolerance), "{found} instead of {expected}");
}

/// A view of OpenGL's convention.
fn view() -> DMat4 {
    look_at(DVec3::new(1.0, 2.0, 5.0), DVec3::new(0.2, -0.1, 0.3), DVec3::Y)
}

#[test]
fn a_pinhole_shows_points_at_the_pixels_that_opencv_says() {
    let tape = Tape::new();
    let camera = pinhole(vector(&tape, &[5.0, 7.0, 2.25, 1.5]), SIZE, 0.5, 20.0).unwrap();
    let camera = matrix(camera);
    // u = fx X / Z + cx, v = fy Y / Z + cy, with the centre of the first pixel at (0, 0).
    for (point, pixel) in [
        ([0.0, 0.0, 1.0], [2.25, 1.5]),
        ([1.0, 0.0, 2.0], [4.75, 1.5]),
        ([0.0, 1.0, 2.0], [2.25, 5.0]),
        ([-0.9, -0.5, 2.0], [0.0, -0.25]),
    ] {
        let found = seen(camera, DVec3::from(point));
        assert!((found.x - 0.5 - pixel[0]).abs() < 1e-14, "{point:?} at {found}");
        assert!((found.y - 0.5 - pixel[1]).abs() < 1e-14, "{point:?} at {found}");
    }
    for (z, depth) in [(0.5, -1.0), (20.0, 1.0)] {
        assert!((seen(camera, DVec3::new(0.3, 0.2, z)).z - depth).abs() < 1e-14);
    }
    let endless = matrix(pinhole(vector(&tape, &[5.0; 4]), SIZE, 0.5, f64::INFINITY).unwrap());
    assert_eq!(seen(endless, DVec3::new(0.0, 0.0, 0.5)).z, -1.0);
    assert!((seen(endless, DVec3::new(0.0, 0.0, 1e12)).z - 1.0).abs() < 1e-11);
}

#[test]
fn a_face_around_a_point_covers_the_pixel_that_the_point_is_seen_in() {
    let tape = Tape::new();
    let intrinsics = vector(&tape, &[5.0, 5.0, 3.0, 2.0]);
    for camera in [pinhole, orthographic].map(|of| of(intrinsics, SIZE, 0.5, 20.0).unwrap()) {
        for (column, row) in [(0, 0), (7, 0), (0, 5), (6, 4)] {
            // 0.2 units are a pixel, at Z = 1.
            let [x, y] = [(column as f64 - 3.0) / 5.0, (row as f64 - 2.0) / 5.0];
            let around = [[-0.08, -0.08], [0.08, -0.08], [0.0, 0.09]];
            let corners = around.into_iter().flat_map(|[dx, dy]| [x + dx, y + dy, 1.0]);
            let positions = tape.leaf(&Tensor::new([3, 3], corners.collect()).unwrap());
            let clip = project(positions, camera, None).unwrap();
            let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
            let coverage = rasterize(clip, &mesh, SIZE).unwrap().coverage;
            let pixels: Vec<_> = coverage.pixels().collect();
            assert_eq!(pixels, [row * SIZE.width + column]);
        }
    }
}

#[test]
fn a_pinhole_in_the_middle_is_the_perspective_of_its_angle() {
    let tape = Tape::new();
    let angle = 0.7_f64;
    let focal = 0.5 * SIZE.height as f64 / (0.5 * angle).tan();
    let intrinsics = vector(&tape, &[focal, focal, 3.5, 2.5]);
    let camera = matrix(pinhole(intrinsics, SIZE, 0.1, 50.0).unwrap());
    let aspect = SIZE.width as f64 / SIZE.height as f64;
    let expected = perspective(angle, aspect, 0.1, 50.0) * view();
    assert_near(camera * opengl_to_opencv_view(view()), expected, 1e-13);
}

#[test]
fn an_orthographic_camera_shows_units_as_pixels() {
    let tape = Tape::new();
    let camera = orthographic(vector(&tape, &[2.0, 3.0, 3.25, 1.5]), SIZE, -1.0, 4.0).unwrap();
    for (point, pixel) in [
        ([0.0, 0.0, 1.0], [3.25, 1.5]),
        ([1.0, 1.0, 3.0], [5.25, 4.5]),
        ([-1.0, 0.5, 0.0], [1.25, 3.0]),
    ] {
        let found = seen(matrix(camera), DVec3::from(point));
        assert!((found.x - 0.5 - pixel[0]).abs() < 1e-14, "{point:?} at {found}");
        assert!((found.y - 0.5 - pixel[1]).abs() < 1e-14, "{point:?} at {found}");
        assert!((found.z - (point[2] * 0.4 - 0.6)).abs() < 1e-14);
    }
}

#[test]
fn conventions_turn_y_and_z_round_and_back() {
    let point = DVec3::new(0.4, -0.3, 0.7);
    let gl = view().transform_point3(point);
    let cv = opengl_to_opencv_view(view()).transform_point3(point);
    assert_eq!(cv, DVec3::new(gl.x, -gl.y, -gl.z));
    assert!(cv.z > 0.0, "in front of the camera");
    assert_eq!(opencv_to_opengl_view(opengl_to_opencv_view(view())), view());
    // A camera's pose is the inverse of its view.
    let pose = opengl_to_opencv_pose(view().inverse());
    assert_near(pose, opengl_to_opencv_view(view()).inverse(), 1e-15);
    assert_eq!(opencv_to_opengl_pose(pose), view().inverse());
    assert!(pose.transform_point3(cv).abs_diff_eq(point, 1e-14));
}

#[test]
fn a_tensor_has_a_matrix_by_rows() {
    let tensor = to_tensor::<f32>(&view());
    assert_eq!(tensor[[0, 3]], view().w_axis.x as f32);
    let back = from_tensor(&to_tensor::<f64>(&view())).unwrap();
    assert_eq!(back, view());
    let error = from_tensor(&Tensor::<f64>::zeros([3, 4])).unwrap_err().to_string();
    assert_eq!(error, "a matrix needs a tensor of shape [4, 4], got shape [3, 4]");
}

#[test]
fn a_rigid_matrix_and_its_inverse_are_glams() {
    let tape = Tape::new();
    let q = DQuat::from_xyzw(0.1, 0.7, -0.5, 0.3);
    let shift = DVec3::new(0.4, -0.6, 1.5);
    let found = rigid(vector(&tape, &q.to_array()), vector(&tape, &shift.to_array())).unwrap();
    let expected = DMat4::from_rotation_translation(q.normalize(), shift);
    assert_near(matrix(found), expected, 1e-15);
    let inverse = affine_inverse(found).unwrap();
    assert_near(matrix(inverse), expected.inverse(), 1e-15);
    // Its last row is exact: it can be inverted again, and move points.
    assert_near(matrix(affine_inverse(inverse).unwrap()), expected, 1e-15);
    let points = tape.leaf(&Tensor::from_flat_fn([4, 3], |k| (k as f64).sin()));
    let there = transform_points(points, found).unwrap();
    let back = transform_points(there, inverse).unwrap().value();
    for (found, expected) in back.data().iter().zip(points.value().data()) {
        assert!((found - expected).abs() < 1e-15);
    }
}

#[test]
fn a_matrix_that_is_singular_but_for_rounding_is_refused_at_any_size() {
    let tape = Tape::<f64>::new();
    for scale in [1e-200, 1.0, 1e200] {
        // Tenths are no binary fractions: the determinant comes out as a rounding error.
        let entry = |k: usize| match k {
            15 => 1.0,
            k if k < 12 && k % 4 < 3 => scale * (0.1 * (3 * (k / 4) + k % 4 + 1) as f64),
            _ => 0.0,
        };
        let error = affine_inverse(tape.leaf(&Tensor::from_flat_fn([4, 4], entry))).unwrap_err();
        let rule = "affine_inverse needs a linear part whose determinant is not 0 within rounding";
        let message = error.to_string();
        assert!(message.starts_with(rule) && !message.ends_with("got 0"), "{message}");
    }
}

#[test]
fn an_affine_matrix_of_any_size_has_an_inverse() {
    let tape = Tape::new();
    let linear = view() * DMat4::from_scale(DVec3::new(2.0, -0.5, 30.0));
    for scale in [1e-150, 1.0, 1e150] {
        let scaled = DMat4::from_scale(DVec3::splat(scale)) * linear;
        let inverse = matrix(affine_inverse(tape.leaf(&to_tensor(&scaled))).unwrap());
        assert_near(inverse * scaled, DMat4::IDENTITY, 1e-13);
    }
}

/// The exponential of a matrix by its series, at a 2^-30th, squared again and again.
fn exponential(matrix: DMat4) -> DMat4 {
    let small = matrix * f64::powi(0.5, 30);
    // exp(x) - 1, which squares to (1 + e)^2 - 1 = e (2 + e) without losing digits.
    let mut less_one = small + small * small * 0.5 + small * small * small * (1.0 / 6.0);
    for _ in 0..30 {
        less_one = less_one * 2.0 + less_one * less_one;
    }
    DMat4::IDENTITY + less_one
}

#[test]
fn se3_is_the_exponential_of_the_motion_before_the_fixed_matrix() {
    let tape = Tape::new();
    let axis = DVec3::new(0.6, -0.48, 0.64);
    for angle in [0.0, 1e-200, 1e-9, 1e-3, 0.7, 2.0, 3.1, 6.5] {
        let (rho, phi) = (DVec3::new(0.3, -1.2, 0.5), axis * angle);
        let mut motion = DMat4::from_cols_array(&[
            0.0, phi.z, -phi.y, 0.0, -phi.z, 0.0, phi.x, 0.0, phi.y, -phi.x, 0.0, 0.0, 0.0, 0.0,
            0.0, 0.0,
        ]);
        motion.w_axis = rho.extend(0.0);
        let increment = vector(&tape, &[rho.to_array(), phi.to_array()].concat());
        let found = matrix(se3(increment, &view()).unwrap());
        assert_near(found, exponential(motion) * view(), 1e-13);
        let alone = matrix(se3(increment, &DMat4::IDENTITY).unwrap());
        let turn = DMat4::from_axis_angle(axis, angle);
        assert_near(DMat4 { w_axis: turn.w_axis, ..alone }, turn, 1e-15);
    }
    let nothing = tape.leaf(&Tensor::zeros([6]));
    assert_eq!(matrix(se3(nothing, &view()).unwrap()), view());
}

#[test]
fn a_large_angle_is_still_a_rotation() {
    let tape = Tape::new();
    for angle in [1e3, 1e10, 1e49] {
        let increment = vector(&tape, &[1.0, 2.0, 3.0, angle, 0.0, 0.0]);
        let moved = se3(increment, &DMat4::IDENTITY).unwrap();
        let turn = DMat4::from_axis_angle(DVec3::X, angle);
        let found = matrix(moved);
        assert_near(DMat4 { w_axis: turn.w_axis, ..found }, turn, 1e-15);
        let upstream = Tensor::from_flat_fn([4, 4], |k| (k as f64).cos());
        let gradients = tape.vjp(&[(moved, &upstream)]).unwrap();
        assert!(gradients.get(increment).unwrap().is_finite());
    }
}

/// A wide lens, whose polynomial turns round at about 1.1; a narrow one; and none.
const LENSES: [[f64; 5]; 3] = [
    [-0.35, 0.03, 0.003, -0.002, -0.002],
    [0.02, 1e-4, -0.01, 0.02, 3e-5],
    [0.0, 0.0, 0.0, 0.0, 0.0],
];

fn distorted(lens: [f64; 5], point: DVec3) -> DVec3 {
    let tape = Tape::new();
    let points = tape.leaf(&Tensor::new([1, 3], point.to_array().to_vec()).unwrap());
    let found = distort(points, vector(&tape, &lens)).unwrap().value();
    DVec3::from_slice(found.data())
}

#[test]
fn up_to_the_rim_points_are_distorted_as_opencv_says() {
    for lens in LENSES {
        let [k1, k2, p1, p2, k3] = lens;
        for point in
            [DVec3::new(0.3, -0.4, 2.0), DVec3::new(1.1, 0.9, 1.6), DVec3::new(0.0, 0.0, 3.0)]
        {
            let (x, y) = (point.x / point.z, point.y / point.z);
            let r = x.hypot(y);
            assert!(r < distortion_radius(lens));
            let radial = 1.0 + k1 * r.powi(2) + k2 * r.powi(4) + k3 * r.powi(6);
            let expected = DVec3::new(
                x * radial + 2.0 * p1 * x * y + p2 * (r * r + 2.0 * x * x),
                y * radial + p1 * (r * r + 2.0 * y * y) + 2.0 * p2 * x * y,
                1.0,
            );
            let found = distorted(lens, point);
            assert!(found.abs_diff_eq(point.z * expected, 1e-14), "{found}");
        }
    }
}

#[test]
fn the_rim_is_where_the_polynomial_turns_round() {
    for (lens, expected) in [
        // 1 + 3 k1 s = 0, and with two, and three coefficients.
        ([-1.0 / 12.0, 0.0, 0.5, 0.5, 0.0], 2.0),
        ([0.0, -1.0 / 80.0, 0.0, 0.0, 0.0], 2.0),
        ([0.0, 0.0, 0.0, 0.0, -1.0 / 448.0], 2.0),
        // (1 - s / 4) (1 - s / 9) (1 - s / 16), by its coefficients.
        ([-61.0 / 432.0, 29.0 / 2880.0, 0.0, 0.0, -1.0 / 4032.0], 2.0),
        // (1 - s / 4)^2 (1 - s / 9) touches 0 at 2, and turns round at 3 at the latest.
        ([-11.0 / 54.0, 17.0 / 720.0, 0.0, 0.0, -1.0 / 1008.0], 2.5),
        ([0.1, 0.1, 0.0, 0.0, 0.1], 16.0),
        ([0.0; 5], 16.0),
        ([-1e100, 0.0, 0.0, 0.0, 0.0], (1.0_f64 / 3.0).sqrt() * 1e-50),
    ] {
        let found = distortion_radius(lens);
        let tolerance = if expected == 2.5 { 0.2 } else { 1e-14 };
        assert!((found / expected - 1.0).abs() <= tolerance, "{lens:?}: {found}");
    }
}

#[test]
fn what_lies_farther_out_is_shown_farther_out_up_to_the_plane_of_the_eye_and_behind_it() {
    for lens in LENSES {
        let radial = [lens[0], lens[1], 0.0, 0.0, lens[4]];
        let (mut last, limit) = (0.0, distortion_radius(lens));
        for k in 1..2000 {
            let r = 3.0 * limit * k as f64 / 2000.0;
            let shown = distorted(radial, DVec3::new(r, 0.0, 1.0)).x;
            assert!(shown > last, "{lens:?} at {r}: {shown} after {last}");
            last = shown;
        }
        // No leap at the limit, and none where Z becomes 0, or negative.
        let direction = DVec2::from_angle(0.7);
        let [inside, outside] = [1.0 - 1e-12, 1.0 + 1e-12]
            .map(|share| distorted(lens, (share * limit * direction).extend(1.0)));
        assert!(inside.abs_diff_eq(outside, 1e-9 * inside.length()), "{inside} {outside}");
        let beside =
            [1e-300, 0.0, -1e-300, -2.0].map(|z| distorted(lens, direction.extend(z)).truncate());
        assert!(beside.iter().all(|shown| *shown == beside[0] && shown.is_finite()), "{beside:?}");
        assert!(beside[0].dot(direction) > 0.0);
    }
}

#[test]
fn the_axis_behind_the_camera_and_points_of_any_size_have_a_result() {
    for lens in LENSES {
        for z in [0.0, -1.0, -1e300] {
            assert_eq!(distorted(lens, DVec3::new(0.0, 0.0, z)), DVec3::new(0.0, 0.0, z));
        }
        for scale in [1e-250, 1e250] {
            for point in [DVec3::new(0.3, 0.2, 1.0), DVec3::new(30.0, 20.0, -1.0)] {
                let found = distorted(lens, scale * point) / scale;
                let expected = distorted(lens, point);
                assert!(found.abs_diff_eq(expected, 1e-14 * expected.length()), "{found}");
            }
        }
    }
}

#[test]
fn undistorting_a_distorted_point_gives_the_point_back() {
    for lens in LENSES {
        for k in 0..200 {
            let limit = distortion_radius(lens).min(4.0);
            let radius = limit * 1.5 * ((k * 37 % 200) as f64 / 200.0);
            if (radius / limit - 1.0).abs() < 0.02 {
                // At the limit the slope is 0: half of the digits are lost.
                continue;
            }
            let point = radius * DVec2::from_angle(0.1 * k as f64);
            let shown = distorted(lens, point.extend(1.0)).truncate();
            let found = undistorted(shown, lens).expect("the lens shows it");
            assert!(found.abs_diff_eq(point, 1e-9 * (1.0 + radius)), "{found} {point} {lens:?}");
        }
        assert_eq!(undistorted(DVec2::ZERO, lens), Some(DVec2::ZERO));
        assert_eq!(undistorted(DVec2::new(f64::NAN, 0.0), lens), None);
    }
}

#[test]
fn coefficients_of_zero_are_the_identity_and_are_passed_on() {
    let tape = Tape::<f64>::new();
    let points = tape.leaf(&Tensor::from_flat_fn([9, 3], |k| (k as f64).sin()));
    let frozen = tape.constant(&Tensor::zeros([5]));
    let before = tape.len();
    let same = distort(points, frozen).unwrap();
    assert_eq!((tape.len(), same.value()), (before, points.value()));
    let learnt = distort(points, vector(&tape, &[0.0; 5])).unwrap();
    assert_eq!(learnt.value(), points.value());
    let gradients = learnt.square().sum().backward().unwrap();
    // At 0 the map of the points is the identity.
    let expected = points.value().map(|entry| 2.0 * entry);
    assert_eq!(gradients.get(points), Some(&expected));
}
