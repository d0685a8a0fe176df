//! What welding keeps, merges and leaves out.

use std::borrow::Cow;

use super::{at_corners, of_corners};
use crate::error::{Location, SceneError};
use crate::mesh::notes::Notes;
use crate::mesh::weld::{Corners, Raw, Welder, same_keys};
use crate::model::{Geometry, NO_ROW, Submesh};

/// Positions and faces, without attributes.
fn bare<'a>(rows: &'a [[f32; 3]], faces: &[[u32; 3]]) -> Raw<'a> {
    Raw {
        name: String::new(),
        submeshes: vec![Submesh { material: None, faces: 0..faces.len() }],
        is_welded: true,
        positions: Corners { rows, faces: Cow::Owned(faces.to_vec()) },
        colors: None,
        coordinates: None,
        normals: None,
        tangents: None,
    }
}

fn welded(raw: Raw<'_>) -> (Result<Option<Geometry>, SceneError>, Vec<String>) {
    let mut notes = Notes::default();
    let found = Welder::default().weld(raw, &Location::new("mesh"), &mut notes);
    (found, notes.finish())
}

const A: [f32; 3] = [0.0, 0.0, 0.0];
const B: [f32; 3] = [1.0, 0.0, 0.0];
const C: [f32; 3] = [0.0, 1.0, 0.0];
const D: [f32; 3] = [1.0, 1.0, 0.0];

#[test]
fn vertices_in_one_place_are_one_in_the_order_of_the_file() {
    // The last two faces are those of a seam; the vertex in the middle has no face.
    let rows = [D, [9.0; 3], A, B, C, B, C];
    let (found, notes) = welded(bare(&rows, &[[2, 3, 4], [6, 5, 0]]));
    let geometry = found.unwrap().unwrap();
    assert_eq!(geometry.positions, [D, A, B, C]);
    assert_eq!(geometry.faces, [[1, 2, 3], [3, 2, 0]]);
    assert!(notes.is_empty(), "{notes:?}");
}

#[test]
fn where_places_are_not_welded_vertices_are_those_of_the_file() {
    let rows = [D, [9.0; 3], A, B, C, B, C];
    let raw = Raw { is_welded: false, ..bare(&rows, &[[2, 3, 4], [6, 5, 0]]) };
    let (found, notes) = welded(raw);
    let geometry = found.unwrap().unwrap();
    assert_eq!(geometry.positions, [D, A, B, C, B, C]);
    assert_eq!(geometry.faces, [[1, 2, 3], [5, 4, 0]]);
    let expected = "a vertex lies where another one does, and is not joined with it (2 times)";
    assert_eq!(notes, [expected]);
}

#[test]
fn submeshes_keep_their_faces_and_lose_bad_attributes_alone() {
    let rows = [A, B, C, D];
    let faces = [[0, 1, 2], [0, 0, 1], [1, 3, 2], [0, 1, 3], [2, 2, 3]];
    let normals = [[0.0, 0.0, 1.0], [0.0; 3], [1.0, 0.0, 0.0]];
    let mut raw = bare(&rows, &faces);
    let submesh = |material, faces| Submesh { material: Some(material), faces };
    raw.submeshes = vec![submesh(3, 0..1), submesh(2, 1..2), submesh(1, 2..3), submesh(0, 3..5)];
    let named = vec![[2, 0, 2], [0; 3], [0, 1, 0], [NO_ROW; 3], [NO_ROW; 3]];
    raw.normals = Some(Corners { rows: &normals, faces: Cow::Owned(named) });
    let (found, notes) = welded(raw);
    let geometry = found.unwrap().unwrap();
    assert_eq!(geometry.submeshes, [submesh(3, 0..1), submesh(1, 1..2), submesh(0, 2..3)]);
    let indexed = geometry.normals.unwrap();
    assert_eq!(indexed.rows, [normals[2], normals[0]]);
    assert_eq!(indexed.faces, [[0, 1, 0], [NO_ROW; 3], [NO_ROW; 3]]);
    assert_eq!(notes.len(), 2, "{notes:?}");
}

#[test]
fn zeros_of_both_signs_are_one_place() {
    let rows = [[-0.0, 0.0, -0.0], B, C, [0.0; 3], D, B];
    let (found, _) = welded(bare(&rows, &[[0, 1, 2], [3, 4, 5]]));
    let geometry = found.unwrap().unwrap();
    assert_eq!(geometry.faces, [[0, 1, 2], [0, 3, 1]]);
    assert!(geometry.positions[0].iter().all(|x| x.is_sign_positive()));
}

