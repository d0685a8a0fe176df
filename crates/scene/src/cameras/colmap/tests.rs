use std::path::PathBuf;

use bokashi_render_ops::Size;
use glam::DVec3;

use super::*;
use crate::cameras::tests::{assert_seen, scene, write};
use crate::cameras::{Camera, CameraFile, Distortion, NamedView, read_transforms, transforms_json};
use crate::error::Location;

/// COLMAP's fisheyes, and its quotient of polynomials.
const WIDE_CAMERAS: &str = "1 OPENCV_FISHEYE 100 80 100 200 50 40 0.1 0.2 0.3 0.4\n\
    2 RADIAL_FISHEYE 100 80 100 50 40 0.1 0.2\n\
    3 SIMPLE_RADIAL_FISHEYE 100 80 100 50 40 0.1\n\
    4 FULL_OPENCV 100 80 100 200 50 40 1 2 3 4 5 6 7 8\n";
const CAMERAS: &str = "# Camera list with one line of data per camera:\n\
    #   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n\
    # Number of cameras: 5\n\
    1 SIMPLE_PINHOLE 100 80 100 50 40\n\
    2 PINHOLE 100 80 100 200 50 40\n\
    3 SIMPLE_RADIAL 100 80 100 50 40 0.5\n\
    7 RADIAL 100 80 100 50 40 0.5 1\n\
    5 OPENCV 100 80 100 200 50 40 0.4 0 0.1 0.2\n";
const IMAGES: &str = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n\
    4 1 0 0 0 0 0 2 3 c.png\n\
    12.5 7.5 -1 13 14 2\n\
    1 1 0 0 0 0 0 2 1 a.png\n\
    \n\
    2 2 0 0 2 0 0 2 2 sub/b b.png\n\
    1 2 3\n\
    8 1 0 0 0 0 0 2 7 d.png\n\
    \n\
    9 1 0 0 0 0 0 2 5 e.png\n";
const POINTS: &str = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n\
    9 1.5 -2 3 255 0 7 0.25 1 2 3 4\n\
    2 0 0 1e3 1 2 3 0\n";
const NAMES: [&str; 5] =
    ["images/a.png", "images/sub/b b.png", "images/c.png", "images/d.png", "images/e.png"];

fn text_files(cameras: &str, images: &str) -> Result<Vec<NamedView>, SceneError> {
    let texts = [("sparse/0/cameras.txt", cameras), ("sparse/0/images.txt", images)];
    let (_place, folder) = scene(&texts, &NAMES);
    read_colmap(&folder, "sparse/0", "images").map(|file| file.views)
}

/// Binary files of the same contents.
struct Binary {
    cameras: Vec<u8>,
    images: Vec<u8>,
    points: Vec<u8>,
}

fn binary() -> Binary {
    let numbers =
        |numbers: &[f64]| -> Vec<u8> { numbers.iter().flat_map(|n| n.to_le_bytes()).collect() };
    let camera = |number: u32, model: u32, parameters: &[f64]| {
        let head = [number.to_le_bytes(), model.to_le_bytes()].concat();
        let size = [100_u64.to_le_bytes(), 80_u64.to_le_bytes()].concat();
        [head, size, numbers(parameters)].concat()
    };
    let cameras = [
        5_u64.to_le_bytes().to_vec(),
        camera(1, 0, &[100.0, 50.0, 40.0]),
        camera(2, 1, &[100.0, 200.0, 50.0, 40.0]),
        camera(3, 2, &[100.0, 50.0, 40.0, 0.5]),
        camera(7, 3, &[100.0, 50.0, 40.0, 0.5, 1.0]),
        camera(5, 4, &[100.0, 200.0, 50.0, 40.0, 0.4, 0.0, 0.1, 0.2]),
    ];
    let image = |number: u32, quaternion: [f64; 4], camera: u32, name: &str, features: u64| {
        let head = [&number.to_le_bytes()[..], &numbers(&quaternion), &numbers(&[0.0, 0.0, 2.0])];
        let name = [&camera.to_le_bytes()[..], name.as_bytes(), &[0]].concat();
        let features = [&features.to_le_bytes()[..], &vec![0xff; 24 * features as usize]].concat();
        [head.concat(), name, features].concat()
    };
    let one = [1.0, 0.0, 0.0, 0.0];
    let images = [
        5_u64.to_le_bytes().to_vec(),
        image(4, one, 3, "c.png", 2),
        image(1, one, 1, "a.png", 0),
        image(2, [2.0, 0.0, 0.0, 2.0], 2, "sub/b b.png", 1),
        image(8, one, 7, "d.png", 0),
        image(9, one, 5, "e.png", 0),
    ];
    let point = |number: u64, offset: [f64; 3], color: [u8; 3], track: u64| {
        let head =
            [&number.to_le_bytes()[..], &numbers(&offset), &color, &numbers(&[0.5])].concat();
        [head, track.to_le_bytes().to_vec(), vec![1; 8 * track as usize]].concat()
    };
    let points = [
        2_u64.to_le_bytes().to_vec(),
        point(9, [1.5, -2.0, 3.0], [255, 0, 7], 3),
        point(2, [0.0, 0.0, 1e3], [1, 2, 3], 0),
    ];
    Binary { cameras: cameras.concat(), images: images.concat(), points: points.concat() }
}

