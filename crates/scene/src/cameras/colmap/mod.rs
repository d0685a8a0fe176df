//! Reconstructions of COLMAP: `cameras`, `images` and `points3D`, as text or binary.
//!
//! # What is read
//! Cameras of the models SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV,
//! SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE and OPENCV_FISHEYE; the poses of images; places and
//! colours of points. Where both kinds of files are there, the binary ones are read, as COLMAP
//! does. A model is in the folder itself or in one of its numbered folders, as in `sparse`.
//!
//! # Conventions
//! A pose is a quaternion (w, x, y, z) of any length but 0 and a translation, world to camera, in
//! OpenCV's coordinates. The corner of the first pixel is (0, 0): 1/2 is taken off the principal
//! point.
//!
//! # What is left out
//! Other models, as FOV and THIN_PRISM_FISHEYE, which are refused. Features and tracks; `rigs` and `frames`,
//! whose poses `images` repeats.
//!
//! # Source
//! The documentation of COLMAP, *Output format*, and its `src/colmap/scene/reconstruction_io`.

mod binary;
mod files;
mod models;
mod records;
#[cfg(test)]
mod tests;
mod text;

use std::collections::BTreeMap;
use std::path::Path;

use self::files::{read, shots};
pub use self::models::find_colmap;
pub use self::records::ColmapPoint;
use self::records::{Lens, Shot};
use crate::cameras::camera::NamedView;
use crate::cameras::camera_file::CameraFile;
use crate::error::SceneError;
use crate::folder::Folder;

/// The views of the reconstruction in the folder `path`, or in one of its numbered folders
/// ([`find_colmap`]), sorted by the names of their images. `images` is the folder of the images.
/// Both lie in `folder`.
///
/// Cameras of images that are smaller than they by a whole factor are scaled with them; a note says so. Other
/// notes name further models, and images without a camera.
///
/// # Errors
/// - [`SceneError::Read`] and [`SceneError::Outside`] where a file or an image can't be found, or
///   lies outside the folder.
/// - [`SceneError::Content`] for a broken file, with its line or byte; for a camera of another
///   model; for an image without a camera, or with another's name.
pub fn read_colmap(
    folder: &Folder,
    path: impl AsRef<Path>,
    images: impl AsRef<Path>,
) -> Result<CameraFile, SceneError> {
    let (path, note) = find_colmap(folder, path);
    let mut notes: Vec<_> = note.into_iter().collect();
    let (lenses, location) = read(folder, &path, "cameras", binary::lenses, text::lenses)?;
    let mut cameras = BTreeMap::new();
    for Lens { number, camera } in lenses {
        if cameras.insert(number, camera).is_some() {
            let message = format!("cameras have numbers of their own, and {number} is repeated");
            return Err(SceneError::content(location, message));
        }
    }
    let (shots, location) = shots(folder, &path)?;
    let mut views = BTreeMap::new();
    for Shot { rotation, translation, camera, name } in shots {
        let content =
            |message| SceneError::content(location.clone(), format!("image {name:?}: {message}"));
        let Some(lens) = cameras.get(&camera) else {
            let rule = "an image has a camera of the file beside";
            return Err(content(format!("{rule}, and there is none of number {camera}")));
        };
        let length = rotation.length();
        if !(rotation.is_finite() && translation.is_finite() && length > 0.0 && length.is_finite())
        {
            let rule = "a pose is a finite quaternion other than 0, and a finite translation";
            return Err(content(format!("{rule}, and this is {rotation} and {translation}")));
        }
        // Of Windows, where there is no such name here.
        let image = [name.clone(), name.replace('\\', "/")].map(|name| images.as_ref().join(name));
        let [image, other] = image;
        let image =
            if folder.find(&image).is_err() && folder.find(&other).is_ok() { other } else { image };
        folder.find(&image)?;
        let camera = lens.with_rotation_and_translation(rotation / length, translation);
        if !camera.is_finite() {
            let rule = "a pose leads to finite places, and this is too extreme";
            return Err(content(format!("{rule}: {rotation} and {translation}")));
        }
        let view = NamedView { name: name.clone(), image, mask: None, camera };
        if views.insert(name.clone(), view).is_some() {
            return Err(content("images have names of their own, and this is repeated".to_owned()));
        }
    }
    let views: Vec<_> = views.into_values().collect();
    notes.extend(models::without_camera(folder, images.as_ref(), &views));
    Ok(CameraFile { views, notes }.sized(folder))
}

/// The points of the reconstruction in the folder `path`, which lies in `folder`, sorted by their
/// numbers. As for [`read_colmap`], a numbered folder of it may hold them.
///
/// # Errors
/// - [`SceneError::Read`] and [`SceneError::Outside`] where the file can't be read.
/// - [`SceneError::Content`] for a broken file, with its line or byte.
pub fn read_colmap_points(
    folder: &Folder,
    path: impl AsRef<Path>,
) -> Result<Vec<ColmapPoint>, SceneError> {
    let (path, _) = find_colmap(folder, path);
    let (mut points, location) = read(folder, &path, "points3D", binary::points, text::points)?;
    points.sort_by_key(|point| point.number);
    if let Some(pair) = points.windows(2).find(|pair| pair[0].number == pair[1].number) {
        let message =
            format!("points have numbers of their own, and {} is repeated", pair[0].number);
        return Err(SceneError::content(location, message));
    }
    Ok(points.into_iter().map(|numbered| numbered.point).collect())
}
