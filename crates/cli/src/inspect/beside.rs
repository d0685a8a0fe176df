//! Where a file lies: what it names is read from its folder, and from nowhere else.

use std::path::Path;

use bokashi_scene::{Folder, SceneError};

/// The folder of a file, and the file's name there.
pub(super) fn beside(file: &Path) -> Result<(Folder, &Path), SceneError> {
    let folder = Folder::new(file.parent().unwrap_or(Path::new("")))?;
    Ok((folder, file.file_name().map_or(file, Path::new)))
}
