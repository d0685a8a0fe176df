use std::fs;
use std::path::PathBuf;

use bokashi_render_ops::Size;
use glam::{DMat4, DQuat, DVec3};

use super::super::{Camera, CameraFile, Distortion, NamedView, read_transforms, transforms_json};
use super::{assert_seen, scene};
use crate::error::SceneError;

/// 4 units before the origin, looking along -z.
const POSE: &str = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";

fn frame(path: &str, rest: &str) -> String {
    format!(r#"{{"file_path": "{path}", "transform_matrix": {POSE}{rest}}}"#)
}

/// The views of a file with an image a.png beside it.
fn read(text: &str) -> Result<Vec<NamedView>, SceneError> {
    file(text).map(|file| file.views)
}

fn file(text: &str) -> Result<CameraFile, SceneError> {
    let (_place, folder) = scene(&[("t.json", text)], &["a.png", "b.jpg"]);
    read_transforms(&folder, "t.json")
}

/// A file with one frame, of which these keys are said.
fn one(common: &str, frame_keys: &str) -> Result<Camera, SceneError> {
    let text = format!(r#"{{{common} "frames": [{}]}}"#, frame("a", frame_keys));
    read(&text).map(|views| views[0].camera)
}

#[track_caller]
fn assert_said(found: Result<Camera, SceneError>, rule: &str) {
    let message = found.unwrap_err().to_string();
    assert!(message.contains(rule) && message.contains("t.json"), "{message}");
}

#[test]
fn a_synthetic_scene_has_angles_and_the_sizes_of_its_images() {
    // Half of the angle has the tangent 1/2: the focal length is the width, 4.
    let angle = 2.0 * 0.5_f64.atan();
    let text = format!(
        r#"{{"camera_angle_x": {angle}, "frames": [
            {{"file_path": "./train/r_0", "rotation": 0.012, "transform_matrix": {POSE}}}]}}"#
    );
    let (_place, folder) = scene(&[("sub/transforms_train.json", &text)], &["sub/train/r_0.png"]);
    let views = read_transforms(&folder, "sub/transforms_train.json").unwrap().views;
    let [NamedView { name, image, mask: None, camera }] = views.as_slice() else {
        panic!("{views:?}")
    };
    assert_eq!((name.as_str(), image), ("train/r_0", &PathBuf::from("sub/train/r_0.png")));
    assert_eq!(camera.size, Size { width: 4, height: 2 });
    // The middle of the image is (2, 1) from its corner.
    assert_seen(camera, [0.0, 0.0, 0.0], [1.5, 0.5]);
    assert_seen(camera, [1.0, 0.0, 0.0], [2.5, 0.5]);
    assert_seen(camera, [0.0, 1.0, 0.0], [1.5, -0.5]);
    // From an absolute path the image is still relative.
    let again = read_transforms(&folder, folder.join("sub/transforms_train.json")).unwrap().views;
    assert_eq!(again, views);
}

