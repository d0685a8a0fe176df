//! Meshes of files: what is read, by the file's extension, and what is written.
//!
//! | format | read | written |
//! |---|---|---|
//! | Wavefront OBJ with MTL | [`read_model`] | [`obj()`] |
//! | PLY, ascii and binary | [`read_model`] | [`ply()`] |
//! | glTF 2.0, as text or GLB | [`read_model`] | [`glb()`] |
//!
//! Whatever the format, a [`Model`] holds triangles, and attributes have index buffers of their own. A surface of
//! several materials is one mesh with a submesh for each. Vertices of PLY and glTF that lie in one place are one
//! vertex, and those of OBJ that have one number; [`MeshOptions::weld`] says otherwise. What was left out or
//! mended stands in [`Model::notes`].

mod check;
mod colors;
mod context;
mod far;
mod gltf;
mod in_world;
mod notes;
mod obj;
mod options;
mod ply;
mod polygons;
#[cfg(test)]
mod tests;
mod unweld;
mod weld;
mod write_glb;
mod write_obj;
mod write_ply;

use std::path::Path;

pub(crate) use self::gltf::unescaped;
pub use self::options::MeshOptions;
pub use self::write_glb::glb;
pub(crate) use self::write_obj::is_word;
pub use self::write_obj::{ObjFiles, obj};
pub use self::write_ply::ply;
use crate::error::{Location, SceneError};
use crate::folder::Folder;
use crate::mesh::context::MeshContext;
use crate::model::Model;

/// The most notes that an error has.
const MOST_NOTES: usize = 3;

/// The formats of meshes that are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MeshKind {
    /// Wavefront OBJ, `.obj`.
    Obj,
    /// PLY, `.ply`.
    Ply,
    /// glTF 2.0, `.gltf` or `.glb`. The first bytes tell which of the two a file is.
    Gltf,
}

impl MeshKind {
    /// The format of the file at `path`, by its extension in any case.
    ///
    /// # Errors
    /// [`SceneError::Content`] for another extension.
    pub fn from_path(path: impl AsRef<Path>) -> Result<Self, SceneError> {
        let path = path.as_ref();
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match &*extension {
            "obj" => Ok(Self::Obj),
            "ply" => Ok(Self::Ply),
            "gltf" | "glb" => Ok(Self::Gltf),
            _ => {
                let rule = "a mesh file is an .obj, .ply, .gltf or .glb file";
                let message = format!("{rule}, and the extension is {extension:?}");
                Err(SceneError::content(Location::new(path), message))
            }
        }
    }
}

/// The mesh file at `path` in `folder`, and the materials and images that it names.
///
/// # Errors
/// [`SceneError::Content`] for an extension that is none of the four, and for what breaks a rule of the
/// format; [`SceneError::Read`] where a file can't be read; [`SceneError::Outside`] where the file names
/// another one outside the folder; [`SceneError::TooLarge`] where a file asks for more memory than its
/// length allows; [`SceneError::Memory`] where its images are larger than the process may have.
pub fn read_model(folder: &Folder, path: impl AsRef<Path>) -> Result<Model, SceneError> {
    read_model_with(folder, path, MeshOptions::default())
}

/// As [`read_model`], with what `options` say about the file.
///
/// # Errors
/// As [`read_model`].
pub fn read_model_with(
    folder: &Folder,
    path: impl AsRef<Path>,
    options: MeshOptions,
) -> Result<Model, SceneError> {
    read_counted(&folder.anew(), path.as_ref(), options)
}

/// As [`read_model_with`], where what the folder's files take counts together.
pub(crate) fn read_counted(
    folder: &Folder,
    path: &Path,
    options: MeshOptions,
) -> Result<Model, SceneError> {
    let kind = MeshKind::from_path(path).map_err(|error| match error {
        SceneError::Content { message, .. } => {
            SceneError::content(Location::new(folder.join(path)), message)
        }
        other => other,
    })?;
    read_model_bytes(&folder.read(path)?, kind, folder, path, options)
}

/// The mesh file with these `bytes`, of which `options` say more. `path` is where the file would lie in
/// `folder`: in errors, and for the files that it names.
///
/// # Errors
/// As [`read_model`].
pub fn read_model_bytes(
    bytes: &[u8],
    kind: MeshKind,
    folder: &Folder,
    path: impl AsRef<Path>,
    options: MeshOptions,
) -> Result<Model, SceneError> {
    let mut context = MeshContext::new(folder, path.as_ref(), options);
    let model = match kind {
        MeshKind::Obj => obj::read(bytes, &mut context),
        MeshKind::Ply => ply::read(bytes, &mut context),
        MeshKind::Gltf => gltf::read(bytes, &mut context),
    }?;
    if model.geometries.is_empty() {
        let mut message =
            "a mesh file has a face with three vertices, and this has none".to_owned();
        for note in model.notes.iter().take(MOST_NOTES) {
            message.push_str("; ");
            message.push_str(note);
        }
        if model.notes.len() > MOST_NOTES {
            message.push_str("; and more was left out");
        }
        return Err(context.error(message));
    }
    Ok(model)
}
