//! Arbitrary files as meshes.

use bokashi_scene::{
    Folder, Geometry, Indexed, MeshKind, MeshOptions, Model, NO_ROW, glb, ply, read_model_bytes,
};
use glam::{DMat4, DVec3};

use super::files::{beside, in_short, small_image};

/// Reads the mesh file that `bytes` are: the first byte says in which format. In text a byte 0 ends the file,
/// and what follows is the file beside it, `m.mtl` or `b.bin`; beside it there is an image, too, `a.png`.
/// Returns the number of faces that were read.
pub fn mesh_file(bytes: &[u8]) -> usize {
    let Some((&how, bytes)) = bytes.split_first() else { return 0 };
    let kind = [MeshKind::Obj, MeshKind::Ply, MeshKind::Gltf][usize::from(how % 3)];
    let (bytes, other) = match kind {
        MeshKind::Ply => (bytes, None),
        MeshKind::Gltf if bytes.starts_with(b"glTF") => (bytes, None),
        _ => match bytes.iter().position(|&byte| byte == 0) {
            Some(end) => (&bytes[..end], Some(&bytes[end + 1..])),
            None => (bytes, None),
        },
    };
    let name = if kind == MeshKind::Obj { "m.mtl" } else { "b.bin" };
    let image = small_image();
    let files = other.map(|bytes| (name, bytes)).into_iter().chain([("a.png", &*image)]);
    // What is written doubles vertices at seams: only welded ones come back.
    let options = MeshOptions { weld: Some(true), ..MeshOptions::default() };
    beside(files, |folder| match read_model_bytes(bytes, kind, folder, "mesh", options) {
        Ok(model) => {
            check(&model, folder);
            model.geometries.iter().map(|geometry| geometry.faces.len()).sum()
        }
        Err(error) => in_short(&error),
    })
}

/// Panics unless the numbers of a model name its parts, and its meshes come back from files.
fn check(model: &Model, folder: &Folder) {
    for geometry in &model.geometries {
        let Geometry { positions, faces, colors, coordinates, normals, tangents, .. } = geometry;
        assert!(!faces.is_empty());
        check_rows(positions, faces);
        check_indexed(colors, geometry);
        check_indexed(coordinates, geometry);
        check_indexed(normals, geometry);
        check_indexed(tangents, geometry);
        assert!(faces.iter().all(|[a, b, c]| a != b && b != c && c != a));
        let ends = geometry.submeshes.iter().map(|submesh| submesh.faces.end);
        let begins = geometry.submeshes.iter().map(|submesh| submesh.faces.start);
        assert!([0].into_iter().chain(ends).eq(begins.chain([faces.len()])));
        let mut materials = geometry.materials().flatten();
        assert!(materials.all(|material| material < model.materials.len()));
    }
    for material in &model.materials {
        assert!(material.images().all(|image| image < model.images.len()));
    }
    for placed in &model.placed {
        assert!(placed.geometry < model.geometries.len() && placed.transform.is_finite());
    }
    assert!(model.notes.iter().map(String::len).sum::<usize>() < 1 << 16);
    let written = glb(model).expect("what was read can be written");
    let options = MeshOptions::default();
    let back = read_model_bytes(&written, MeshKind::Gltf, folder, "mesh", options);
    // Nodes have what was taken off positions.
    let bare = |own: &Geometry| Geometry { offset: DVec3::ZERO, ..own.clone() };
    let bare: Vec<Geometry> = model.geometries.iter().map(bare).collect();
    assert_eq!(back.expect("what was written can be read").geometries, bare);
    for geometry in &model.geometries {
        let places = [DMat4::from_translation(geometry.offset)];
        let written = ply(geometry, &places, &model.materials, |_| None);
        let written = written.expect("what was read can be written");
        let back = read_model_bytes(&written, MeshKind::Ply, folder, "mesh", options);
        let back = back.expect("what was written can be read");
        assert_eq!(back.geometries[0].faces, geometry.faces);
    }
}

fn check_indexed<const N: usize>(indexed: &Option<Indexed<N>>, geometry: &Geometry) {
    let Some(indexed) = indexed else { return };
    assert_eq!(indexed.faces.len(), geometry.faces.len());
    for submesh in &geometry.submeshes {
        let own = &indexed.faces[submesh.faces.clone()];
        match indexed.covers(&submesh.faces) {
            true => check_rows(&indexed.rows, own),
            false => assert!(own.as_flattened().iter().all(|&row| row == NO_ROW)),
        }
    }
}

fn check_rows<const N: usize>(rows: &[[f32; N]], faces: &[[u32; 3]]) {
    assert!(faces.iter().flatten().all(|&row| (row as usize) < rows.len()));
    assert!(rows.iter().flatten().all(|number| number.is_finite()));
}
