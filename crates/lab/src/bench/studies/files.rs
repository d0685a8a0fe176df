//! How long does it take to read a mesh?

use bokashi_fit::FitError;
use bokashi_scene::{
    Folder, Geometry, Indexed, MeshKind, MeshOptions, Model, Placed, SceneError, Submesh, glb, obj,
    ply, read_model_bytes,
};
use glam::{DMat4, DVec3};

use crate::bench::effort::USUAL;
use crate::bench::sampling::{Contestant, interleaved};
use crate::bench::setting::Bench;
use crate::bench::study::Study;
use crate::bench::table::{Cell, Table};

/// Quads along a side of the sheet, quick and full: a million faces.
const SIDES: [u32; 2] = [32, 708];

/// A file in memory: its format for people, the format, and its bytes.
type File = (&'static str, MeshKind, Vec<u8>);

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let mut study = Study::new(
        "files",
        "Meshes in files",
        "A sheet of triangles with a seam in its texture coordinates, and one normal, is written and read \
         from memory on one thread. To read it is to parse it, to check every number, and to weld its \
         vertices. The last column counts the numbers at corners that come back with other bits: 0 is \
         right.",
    );
    let mut table = Table::new(
        "files",
        "Time to read",
        &[
            ("format", "format"),
            ("faces", "faces"),
            ("MB", "megabytes"),
            ("time, s", "minimum_seconds"),
            ("median, s", "median_seconds"),
            ("MB/s", "megabytes_per_second"),
            ("samples", "samples"),
            ("numbers off", "numbers_off"),
        ],
    );
    let model = sheet(bench.effort.choose(SIDES[0], SIDES[1]));
    let sheet = &model.geometries[0];
    let folder = Folder::new("").map_err(FitError::operation)?;
    for (name, kind, bytes) in files(&model).map_err(FitError::operation)? {
        let options = MeshOptions::default();
        let read = || {
            read_model_bytes(&bytes, kind, &folder, "mesh", options).map_err(FitError::operation)
        };
        let reader = Contestant::new(bench.one(), || read().map(drop));
        let timing = interleaved(&mut [reader], bench.effort, USUAL).into_iter().collect();
        let timing: Result<Vec<_>, FitError> = timing;
        let Some((timings, back)) = study.noted(name, timing.and_then(|all| Ok((all, read()?))))
        else {
            continue;
        };
        let (timing, megabytes) = (timings[0], 1e-6 * bytes.len() as f64);
        table.push(vec![
            Cell::text(name),
            Cell::Count(sheet.faces.len()),
            Cell::number(megabytes),
            Cell::timed(&timing, timing.minimum),
            Cell::timed(&timing, timing.median),
            Cell::timed(&timing, megabytes / timing.minimum),
            Cell::Count(timing.samples),
            Cell::Count(numbers_off(sheet, &back.geometries[0])),
        ]);
    }
    study.tables.push(table);
    Ok(study)
}

/// A sheet of `side` x `side` quads whose coordinates jump in the middle.
fn sheet(side: u32) -> Model {
    let row = side + 1;
    // Dyadic numbers: v runs up in some formats, and 1 - (1 - v) is v for these.
    let corner = |k: u32| [k % row, k / row].map(|k| k as f32 / 1024.0);
    let count = row * row;
    let positions = (0..count).map(corner).map(|[x, y]| [x, y, (x * y).sin()]);
    let quads = (0..side * side).map(|k| k / side * row + k % side);
    let triangles = |k: u32| [[k, k + 1, k + row + 1], [k, k + row + 1, k + row]];
    let faces: Vec<[u32; 3]> = quads.flat_map(triangles).collect();
    let second = (0..count).map(|k| corner(k).map(|x| x + 2.0));
    let half = faces.len() / 2;
    let shifted = faces.iter().enumerate().map(|(at, face)| match at < half {
        true => *face,
        false => face.map(|k| k + count),
    });
    let coordinates =
        Indexed { faces: shifted.collect(), rows: (0..count).map(corner).chain(second).collect() };
    let normals = Indexed { rows: vec![[0.0, 0.0, 1.0]], faces: vec![[0; 3]; faces.len()] };
    let geometry = Geometry {
        name: String::new(),
        positions: positions.collect(),
        submeshes: vec![Submesh { material: None, faces: 0..faces.len() }],
        offset: DVec3::ZERO,
        faces,
        colors: None,
        coordinates: Some(coordinates),
        normals: Some(normals),
        tangents: None,
    };
    let placed = Placed { name: String::new(), geometry: 0, transform: DMat4::IDENTITY };
    Model { geometries: vec![geometry], placed: vec![placed], ..Model::default() }
}

/// The files of a model of one geometry.
fn files(model: &Model) -> Result<[File; 3], SceneError> {
    let sheet = &model.geometries[0];
    Ok([
        ("GLB", MeshKind::Gltf, glb(model)?),
        ("PLY, binary", MeshKind::Ply, ply(sheet, &[], |_| None)?),
        ("OBJ", MeshKind::Obj, obj(model, "sheet")?.obj.into_bytes()),
    ])
}

/// How many numbers at the corners of faces are others, or are in one geometry alone.
fn numbers_off(written: &Geometry, read: &Geometry) -> usize {
    let [written, read] = [corners(written), corners(read)];
    let both = written.iter().flatten().zip(read.iter().flatten());
    let off = both.filter(|(written, read)| written != read).count();
    off + 8 * written.len().abs_diff(read.len())
}

/// The bits of positions, coordinates and normals at all corners; those of 0 for what is missing.
fn corners(geometry: &Geometry) -> Vec<[u32; 8]> {
    fn rows<const N: usize>(indexed: &Option<Indexed<N>>, face: usize, k: usize) -> [f32; N] {
        let row = indexed.as_ref().map(|rows| rows.rows[rows.faces[face][k] as usize]);
        row.unwrap_or([0.0; N])
    }
    let corner = |at: usize| {
        let (face, k) = (at / 3, at % 3);
        let [x, y, z] = geometry.positions[geometry.faces[face][k] as usize];
        let [u, v] = rows(&geometry.coordinates, face, k);
        let [nx, ny, nz] = rows(&geometry.normals, face, k);
        [x, y, z, u, v, nx, ny, nz].map(f32::to_bits)
    };
    (0..3 * geometry.faces.len()).map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_hold_the_sheet_and_other_numbers_are_counted() {
        let model = sheet(3);
        let sheet = &model.geometries[0];
        assert_eq!((sheet.faces.len(), sheet.positions.len()), (18, 16));
        let folder = Folder::new("").unwrap();
        for (name, kind, bytes) in files(&model).unwrap() {
            let mut back =
                read_model_bytes(&bytes, kind, &folder, "mesh", MeshOptions::default()).unwrap();
            let back = &mut back.geometries[0];
            assert_eq!(numbers_off(sheet, back), 0, "{name}");
            // The first vertex is a corner of two faces.
            back.positions[0][1] = -0.0;
            assert_eq!(numbers_off(sheet, back), 2, "{name}");
            back.normals = None;
            assert_eq!(numbers_off(sheet, back), 2 + 54, "{name}");
        }
    }
}
