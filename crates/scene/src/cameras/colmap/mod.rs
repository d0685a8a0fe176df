//! Reconstructions of COLMAP: `cameras`, `images` and `points3D`, as text or binary.
//!
//! # What is read
//! Cameras of the models SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL and OPENCV; the poses of
//! images; places and colours of points. Where both kinds of files are there, the binary ones are
//! read, as COLMAP does.
//!
//! # Conventions
//! A pose is a quaternion (w, x, y, z) of any length but 0 and a translation, world to camera, in
//! OpenCV's coordinates. The corner of the first pixel is (0, 0): 1/2 is taken off the principal
//! point.
//!
//! # What is left out
//! Other models, which are refused. Features and tracks; `rigs` and `frames`, whose poses `images`
//! repeats.
//!
//! # Source
//! The documentation of COLMAP, *Output format*, and its `src/colmap/scene/reconstruction_io`.

mod binary;
mod records;
#[cfg(test)]
mod tests;
mod text;

use std::collections::BTreeMap;
use std::path::Path;

pub use self::records::ColmapPoint;
use self::records::{Lens, Shot};
use super::camera::NamedView;
use crate::error::{Place, SceneError};
use crate::folder::Folder;

/// A file's contents.
enum Found {
    Binary(Vec<u8>),
    Text(String),
}

/// The views of the reconstruction in the folder `path`, sorted by the names of their images.
/// `images` is the folder of the images. Both lie in `folder`.
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
) -> Result<Vec<NamedView>, SceneError> {
    let (found, place) = read(folder, path.as_ref(), "cameras")?;
    let lenses = match found {
        Found::Binary(bytes) => binary::lenses(&bytes, &place)?,
        Found::Text(text) => text::lenses(&text, &place)?,
    };
    let mut cameras = BTreeMap::new();
    for Lens { number, camera } in lenses {
        if cameras.insert(number, camera).is_some() {
            let found = format!("cameras have numbers of their own, and {number} is repeated");
            return Err(SceneError::content(place, found));
        }
    }
    let (found, place) = read(folder, path.as_ref(), "images")?;
    let shots = match found {
        Found::Binary(bytes) => binary::shots(&bytes, &place)?,
        Found::Text(text) => text::shots(&text, &place)?,
    };
    let mut views = BTreeMap::new();
    for Shot { rotation, translation, camera, name } in shots {
        let content =
            |message| SceneError::content(place.clone(), format!("image {name:?}: {message}"));
        let Some(found) = cameras.get(&camera) else {
            let rule = "an image has a camera of the file beside";
            return Err(content(format!("{rule}, and there is none of number {camera}")));
        };
        let length = rotation.length();
        if !(rotation.is_finite() && translation.is_finite() && length > 0.0 && length.is_finite())
        {
            let rule = "a pose is a finite quaternion other than 0, and a finite translation";
            return Err(content(format!("{rule}, and this is {rotation} and {translation}")));
        }
        let image = images.as_ref().join(&name);
        folder.find(&image)?;
        let camera = found.with_rotation_and_translation(rotation / length, translation);
        if !camera.is_finite() {
            let rule = "a pose leads to finite places, and this is too extreme";
            return Err(content(format!("{rule}: {rotation} and {translation}")));
        }
        let view = NamedView { name: name.clone(), image, camera };
        if views.insert(name.clone(), view).is_some() {
            return Err(content("images have names of their own, and this is repeated".to_owned()));
        }
    }
    Ok(views.into_values().collect())
}

/// The points of the reconstruction in the folder `path`, which lies in `folder`, sorted by their
/// numbers.
///
/// # Errors
/// - [`SceneError::Read`] and [`SceneError::Outside`] where the file can't be read.
/// - [`SceneError::Content`] for a broken file, with its line or byte.
pub fn read_colmap_points(
    folder: &Folder,
    path: impl AsRef<Path>,
) -> Result<Vec<ColmapPoint>, SceneError> {
    let (found, place) = read(folder, path.as_ref(), "points3D")?;
    let mut points = match found {
        Found::Binary(bytes) => binary::points(&bytes, &place)?,
        Found::Text(text) => text::points(&text, &place)?,
    };
    points.sort_by_key(|point| point.number);
    if let Some(pair) = points.windows(2).find(|pair| pair[0].number == pair[1].number) {
        let found = format!("points have numbers of their own, and {} is repeated", pair[0].number);
        return Err(SceneError::content(place, found));
    }
    Ok(points.into_iter().map(|numbered| numbered.point).collect())
}

/// The file `name`, binary or text, and where it lies.
fn read(folder: &Folder, path: &Path, name: &str) -> Result<(Found, Place), SceneError> {
    let binary = path.join(format!("{name}.bin"));
    if folder.find(&binary).is_ok() {
        return Ok((Found::Binary(folder.read(&binary)?), Place::of(folder.join(binary))));
    }
    let text = path.join(format!("{name}.txt"));
    Ok((Found::Text(folder.read_text(&text)?), Place::of(folder.join(text))))
}
