//! The files of a model, binary or text.

use std::path::Path;

use super::records::Shot;
use super::{binary, text};
use crate::error::{Location, SceneError};
use crate::folder::Folder;

/// The records of the file `name`, whose form, binary or text, says what reads it; and where it lies.
///
/// # Errors
/// What keeps it from being read, and what is wrong with it.
pub(super) fn read<R>(
    folder: &Folder,
    path: &Path,
    name: &str,
    binary: impl Fn(&[u8], &Location) -> Result<Vec<R>, SceneError>,
    text: impl Fn(&str, &Location) -> Result<Vec<R>, SceneError>,
) -> Result<(Vec<R>, Location), SceneError> {
    let [file, other] = ["bin", "txt"].map(|ending| path.join(format!("{name}.{ending}")));
    if folder.find(&file).is_ok() {
        let (bytes, location) = (folder.read(&file)?, Location::new(folder.join(file)));
        return Ok((binary(&bytes, &location)?, location));
    }
    let (words, location) = (folder.read_text(&other)?, Location::new(folder.join(other)));
    Ok((text(&words, &location)?, location))
}

/// The images of a model, and where they are.
///
/// # Errors
/// As [`read`].
pub(super) fn shots(folder: &Folder, path: &Path) -> Result<(Vec<Shot>, Location), SceneError> {
    read(folder, path, "images", binary::shots, text::shots)
}