#[test]
fn attributes_are_numbered_by_the_corners_and_keep_seams() {
    let rows = [A, B, C, D];
    let coordinates = [[5.0, 5.0], [0.5, 0.0], [0.0, 0.0], [0.5, 0.0], [1.0, 1.0]];
    let faces = [[0, 1, 2], [1, 3, 2]];
    let mut raw = bare(&rows, &faces);
    // Rows 1 and 3 are the same; row 0 is at no corner.
    let named = vec![[2, 1, 4], [3, 4, 2]];
    raw.coordinates = Some(Corners { rows: &coordinates, faces: Cow::Owned(named.clone()) });
    let geometry = welded(raw).0.unwrap().unwrap();
    let indexed = geometry.coordinates.as_ref().unwrap();
    assert_eq!(indexed.rows, [[0.0, 0.0], [0.5, 0.0], [1.0, 1.0]]);
    assert_eq!(indexed.faces, [[0, 1, 2], [1, 2, 0]]);
    assert_eq!(of_corners(&geometry.coordinates), at_corners(&coordinates, &named));
}

#[test]
fn faces_that_name_a_vertex_twice_are_left_out_with_their_attributes() {
    let rows = [A, B, C, A];
    let colors = [[0.1; 3], [0.2; 3], [0.3; 3]];
    let mut raw = bare(&rows, &[[0, 1, 3], [0, 1, 2], [1, 1, 2]]);
    let faces = Cow::Owned(vec![[0, 0, 0], [2, 1, 0], [1, 1, 1]]);
    raw.colors = Some(Corners { rows: &colors, faces });
    let (found, notes) = welded(raw);
    let geometry = found.unwrap().unwrap();
    assert_eq!(geometry.faces, [[0, 1, 2]]);
    assert_eq!(of_corners(&geometry.colors), [[0.3; 3], [0.2; 3], [0.1; 3]]);
    assert_eq!(notes, ["a face that names a vertex twice was left out (2 times)"]);
    let (found, _) = welded(bare(&rows, &[[0, 1, 3]]));
    assert!(found.unwrap().is_none());
}

#[test]
fn a_position_that_is_not_finite_is_refused_by_its_number() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let rows = [[bad; 3], A, B, C, [0.0, bad, 0.0]];
        assert!(welded(bare(&rows, &[[1, 2, 3]])).0.is_ok());
        let error = welded(bare(&rows, &[[1, 2, 3], [3, 2, 4]])).0.unwrap_err().to_string();
        assert!(error.contains("vertex 4"), "{error}");
    }
}

#[test]
fn normals_become_unit_vectors_and_bad_attributes_are_left_out() {
    let rows = [A, B, C];
    let parsed = |normals: [[f32; 3]; 3]| {
        let mut raw = bare(&rows, &[[0, 1, 2]]);
        raw.normals = Some(Corners { rows: &normals, faces: Cow::Borrowed(&[[0, 1, 2]]) });
        let (found, notes) = welded(raw);
        (found.unwrap().unwrap().normals, notes)
    };
    let (normals, _) = parsed([[0.0, 0.0, 2.0], [0.0, 0.0, 1.0], [3.0, 0.0, 4.0]]);
    assert_eq!(normals.unwrap().rows, [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]);
    for bad in [[0.0; 3], [f32::NAN; 3], [f32::INFINITY, 0.0, 0.0]] {
        let (normals, notes) = parsed([[0.0, 0.0, 1.0], bad, [1.0, 0.0, 0.0]]);
        assert!(normals.is_none(), "{bad:?}");
        assert!(notes[0].contains("normals were left out"), "{notes:?}");
    }
}

#[test]
fn a_welder_forgets_the_mesh_before() {
    let rows = [A, B, C, D];
    let mut welder = Welder::default();
    for faces in [[[0, 1, 2]], [[3, 2, 1]], [[0, 3, 1]]] {
        let mut notes = Notes::default();
        let found = welder.weld(bare(&rows, &faces), &Location::new("mesh"), &mut notes);
        let geometry = found.unwrap().unwrap();
        assert_eq!(at_corners(&geometry.positions, &geometry.faces), at_corners(&rows, &faces));
        assert_eq!(geometry.positions.len(), 3);
    }
}

#[test]
fn the_first_of_equal_keys_is_found() {
    let keys: Vec<[u32; 2]> = (0..5000_u32).map(|k| [k * k % 97, k % 3]).collect();
    let found = same_keys(keys.len(), |number| keys[number]);
    for (number, &first) in found.iter().enumerate() {
        let expected = keys.iter().position(|key| *key == keys[number]).unwrap();
        assert_eq!(first as usize, expected);
    }
    assert!(same_keys(0, |_| [0; 1]).is_empty());
}
