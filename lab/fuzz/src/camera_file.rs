//! Arbitrary files as cameras.

use bokashi_scene::{
    NamedView, SceneError, read_colmap, read_colmap_points, read_transforms, transforms_json,
};

use super::files::{beside, in_short, small_image};

/// Reads the cameras that `bytes` are. The first byte says of which program: of NeRF's kind, or COLMAP's three
/// files as text, each up to a byte 0, or as binary, the lengths of the first two before them. Returns the
/// number of views and points.
pub fn camera_file(bytes: &[u8]) -> usize {
    let Some((&how, bytes)) = bytes.split_first() else { return 0 };
    let image = small_image();
    let images = [("images/a.png", &*image), ("images/b.png", &*image)];
    match how % 3 {
        0 => beside(images.into_iter().chain([("t.json", bytes)]), |folder| {
            let views = match read_transforms(folder, "t.json") {
                Ok(file) => file.views,
                Err(error) => return in_short(&error),
            };
            check(&views);
            let written = transforms_json(&views);
            beside(images.into_iter().chain([("t.json", written.as_bytes())]), |folder| {
                let back = read_transforms(folder, "t.json").expect("what was written can be read");
                assert_eq!(back.views.len(), views.len());
                views.len()
            })
        }),
        1 => {
            let mut parts = bytes.splitn(3, |&byte| byte == 0);
            let mut part = || parts.next().unwrap_or_default();
            let files =
                [("m/cameras.txt", part()), ("m/images.txt", part()), ("m/points3D.txt", part())];
            reconstruction(images.into_iter().chain(files))
        }
        _ => {
            let [first, second, rest @ ..] = bytes else { return 0 };
            let split = |bytes, length: u8| <[u8]>::split_at_checked(bytes, length.into());
            let Some((cameras, rest)) = split(rest, *first) else { return 0 };
            let Some((shots, points)) = split(rest, *second) else { return 0 };
            let files =
                [("m/cameras.bin", cameras), ("m/images.bin", shots), ("m/points3D.bin", points)];
            reconstruction(images.into_iter().chain(files))
        }
    }
}

fn reconstruction<'f>(files: impl IntoIterator<Item = (&'f str, &'f [u8])>) -> usize {
    beside(files, |folder| {
        let count =
            |result: Result<usize, SceneError>| result.unwrap_or_else(|error| in_short(&error));
        let views = count(read_colmap(folder, "m", "images").map(|file| {
            check(&file.views);
            file.views.len()
        }));
        views
            + count(read_colmap_points(folder, "m").map(|points| {
                assert!(points.iter().all(|point| point.position.is_finite()));
                points.len()
            }))
    })
}

/// Panics where a camera is not finite, or where two have one name.
fn check(views: &[NamedView]) {
    for (at, view) in views.iter().enumerate() {
        let camera = &view.camera;
        let mut numbers = camera.intrinsics.iter().chain(camera.distortion.coefficients());
        assert!(numbers.all(|number| number.is_finite()), "{camera:?}");
        assert!(camera.view.is_finite() && camera.opencv_pose().is_finite(), "{camera:?}");
        assert!(camera.size.width > 0 && camera.size.height > 0, "{camera:?}");
        assert!(views[..at].iter().all(|other| other.name != view.name), "{:?}", view.name);
    }
}