#[test]
fn intrinsics_of_nerfstudio_count_from_the_corner() {
    let common = r#""camera_model": "OPENCV", "w": 100, "h": 80.0, "fl_x": 100, "fl_y": 200,
        "cx": 50.5, "cy": 40, "k1": 0.4, "k2": 0, "k4": 0, "p1": 0.1, "p2": 0.2,
        "aabb_scale": 16, "applied_transform": [[1, 0], []],"#;
    let camera = one(common, r#", "colmap_im_id": 3"#).unwrap();
    assert_eq!(camera.intrinsics, [100.0, 200.0, 50.0, 39.5]);
    assert_eq!(camera.distortion, Distortion::Polynomial([0.4, 0.0, 0.1, 0.2, 0.0]));
    assert_eq!(camera.size, Size { width: 100, height: 80 });
    // x = 1/2, y = 1/4 down: worked out by hand.
    assert_seen(&camera, [1.0, -0.5, 2.0], [125.0, 114.5]);
    // What a frame says goes before.
    let camera = one(common, r#", "fl_x": 50, "k3": 0.5, "w": 90"#).unwrap();
    assert_eq!(camera.intrinsics, [50.0, 200.0, 50.0, 39.5]);
    assert_eq!(camera.distortion, Distortion::Polynomial([0.4, 0.0, 0.1, 0.2, 0.5]));
    assert_eq!(camera.size, Size { width: 90, height: 80 });
}

#[test]
fn a_focal_length_goes_before_an_angle_and_pixels_are_square() {
    let size = r#""w": 100, "h": 80,"#;
    let focal = |common: &str, frame_keys: &str| {
        let camera = one(&format!("{size}{common}"), frame_keys).unwrap();
        [camera.intrinsics[0], camera.intrinsics[1]].map(|f| (f * 1e9).round() / 1e9)
    };
    // The angle of a right angle has a focal length of half of the extent.
    let right = std::f64::consts::FRAC_PI_2;
    assert_eq!(focal(r#""fl_x": 70,"#, ""), [70.0, 70.0]);
    assert_eq!(focal(&format!(r#""camera_angle_x": {right},"#), ""), [50.0, 50.0]);
    assert_eq!(focal(&format!(r#""camera_angle_y": {right},"#), ""), [40.0, 40.0]);
    let both = format!(r#""camera_angle_x": {right}, "camera_angle_y": {right},"#);
    assert_eq!(focal(&both, ""), [50.0, 40.0]);
    assert_eq!(focal(&format!(r#"{both} "fl_x": 70,"#), ""), [70.0, 40.0]);
    let frame_keys = format!(r#", "camera_angle_x": {right}"#);
    assert_eq!(focal(r#""fl_x": 70, "fl_y": 60,"#, &frame_keys), [50.0, 60.0]);
}

#[test]
fn a_matrix_of_three_rows_is_a_pose() {
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,4]]";
    let text = format!(
        r#"{{"fl_x": 1, "frames": [{{"file_path": "a.png", "transform_matrix": {pose}}}]}}"#
    );
    let camera = read(&text).unwrap()[0].camera;
    assert_eq!(camera, one(r#""fl_x": 1,"#, "").unwrap());
}

#[test]
fn what_is_no_camera_is_refused_with_the_rule() {
    let focal = r#""fl_x": 100,"#;
    for model in ["FISHEYE624", "EQUIRECTANGULAR", "pinhole"] {
        let rule = format!(
            "a camera_model is PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, and this is {model}"
        );
        assert_said(one(focal, &format!(r#", "camera_model": "{model}""#)), &rule);
        assert_said(one(&format!(r#"{focal} "camera_model": "{model}","#), ""), &rule);
    }
    assert_said(
        one(focal, r#", "k4": 0.1"#),
        r#"frame "a": a lens has k1, k2, k3, p1 and p2, and more only as FULL_OPENCV, and k4 is 0.1"#,
    );
    let fisheye = r#", "is_fisheye": true, "p2": 0.1"#;
    assert_said(one(focal, fisheye), "a fisheye has k1, k2, k3 and k4, and p2 is 0.1");
    for (frame_keys, message) in [("OPENCV", true), ("OPENCV_FISHEYE", false)] {
        let keys = format!(r#", "camera_model": "{frame_keys}", "is_fisheye": {message}"#);
        assert_said(
            one(focal, &keys),
            &format!("camera_model is {frame_keys}, and is_fisheye is {message}"),
        );
    }
    for key in ["ftheta_p0", "ftheta_p4"] {
        assert_said(one(&format!(r#""{key}": 0.5, {focal}"#), ""), key);
        assert_said(one(focal, &format!(r#", "{key}": 0"#)), key);
    }
    for (key, value) in [
        ("latlong", "true"),
        ("rolling_shutter", "[0, 0.1, 0, 0]"),
        ("from_mitsuba", "true"),
        ("from_na", "true"),
    ] {
        let message = format!("and {key} says something else");
        assert_said(one(&format!(r#""{key}": {value}, {focal}"#), ""), &message);
        assert_said(one(focal, &format!(r#", "{key}": {value}"#)), &message);
    }
    let nothing = r#""latlong": false, "rolling_shutter": [0, 0, 0.0, 0], "from_na": null,"#;
    assert_eq!(one(&format!("{focal} {nothing}"), "").unwrap(), one(focal, "").unwrap());
    assert_said(one("", ""), "a camera has fl_x or camera_angle_x, and this has neither");
    assert_said(one("", r#", "fl_x": -3"#), "focal lengths are above 0, and these are -3 and -3");
    assert_said(one("", r#", "camera_angle_x": 3.2"#), "between 0 and pi, and this is 3.2");
    assert_said(one("", r#", "camera_angle_x": 1e-320"#), "and these are too extreme");
    for size in
        [r#""w": 0, "h": 1"#, r#""w": 1.5, "h": 1"#, r#""w": 1, "h": 1e300"#, r#""w": -1, "h": 1"#]
    {
        assert_said(one(focal, &format!(", {size}")), "w and h are whole numbers from 1 to 65535");
    }
    let text = |frames: &str| format!(r#"{{"fl_x": 1, "frames": [{frames}]}}"#);
    let twice = text(&[frame("a", ""), frame("./a", "")].join(","));
    assert_said(read(&twice).map(|views| views[0].camera), "and this is repeated");
    let missing = read(&text(&frame("c", ""))).map(|views| views[0].camera);
    assert_said(
        missing,
        "with or without the ending .png, .jpg, .jpeg or .exr, and there is none at",
    );
    let skewed = r#"{"file_path": "a", "transform_matrix": [[1,0.01,0,0],[0,1,0,0],[0,0,1,4]]}"#;
    assert_said(
        read(&text(skewed)).map(|views| views[0].camera),
        r#"frame "a": the rows of a rotation"#,
    );
    assert!(matches!(
        read(&text(&frame("../a", ""))),
        Err(SceneError::Outside { .. } | SceneError::Content { .. })
    ));
    assert_eq!(read(&text("")).unwrap(), []);
}

#[test]
fn broken_json_is_refused_with_its_line_and_column() {
    for (text, expected) in [
        ("{\n \"frames\": 7}", "t.json:2:12: "),
        (
            "{\n \"fl_x\": \"7\",\n \"frames\": []}",
            "t.json:2:12: a file of cameras is JSON with frames: a number is needed here, and this is the text \"7\"",
        ),
        (
            "{\n \"fl_x\": NaN}",
            "t.json:2:10: a file of cameras is JSON with frames: expected value",
        ),
        ("{\"fl_x\": 1e999, \"frames\": []}", "t.json:1:14: "),
        ("{}", "the key `frames` is missing"),
        ("{\"frames\": [{}]}", "the key `file_path` is missing"),
        (
            "{\"frames\": [7]}",
            "t.json:1:13: a file of cameras is JSON with frames: an object is needed here",
        ),
        ("", "t.json:1: a file of cameras is JSON with frames: the text ends"),
        ("[1, 2", "t.json:1:"),
    ] {
        let message = read(text).unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
    let deep = format!("{{\"x\": {}", "[".repeat(1_000_000));
    assert!(read(&deep).is_err());
    let deep = format!("{{\"frames\": {}", "[".repeat(1_000_000));
    assert!(read(&deep).is_err());
}

#[test]
fn a_file_that_is_cut_short_is_refused_at_each_length() {
    let text =
        format!(r#"{{"fl_x": 1, "k1": 0.5, "frames": [{}]}}"#, frame("a", r#", "w": 3, "h": 2"#));
    let (place, folder) = scene(&[], &["a.png"]);
    for length in 0..=text.len() {
        fs::write(place.path().join("t.json"), &text[..length]).unwrap();
        assert_eq!(read_transforms(&folder, "t.json").is_ok(), length == text.len(), "{length}");
    }
}

#[test]
fn what_is_written_is_read_again() {
    let view = |k: usize, focal: f64| {
        let axis = DVec3::new(1.0, k as f64, -0.5).normalize();
        let rotation = DQuat::from_axis_angle(axis, 0.7 + k as f64);
        let pose =
            DMat4::from_rotation_translation(rotation, DVec3::new(0.1, -2.0, 3.3 * k as f64));
        let camera = Camera::new(Size { width: 40, height: 30 }, [focal, 41.7, 19.1, 15.3]);
        let distortion = [
            Distortion::Polynomial([0.1, -0.2, 0.003, -0.004, 0.05]),
            Distortion::Rational([0.1, -0.2, 0.003, -0.004, 0.05, 0.06, -0.07, 0.08]),
            Distortion::Fisheye([0.1, -0.2, 0.05, 0.06]),
        ];
        let distortion = distortion[if focal == 40.2 { 0 } else { k }];
        let camera = Camera { distortion, ..camera };
        let (name, image) = (format!("{k}.png"), PathBuf::from(format!("{k}.png")));
        NamedView { name, image, mask: None, camera: camera.with_opengl_pose(pose) }
    };
    let shared: Vec<NamedView> = (0..3).map(|k| view(k, 40.2)).collect();
    let frame_keys: Vec<NamedView> = (0..3).map(|k| view(k, 41.2 + k as f64)).collect();
    for (views, lenses) in [(shared, 1), (frame_keys, 3), (Vec::new(), 0)] {
        let text = transforms_json(&views);
        assert_eq!(text.matches("fl_x").count(), lenses);
        let (_place, folder) = scene(&[("t.json", &text)], &["0.png", "1.png", "2.png"]);
        let CameraFile { views: found, notes } = read_transforms(&folder, "t.json").unwrap();
        assert_eq!((found.len(), notes), (views.len(), vec![]));
        for (found, view) in found.iter().zip(&views) {
            assert_eq!((&found.name, &found.image), (&view.name, &view.image));
            assert_eq!(found.camera.size, view.camera.size);
            assert!(found.camera.view.abs_diff_eq(view.camera.view, 1e-12));
            assert!(found.camera.distortion.is_kind_of(&view.camera.distortion));
            let numbers = |camera: &Camera| {
                [&camera.intrinsics[..], camera.distortion.coefficients()].concat()
            };
            for (found, number) in numbers(&found.camera).into_iter().zip(numbers(&view.camera)) {
                assert!((found - number).abs() < 1e-12, "{found} instead of {number}");
            }
        }
    }
}

#[test]
fn fisheyes_and_quotients_are_those_of_their_programs() {
    let focal = r#""fl_x": 100,"#;
    let coefficients = r#", "k1": 0.1, "k2": -0.2, "k3": 0.03, "k4": 0.04"#;
    let expected = Distortion::Fisheye([0.1, -0.2, 0.03, 0.04]);
    for model in [r#""camera_model": "OPENCV_FISHEYE""#, r#""is_fisheye": true"#] {
        let camera = one(focal, &format!(", {model}{coefficients}")).unwrap();
        assert_eq!(camera.distortion, expected);
        // Said of all frames, too.
        let camera = one(&format!("{model}, {focal}"), coefficients).unwrap();
        assert_eq!(camera.distortion, expected);
    }
    let more = r#", "k5": 0.05, "k6": 0.06, "p1": 0.01, "p2": 0.02, "camera_model": "FULL_OPENCV""#;
    let camera = one(focal, &format!("{coefficients}{more}")).unwrap();
    let all = [0.1, -0.2, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06];
    assert_eq!(camera.distortion, Distortion::Rational(all));
}

#[test]
fn keys_that_nobody_knows_are_named_in_a_note() {
    let notes = |keys: &str, frame_keys: &str| {
        let text = format!(r#"{{"fl_x": 1, {keys} "frames": [{}]}}"#, frame("a", frame_keys));
        file(&text).unwrap().notes
    };
    // As NeRF, instant-ngp's scripts and nerfstudio write them.
    let known = r#""camera_angle_x": 0.7, "aabb_scale": 16, "scale": 0.3, "offset": [0, 0, 0],
        "applied_transform": [[1, 0, 0, 0]], "ply_file_path": "sparse_pc.ply","#;
    let of_frame = r#", "rotation": 0.01, "sharpness": 30.1, "colmap_im_id": 2,
        "depth_file_path": "d.png""#;
    assert_eq!(notes(known, of_frame), Vec::<String>::new());
    let message = notes(r#""white_transparent": true, "lens": 3,"#, r#", "time": 0.5"#);
    let rules = [
        r#"keys of the file that are not known are left out: "lens", "white_transparent""#,
        r#"keys of frames that are not known are left out: "time""#,
    ];
    assert_eq!(message, rules);
    let many: String = (10..40).map(|k| format!(r#""x{k}": 0,"#)).collect();
    assert!(notes(&many, "")[0].ends_with(r#""x21", 18 more"#), "{:?}", notes(&many, ""));
}

#[test]
fn images_that_are_smaller_by_a_whole_factor_scale_their_cameras() {
    // The image is 4 x 2, and 17 x 9 is four times that, rounded.
    let CameraFile { views, notes } = file(&format!(
        r#"{{"fl_x": 34, "fl_y": 18, "cx": 8.5, "cy": 9, "w": 17, "h": 9, "k1": 0.1, "frames": [{}]}}"#,
        frame("a", "")
    ))
    .unwrap();
    let camera = views[0].camera;
    assert_eq!(camera.size, Size { width: 4, height: 2 });
    for (found, expected) in camera.intrinsics.into_iter().zip([8.0, 4.0, 1.5, 1.5]) {
        assert!((found - expected).abs() < 1e-12, "{found} and not {expected}");
    }
    assert_eq!(camera.distortion, Distortion::Polynomial([0.1, 0.0, 0.0, 0.0, 0.0]));
    let rule = "1 image is 4 times smaller than its camera, and focal lengths and principal points are scaled \
                with them: \"a\" is 4 x 2, and its camera 17 x 9";
    assert_eq!(notes, [rule]);
}
