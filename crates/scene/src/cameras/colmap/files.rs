//! The files of a model, binary or text.

use std::path::Path;

use super::records::Shot;
use super::{binary, text};
use crate::error::{Place, SceneError};
use crate::folder::Folder;

/// The records of the file `name`, whose form, binary or text, says what reads it; and where it lies.
///
/// # Errors
/// What keeps it from being read, and what is wrong with it.
pub(super) fn read<R>(
    folder: &Folder,
    path: &Path,
    name: &str,
    binary: impl Fn(&[u8], &Place) -> Result<Vec<R>, SceneError>,
    text: impl Fn(&str, &Place) -> Result<Vec<R>, SceneError>,
) -> Result<(Vec<R>, Place), SceneError> {
    let [file, other] = ["bin", "txt"].map(|ending| path.join(format!("{name}.{ending}")));
    if folder.find(&file).is_ok() {
        let (bytes, place) = (folder.read(&file)?, Place::new(folder.join(file)));
        return Ok((binary(&bytes, &place)?, place));
    }
    let (words, place) = (folder.read_text(&other)?, Place::new(folder.join(other)));
    Ok((text(&words, &place)?, place))
}

/// The images of a model, and where they are.
///
/// # Errors
/// As [`read`].
pub(super) fn shots(folder: &Folder, path: &Path) -> Result<(Vec<Shot>, Place), SceneError> {
    read(folder, path, "images", binary::shots, text::shots)
}