fn binary_files(binary: &Binary) -> Result<Vec<NamedView>, SceneError> {
    // Text is not looked at where there are binary files.
    let (place, folder) = scene(&[("cameras.txt", "no camera"), ("images.txt", "none")], &NAMES);
    write(place.path(), "cameras.bin", &binary.cameras);
    write(place.path(), "images.bin", &binary.images);
    read_colmap(&folder, "", "images").map(|file| file.views)
}

#[test]
fn cameras_of_each_model_show_points_where_they_are_by_hand() {
    let views = text_files(CAMERAS, IMAGES).unwrap();
    let names: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
    assert_eq!(names, ["a.png", "c.png", "d.png", "e.png", "sub/b b.png"]);
    assert_eq!(views[4].image, PathBuf::from("images/sub/b b.png"));
    let [simple, simple_radial, radial, opencv, pinhole] =
        [0, 1, 2, 3, 4].map(|k: usize| views[k].camera);
    assert_eq!(simple.size, Size { width: 100, height: 80 });
    // The principal point (50, 40) from the corner is the middle of the image, (49.5, 39.5).
    assert_seen(&simple, [0.0, 0.0, 0.0], [49.5, 39.5]);
    assert_seen(&simple, [1.0, 0.5, 0.0], [99.5, 64.5]);
    // A quarter about z: the world's x is down, y is to the left.
    assert_seen(&pinhole, [1.0, 0.0, 0.0], [49.5, 139.5]);
    assert_seen(&pinhole, [0.0, 1.0, 0.0], [-0.5, 39.5]);
    // x = 1/2: 1 + 0.5 / 4 = 1.125, and 1 + 0.5 / 4 + 1 / 16 = 1.1875.
    assert_seen(&simple_radial, [1.0, 0.0, 0.0], [105.75, 39.5]);
    assert_seen(&radial, [0.0, 1.0, 0.0], [49.5, 98.875]);
    // x = 1/2, y = 1/4: x'' = 3/4, y'' = 3/8.
    assert_seen(&opencv, [1.0, 0.5, 0.0], [124.5, 114.5]);
}

#[test]
fn text_and_binary_files_agree() {
    let text = text_files(CAMERAS, IMAGES).unwrap();
    assert_eq!(binary_files(&binary()).unwrap(), text);
    let (place, folder) = scene(&[("points3D.txt", POINTS)], &[]);
    let points = read_colmap_points(&folder, "").unwrap();
    assert_eq!(points.len(), 2);
    assert_eq!((points[0].position, points[0].color), (DVec3::new(0.0, 0.0, 1e3), [1, 2, 3]));
    assert_eq!((points[1].position, points[1].color), (DVec3::new(1.5, -2.0, 3.0), [255, 0, 7]));
    write(place.path(), "points3D.bin", &binary().points);
    assert_eq!(read_colmap_points(&folder, "").unwrap(), points);
}

#[test]
fn the_same_scene_as_transforms_has_the_same_cameras() {
    let views = text_files(CAMERAS, IMAGES).unwrap();
    let (_place, folder) = scene(&[("t.json", &transforms_json(&views))], &NAMES);
    let found = read_transforms(&folder, "t.json").unwrap().views;
    for (found, view) in found.iter().zip(&views) {
        assert_eq!(found.image, view.image);
        for point in [DVec3::ZERO, DVec3::new(0.3, -0.4, 0.5), DVec3::new(-0.2, 0.9, -0.7)] {
            let [a, b] = [found, view].map(|view| view.camera.pixel(point).unwrap());
            assert!(a.abs_diff_eq(b, 1e-12 * 100.0), "{a} instead of {b}");
        }
        assert!(found.camera.view.abs_diff_eq(view.camera.view, 1e-12));
    }
    assert_eq!(found.len(), views.len());
}

