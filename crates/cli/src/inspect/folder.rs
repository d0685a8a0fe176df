//! Where a file lies: what it names is read from its folder, and from nowhere else.

use std::path::Path;

use bokashi_scene::{Folder, SceneError};

/// The folder of a file, and the file's name there.
pub(super) fn folder_of(file: &Path) -> Result<(Folder, &Path), SceneError> {
    let folder = Folder::new(file.parent().unwrap_or(Path::new("")))?;
    Ok((folder, file.file_name().map_or(file, Path::new)))
}

/// The folder of the scene in which a file lies, the nearest above it with a `scene.toml`, or else its own
/// folder; and where the file lies in there.
pub(super) fn scene_folder_of(file: &Path) -> Result<(Folder, &Path), SceneError> {
    let above = file.ancestors().skip(1).find(|folder| folder.join("scene.toml").is_file());
    let Some(above) = above else { return folder_of(file) };
    Ok((Folder::new(above)?, file.strip_prefix(above).unwrap_or(file)))
}
