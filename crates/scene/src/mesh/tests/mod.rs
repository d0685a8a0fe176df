//! Mesh files, as bytes that are built here.

mod gltf;
mod gltf_keys;
mod gltf_materials;
mod gltf_poses;
mod hostile;
mod obj;
mod ply;
mod polygons;
mod weld;
mod written;

use std::path::Path;

use glam::DMat4;

use crate::error::SceneError;
use crate::folder::Folder;
use crate::mesh::{MeshKind, MeshOptions, read_model_bytes};
use crate::model::{Geometry, Indexed, Model};

/// The place of a geometry that stands in the world as it is.
const HERE: &[DMat4] = &[DMat4::IDENTITY];

/// What is read of these bytes, without other files.
fn read(kind: MeshKind, bytes: impl AsRef<[u8]>) -> Result<Model, SceneError> {
    let folder = tempfile::tempdir().unwrap();
    read_with(kind, bytes, &[], folder.path())
}

/// What is read of these bytes beside files of these names, which are written to `folder`.
fn read_with(
    kind: MeshKind,
    bytes: impl AsRef<[u8]>,
    files: &[(&str, &[u8])],
    folder: &Path,
) -> Result<Model, SceneError> {
    for (name, contents) in files {
        std::fs::create_dir_all(folder.join(name).parent().unwrap()).unwrap();
        std::fs::write(folder.join(name), contents).unwrap();
    }
    read_model_bytes(
        bytes.as_ref(),
        kind,
        &Folder::new(folder).unwrap(),
        "mesh",
        MeshOptions::default(),
    )
}

/// The only mesh of a model.
fn only(model: &Model) -> &Geometry {
    assert_eq!(model.geometries.len(), 1);
    &model.geometries[0]
}

/// The rows at the corners of all faces.
fn at_corners<const N: usize>(rows: &[[f32; N]], faces: &[[u32; 3]]) -> Vec<[f32; N]> {
    faces.iter().flatten().map(|&row| rows[row as usize]).collect()
}

fn of_corners<const N: usize>(indexed: &Option<Indexed<N>>) -> Vec<[f32; N]> {
    let indexed = indexed.as_ref().unwrap();
    at_corners(&indexed.rows, &indexed.faces)
}

/// What an error says.
fn message(result: Result<Model, SceneError>) -> String {
    result.unwrap_err().to_string()
}