#[test]
fn a_pose_by_hand_is_the_same_from_both_formats() {
    // The camera stands at (0, 0, 4) and looks along -z, y up: a half turn about x for OpenCV.
    let cameras = "1 PINHOLE 100 80 100 100 50 40\n";
    let images = "1 0 1 0 0 0 0 4 1 a.png\n\n";
    let colmap = text_files(cameras, images).unwrap();
    let json = r#"{"w": 100, "h": 80, "fl_x": 100, "cx": 50, "cy": 40, "frames": [{"file_path":
        "images/a.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}]}"#;
    let (_place, folder) = scene(&[("t.json", json)], &NAMES);
    let transforms = read_transforms(&folder, "t.json").unwrap().views;
    let [a, b]: [Camera; 2] = [colmap[0].camera, transforms[0].camera];
    assert!(a.view.abs_diff_eq(b.view, 1e-12), "{} {}", a.view, b.view);
    assert_eq!((a.intrinsics, a.size, a.distortion), (b.intrinsics, b.size, b.distortion));
}

#[test]
fn text_files_that_are_broken_are_refused_with_their_line() {
    for (cameras, rule) in [
        (
            "1 FOV 4 2 1 1 1 1 0.1",
            "cameras.txt:1: a camera has a model of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE, FULL_OPENCV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, and this is FOV",
        ),
        ("\n#\n1 SOMETHING 4 2 1", "cameras.txt:3: a camera has a model of"),
        ("1 PINHOLE 4 2 1 1 1", "a camera of the model PINHOLE has 4 parameters, and this has 3"),
        ("1 PINHOLE 4 2 1 1 1 1 1", "and this has 5"),
        (
            "1 PINHOLE 4 2 1 1 x 1",
            "a camera's parameter is a number in its range, and this is \"x\"",
        ),
        ("1 PINHOLE 4 2 1 1 nan 1", "parameters of a camera are finite"),
        ("1 PINHOLE 4 2 1 0 1 1", "focal lengths are above 0"),
        ("1 PINHOLE 0 2 1 1 1 1", "an image has from 1 to 65535 columns and rows"),
        ("1 PINHOLE 4 99999999999 1 1 1 1", "an image has from 1 to 65535 columns and rows"),
        ("1 PINHOLE -4 2 1 1 1 1", "a width is a number in its range, and this is \"-4\""),
        ("1 PINHOLE 4", "a height is missing"),
        ("1 PINHOLE 4 2 1 1 1 1\n1 PINHOLE 4 2 1 1 1 1", "1 is repeated"),
    ] {
        let message = text_files(cameras, "").unwrap_err().to_string();
        assert!(message.contains(rule), "{message}");
    }
    let camera = "1 PINHOLE 4 2 1 1 1 1";
    for (images, rule) in [
        ("1 1 0 0 0 0 0 2 1", "images.txt:1: an image's name is missing"),
        (
            "1 1 0 0 0 0 0 2 6 a.png",
            "image \"a.png\": an image has a camera of the file beside, and there is none of number 6",
        ),
        ("1 0 0 0 0 0 0 2 1 a.png", "a pose is a finite quaternion other than 0"),
        ("1 1 0 0 inf 0 0 2 1 a.png", "a pose is a finite quaternion other than 0"),
        ("1 1 0 0 0 0 nan 2 1 a.png", "a pose is a finite quaternion other than 0"),
        ("1 1 0 0 .5 1.7e308 1.7e308 0 1 a.png", "a pose leads to finite places"),
        ("1 1 0 0 0 0 0 2 1 a.png\n\n2 1 0 0 0 0 0 2 1 a.png", "and this is repeated"),
        ("1 1 0 0 0 0 0 2 1 f.png", "f.png could not be read"),
        ("x", "an image's number is a number in its range"),
        // Lines of points are left out: the second image would be taken for the first one's points.
        (
            "1 1 0 0 0 0 0 2 1 a.png\n2 1 0 0 0 0 0 2 1 c.png\n",
            "images.txt:2: after an image's line comes one of its points, of three numbers each or empty",
        ),
        (
            "1 1 0 0 0 0 0 2 1 a.png\n\n2 1 0 0 0 0 0 2 1 c.png\n3 1 0 0 0 0 0 2 1 of three words.png\n",
            "images.txt:4: after an image's line",
        ),
    ] {
        let message = text_files(camera, images).unwrap_err().to_string();
        assert!(message.contains(rule), "{message}");
    }
    let (_place, folder) = scene(
        &[("cameras.txt", camera), ("images.txt", "1 1 0 0 0 0 0 2 1 ../../etc/passwd")],
        &NAMES,
    );
    assert!(read_colmap(&folder, "", "images").is_err());
    for (points, rule) in [
        ("1 2 3 4 5 6", "points3D.txt:1: B is missing"),
        ("1 2 3 4 5 6 256", "B is a number in its range, and this is \"256\""),
        ("1 2 3 nan 5 6 7", "a point is finite"),
        ("1 2 3 4 5 6 7\n1 2 3 4 5 6 7", "and 1 is repeated"),
    ] {
        let (_place, folder) = scene(&[("points3D.txt", points)], &[]);
        let message = read_colmap_points(&folder, "").unwrap_err().to_string();
        assert!(message.contains(rule), "{message}");
    }
}

