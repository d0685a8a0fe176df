//! Files of somebody else, in a folder that is not in the project; and how long a large file takes.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use glam::DMat4;

use super::read;
use crate::folder::Folder;
use crate::mesh::{MeshKind, glb, ply, read_model};
use crate::model::{Geometry, Indexed, Model, Placed};

/// The variable with the folder of models.
const MODELS: &str = "BOKASHI_MODELS";

fn mesh_files(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        match path.is_dir() {
            true => mesh_files(&path, found),
            false if MeshKind::of(&path).is_ok() => found.push(path),
            false => {}
        }
    }
}

#[test]
#[ignore = "needs a folder of models in BOKASHI_MODELS"]
fn files_of_others_are_read_or_refused_and_come_back() {
    let folder = PathBuf::from(std::env::var(MODELS).unwrap());
    let mut files = Vec::new();
    mesh_files(&folder, &mut files);
    assert!(!files.is_empty());
    let inside = Folder::new(&folder).unwrap();
    for path in files {
        let shown = path.strip_prefix(&folder).unwrap();
        let model = match read_model(&inside, shown) {
            Ok(model) => model,
            Err(error) => {
                println!("{}\terror\t\t{error}", shown.display());
                continue;
            }
        };
        let faces: usize = model.geometries.iter().map(|geometry| geometry.faces.len()).sum();
        println!("{}\tok\t{faces}\t{}", shown.display(), model.notes.join("; "));
        let back = read(MeshKind::Gltf, glb(&model).unwrap()).unwrap();
        assert_eq!(back.geometries, model.geometries, "{}", shown.display());
        for geometry in &model.geometries {
            let back = read(MeshKind::Ply, ply(geometry).unwrap()).unwrap();
            assert_eq!(back.geometries[0].faces, geometry.faces, "{}", shown.display());
        }
    }
}

/// A square of `side` x `side` quads with coordinates that jump in the middle, and normals.
fn sheet(side: u32) -> Model {
    let corners = |k: u32| [k % (side + 1), k / (side + 1)].map(|k| k as f32 / side as f32);
    let count = (side + 1) * (side + 1);
    let positions = (0..count).map(|k| {
        let [x, y] = corners(k);
        [x, y, (x * y).sin()]
    });
    let mut faces = Vec::new();
    for row in 0..side {
        for column in 0..side {
            let k = row * (side + 1) + column;
            faces.extend([[k, k + 1, k + side + 2], [k, k + side + 2, k + side + 1]]);
        }
    }
    let rows = (0..count).map(corners).chain((0..count).map(|k| corners(k).map(|x| x + 2.0)));
    let half = faces.len() / 2;
    let shifted = |(k, face): (usize, &[u32; 3])| match k < half {
        true => *face,
        false => face.map(|row| row + count),
    };
    let coordinates =
        Indexed { rows: rows.collect(), faces: faces.iter().enumerate().map(shifted).collect() };
    let geometry = Geometry {
        name: String::new(),
        positions: positions.collect(),
        normals: Some(Indexed { rows: vec![[0.0, 0.0, 1.0]], faces: vec![[0; 3]; faces.len()] }),
        faces,
        colors: None,
        coordinates: Some(coordinates),
        material: None,
    };
    let placed = Placed { name: String::new(), geometry: 0, transform: DMat4::IDENTITY };
    Model { geometries: vec![geometry], placed: vec![placed], ..Model::default() }
}

#[test]
#[ignore = "a measurement: run it alone, in release"]
fn a_million_faces_are_read_in_two_seconds() {
    let model = sheet(708);
    let faces = model.geometries[0].faces.len();
    let timed = |what: &str, run: &mut dyn FnMut() -> usize| {
        let mut best = f64::INFINITY;
        let mut bytes = 0;
        for _ in 0..5 {
            let start = Instant::now();
            bytes = run();
            best = best.min(start.elapsed().as_secs_f64());
        }
        println!("{what}: {faces} faces, {bytes} bytes, {best:.3} s");
        best
    };
    let file = glb(&model).unwrap();
    timed("glb written", &mut || glb(&model).unwrap().len());
    let seconds = timed("glb read", &mut || {
        let back = read(MeshKind::Gltf, &file).unwrap();
        assert_eq!(back.geometries[0].faces.len(), faces);
        file.len()
    });
    let file = ply(&model.geometries[0]).unwrap();
    timed("ply read", &mut || {
        read(MeshKind::Ply, &file).unwrap();
        file.len()
    });
    let Geometry { positions, coordinates, faces: triangles, .. } = &model.geometries[0];
    let coordinates = coordinates.as_ref().unwrap();
    let mut text = String::new();
    positions.iter().for_each(|[x, y, z]| text.push_str(&format!("v {x} {y} {z}\n")));
    coordinates.rows.iter().for_each(|[u, v]| text.push_str(&format!("vt {u} {v}\n")));
    for (a, b) in triangles.iter().zip(&coordinates.faces) {
        text.push('f');
        (0..3).for_each(|k| text.push_str(&format!(" {}/{}", a[k] + 1, b[k] + 1)));
        text.push('\n');
    }
    timed("obj read", &mut || {
        read(MeshKind::Obj, &text).unwrap();
        text.len()
    });
    assert!(seconds < 2.0, "{seconds}");
}
