//! The files of a model, binary or text.

use std::path::Path;

use super::records::Shot;
use super::{binary, text};
use crate::error::{Place, SceneError};
use crate::folder::Folder;

/// A file's contents.
pub(super) enum Found {
    Binary(Vec<u8>),
    Text(String),
}

/// The file `name`, binary or text, and where it lies.
///
/// # Errors
/// What keeps it from being read.
pub(super) fn read(folder: &Folder, path: &Path, name: &str) -> Result<(Found, Place), SceneError> {
    let binary = path.join(format!("{name}.bin"));
    if folder.find(&binary).is_ok() {
        return Ok((Found::Binary(folder.read(&binary)?), Place::of(folder.join(binary))));
    }
    let text = path.join(format!("{name}.txt"));
    Ok((Found::Text(folder.read_text(&text)?), Place::of(folder.join(text))))
}

/// The images of a model, and where they are.
///
/// # Errors
/// What is wrong with the file.
pub(super) fn shots(folder: &Folder, path: &Path) -> Result<(Vec<Shot>, Place), SceneError> {
    let (found, place) = read(folder, path, "images")?;
    let shots = match found {
        Found::Binary(bytes) => binary::shots(&bytes, &place)?,
        Found::Text(text) => text::shots(&text, &place)?,
    };
    Ok((shots, place))
}