#[test]
fn counts_beyond_the_file_take_no_memory() {
    let huge = u64::MAX.to_le_bytes();
    let message = |binary: &Binary| binary_files(binary).unwrap_err().to_string();
    for count in [huge, (1_u64 << 40).to_le_bytes(), 6_u64.to_le_bytes()] {
        let mut cameras = binary();
        cameras.cameras[..8].copy_from_slice(&count);
        assert!(message(&cameras).contains("cameras.bin: byte "), "{}", message(&cameras));
        let mut images = binary();
        images.images[..8].copy_from_slice(&count);
        assert!(message(&images).contains("images.bin: byte "), "{}", message(&images));
    }
    let mut cameras = binary();
    cameras.cameras[..8].copy_from_slice(&huge);
    let rule = "byte 8: at most 6 records fit in the bytes that are left, and their count is";
    assert!(message(&cameras).contains(rule), "{}", message(&cameras));
    // The count of the first image's features: two, before its bytes of 255.
    let mut images = binary();
    let offset = images.images.windows(6).position(|window| window == b"c.png\0").unwrap() + 6;
    images.images[offset..offset + 8].copy_from_slice(&huge);
    assert!(
        message(&images).contains("and their count is 18446744073709551615"),
        "{}",
        message(&images)
    );
    // Models by their numbers.
    for (model, name) in [
        (7_u32, "FOV"),
        (10, "THIN_PRISM_FISHEYE"),
        (99, "number 99"),
        (u32::MAX, "number 4294967295"),
    ] {
        let mut cameras = binary();
        cameras.cameras[12..16].copy_from_slice(&model.to_le_bytes());
        assert!(
            message(&cameras).contains(&format!("and this is {name}")),
            "{}",
            message(&cameras)
        );
    }
}

#[test]
fn files_that_are_cut_short_have_an_answer_at_each_length() {
    let (whole, location) = (binary(), Location::new("file"));
    for length in 0..whole.cameras.len() {
        assert!(binary::lenses(&whole.cameras[..length], &location).is_err(), "{length}");
    }
    for length in 0..whole.images.len() {
        assert!(binary::shots(&whole.images[..length], &location).is_err(), "{length}");
    }
    for length in 0..whole.points.len() {
        assert!(binary::points(&whole.points[..length], &location).is_err(), "{length}");
    }
    // A text that ends with a line, or with a shorter number, is a file.
    for length in 0..CAMERAS.len() {
        let found = text::lenses(&CAMERAS[..length], &location);
        assert!(found.map_or(0, |lenses| lenses.len()) <= 5);
    }
    for length in 0..IMAGES.len() {
        let found = text::shots(&IMAGES[..length], &location);
        assert!(found.map_or(0, |shots| shots.len()) <= 5);
    }
    for length in 0..POINTS.len() {
        let found = text::points(&POINTS[..length], &location);
        assert!(found.map_or(0, |points| points.len()) <= 2);
    }
}

#[test]
fn files_with_a_wrong_byte_have_an_answer() {
    let (whole, location) = (binary(), Location::new("file"));
    let changed = |file: &[u8], offset: usize, value: u8| {
        let mut file = file.to_vec();
        file[offset] = value;
        file
    };
    for value in [0, 1, 0x7f, 0x80, 0xff] {
        for offset in 0..whole.cameras.len() {
            if let Ok(lenses) = binary::lenses(&changed(&whole.cameras, offset, value), &location) {
                assert!(lenses.iter().flat_map(|lens| lens.camera.intrinsics).all(f64::is_finite));
            }
        }
        for offset in 0..whole.images.len() {
            let found = binary::shots(&changed(&whole.images, offset, value), &location);
            assert!(found.is_err() || found.is_ok_and(|shots| shots.len() <= 5));
        }
        for offset in 0..whole.points.len() {
            if let Ok(points) = binary::points(&changed(&whole.points, offset, value), &location) {
                assert!(points.iter().all(|numbered| numbered.point.position.is_finite()));
            }
        }
    }
}

#[test]
fn fisheyes_and_quotients_have_opencvs_coefficients() {
    let shot = |k: u32, name: &str| format!("{k} 1 0 0 0 0 0 2 {k} {name}\n\n");
    let images = ["a", "c", "d", "e"].map(|name| format!("{name}.png"));
    let images: String = (1..).zip(&images).map(|(k, name)| shot(k, name)).collect();
    let views = text_files(WIDE_CAMERAS, &images).unwrap();
    let lenses: Vec<_> = views.iter().map(|view| view.camera.distortion).collect();
    let expected = [
        Distortion::Fisheye([0.1, 0.2, 0.3, 0.4]),
        Distortion::Fisheye([0.1, 0.2, 0.0, 0.0]),
        Distortion::Fisheye([0.1, 0.0, 0.0, 0.0]),
        Distortion::Rational([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]),
    ];
    assert_eq!(lenses, expected);
    assert_eq!(views[1].camera.intrinsics, [100.0, 100.0, 49.5, 39.5]);
    assert_eq!(views[3].camera.intrinsics, [100.0, 200.0, 49.5, 39.5]);
}

#[test]
fn the_largest_model_is_taken_and_all_are_named() {
    let camera = "1 PINHOLE 100 80 100 100 50 40\n";
    let one = "1 1 0 0 0 0 0 2 1 a.png\n\n";
    let two = format!("{one}2 1 0 0 0 0 0 3 1 c.png\n\n");
    let texts = [
        ("sparse/0/cameras.txt", camera),
        ("sparse/0/images.txt", one),
        ("sparse/1/cameras.txt", camera),
        ("sparse/1/images.txt", &two),
        ("sparse/10/cameras.txt", camera),
        ("sparse/10/images.txt", "broken"),
        // No name that COLMAP gives.
        ("sparse/02/cameras.txt", camera),
        ("single/0/cameras.txt", camera),
        ("single/0/images.txt", &two),
        ("flat/cameras.txt", camera),
        ("flat/images.txt", one),
    ];
    let (_place, folder) = scene(&texts, &["images/a.png", "images/c.png", "images/sub/x.png"]);
    let CameraFile { views, notes } = read_colmap(&folder, "sparse", "images").unwrap();
    assert_eq!(views.len(), 2);
    let several = "sparse has several models: sparse/1 with 2 images is taken, and sparse/0 with 1 image, \
                   sparse/10 with 0 images left out";
    let without = "images: 1 image has no camera, and is left out: sub/x.png";
    assert_eq!(notes, [several, without]);
    let single = read_colmap(&folder, "single", "images").unwrap();
    assert_eq!((single.views.len(), single.notes), (2, vec![without.to_owned()]));
    let flat = read_colmap(&folder, "flat", "images").unwrap();
    let without = "images: 2 images have no camera, and are left out: c.png, sub/x.png";
    assert_eq!((flat.views.len(), flat.notes), (1, vec![without.to_owned()]));
    let message = read_colmap(&folder, "images", "images").unwrap_err().to_string();
    assert!(message.contains("images/cameras.txt could not be read"), "{message}");
}

#[test]
fn a_name_of_windows_is_a_path() {
    let images = "1 1 0 0 0 0 0 2 1 sub\\b b.png\n\n";
    let views = text_files("1 PINHOLE 100 80 100 100 50 40\n", images).unwrap();
    assert_eq!(views[0].image, PathBuf::from("images/sub/b b.png"));
}
