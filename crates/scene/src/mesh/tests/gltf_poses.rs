//! Morph targets and skins of glTF files.

use glam::{DMat4, DVec3};
use serde_json::json;

use super::gltf::{Change, File};
use super::{message, of_corners, only};
use crate::model::Geometry;

/// A square with a target that lifts it by 5 and leans its normals, and one that moves it by 3 along x.
fn with_targets() -> File {
    let mut file = File::square();
    let normals = file.floats(&[[0.0, 0.0, 1.0]; 4], "VEC3");
    let lift = file.floats(&[[0.0, 0.0, 5.0]; 4], "VEC3");
    let lean = file.floats(&[[0.75, 0.0, 0.0]; 4], "VEC3");
    let push = file.floats(&[[3.0, 0.0, 0.0]; 4], "VEC3");
    file.primitive()["attributes"]["NORMAL"] = json!(normals);
    file.primitive()["targets"] = json!([{"POSITION": lift, "NORMAL": lean}, {"POSITION": push}]);
    file
}

/// The places of the first vertex.
fn first(geometry: &Geometry) -> [f32; 3] {
    geometry.positions[0]
}

const LEFT_OUT: &str = "a morph target without a weight was left out";

#[test]
fn morph_targets_have_the_weights_of_the_file() {
    let mut file = with_targets();
    let model = file.read().unwrap();
    assert_eq!(first(only(&model)), [0.0; 3]);
    assert_eq!(model.notes, [format!("{LEFT_OUT} (2 times)")]);

    file.root["meshes"][0]["weights"] = json!([1, 0]);
    let model = file.read().unwrap();
    assert_eq!(first(only(&model)), [0.0, 0.0, 5.0]);
    assert_eq!(of_corners(&only(&model).normals)[0], [0.6, 0.0, 0.8]);
    let applied = "1 of 2 morph targets were applied, with the weights of the file";
    assert_eq!(model.notes, [applied, LEFT_OUT]);

    // Those of a node come before.
    file.root["nodes"] = json!([
        {"mesh": 0, "weights": [0.5, -1]}, {"mesh": 0}, {"mesh": 0, "weights": [0.5, -1]},
        {"mesh": 0, "weights": [0, 0]}
    ]);
    file.root["scenes"][0]["nodes"] = json!([0, 1, 2, 3]);
    let model = file.read().unwrap();
    let places: Vec<_> = model.geometries.iter().map(first).collect();
    assert_eq!(places, [[-3.0, 0.0, 2.5], [0.0, 0.0, 5.0], [0.0; 3]]);
    let placed: Vec<_> = model.placed.iter().map(|placed| placed.geometry).collect();
    assert_eq!(placed, [0, 1, 0, 2]);
}

#[test]
fn what_does_not_fit_a_morph_target_is_noted_or_refused() {
    let mut file = with_targets();
    file.root["meshes"][0]["weights"] = json!([1, 1, 1]);
    file.primitive()["attributes"].as_object_mut().unwrap().remove("NORMAL");
    let model = file.read().unwrap();
    assert_eq!(first(only(&model)), [3.0, 0.0, 5.0]);
    assert_eq!(
        model.notes,
        [
            "2 of 2 morph targets were applied, with the weights of the file",
            "weights without a morph target were left out",
            "what a morph target does to an attribute that a mesh lacks was left out",
        ]
    );
    let short = file.floats(&[[0.0; 3]; 3], "VEC3");
    file.primitive()["targets"][0]["POSITION"] = json!(short);
    let rule =
        "mesh 0, primitive 0: a morph target has a row for each of 4 vertices, and this has 3";
    assert!(message(file.read()).contains(rule));
}

/// A square that one of two joints moves: the first by 7 along z and thrice as large. The node that shows it
/// stands elsewhere.
fn with_skin() -> File {
    let mut file = File::square();
    let joints = file.accessor(&[0, 1, 0, 0].repeat(4), 5121, "VEC4", 4);
    let weights = file.floats(&[[1.0, 0.0, 0.0, 0.0]; 4], "VEC4");
    let normals = file.floats(&[[0.0, 0.6, 0.8]; 4], "VEC3");
    file.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    file.primitive()["attributes"]["WEIGHTS_0"] = json!(weights);
    file.primitive()["attributes"]["NORMAL"] = json!(normals);
    file.root["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [100, 0, 0], "scale": [0.01, 0.01, 0.01]},
        {"children": [2], "translation": [0, 0, 7]}, {"scale": [3, 3, 3]},
        {"translation": [0, 10, 0], "scale": [1, 1, 2]}
    ]);
    file.root["scenes"] = json!([{"nodes": [0, 1, 3]}]);
    file.root["skins"] = json!([{"joints": [2, 3]}, {"joints": [3, 3]}]);
    file
}

/// Sets the weights of all vertices.
fn set_weights(file: &mut File, weights: [f32; 4]) {
    let number = file.floats(&[weights; 4], "VEC4");
    file.primitive()["attributes"]["WEIGHTS_0"] = json!(number);
}

#[test]
fn a_skinned_mesh_stands_where_its_joints_put_it() {
    let mut file = with_skin();
    let model = file.read().unwrap();
    assert_eq!(
        only(&model).positions,
        [[0.0, 0.0, 7.0], [3.0, 0.0, 7.0], [3.0, 3.0, 7.0], [0.0, 3.0, 7.0]]
    );
    assert_eq!(model.placed.len(), 1);
    assert_eq!(model.placed[0].transform, DMat4::IDENTITY);
    assert!(model.notes.is_empty(), "{:?}", model.notes);
    // Bytes that do not say that they are fractions, and a target below the skin.
    let weights = file.accessor(&[102, 153, 0, 0].repeat(4), 5121, "VEC4", 4);
    file.primitive()["attributes"]["WEIGHTS_0"] = json!(weights);
    let lift = file.floats(&[[0.0, 0.0, 1.0]; 4], "VEC3");
    file.primitive()["targets"] = json!([{"POSITION": lift}]);
    file.root["meshes"][0]["weights"] = json!([1]);
    let model = file.read().unwrap();
    let place = DVec3::from_array(only(&model).positions[1].map(f64::from));
    let expected = 0.4 * DVec3::new(3.0, 0.0, 10.0) + 0.6 * DVec3::new(1.0, 10.0, 2.0);
    assert!(place.abs_diff_eq(expected, 1e-6), "{place}");
    // Another skin is another geometry, the same one is not.
    let (same, other) = (file.root["nodes"][0].clone(), json!({"mesh": 0, "skin": 1}));
    file.root["nodes"].as_array_mut().unwrap().extend([same, other, json!({"mesh": 0})]);
    file.root["scenes"][0]["nodes"] = json!([0, 1, 3, 4, 5, 6]);
    let model = file.read().unwrap();
    let placed: Vec<_> = model.placed.iter().map(|placed| placed.geometry).collect();
    assert_eq!(placed, [0, 0, 1, 2]);
    assert_eq!(first(&model.geometries[1]), [0.0, 10.0, 2.0]);
    assert_eq!(first(&model.geometries[2]), [0.0, 0.0, 1.0]);
    assert!(model.notes.iter().any(|note| note.starts_with("joints were left out: no node")));
}

#[test]
fn joints_and_weights_may_be_replaced_in_places() {
    let mut file = with_skin();
    // All zero but that of vertex 2.
    let mut sparse = |kind: u32, value: usize| {
        let index = file.accessor(&[2], 5121, "SCALAR", 1);
        let [indices, values] =
            [index, value].map(|k| file.root["accessors"][k]["bufferView"].clone());
        file.list("accessors").push(json!({
            "componentType": kind, "count": 4, "type": "VEC4", "sparse": {
                "count": 1, "indices": {"bufferView": indices, "componentType": 5121},
                "values": {"bufferView": values}
            }
        }));
        file.list("accessors").len() - 1
    };
    let joints = sparse(5121, 3);
    let weights = sparse(5126, 4);
    // The bytes of accessor 3 begin with joint 0 and joint 1.
    file.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    file.primitive()["attributes"]["WEIGHTS_0"] = json!(weights);
    let second = file.floats(&[[0.0, 1.0, 0.0, 0.0]; 4], "VEC4");
    file.root["accessors"][weights]["bufferView"] =
        file.root["accessors"][second]["bufferView"].clone();
    let places = only(&file.read().unwrap()).positions.clone();
    // Joint 0 where nothing is replaced, for there the second number is joint 0, too.
    assert_eq!(places[1], [3.0, 0.0, 7.0]);
    assert_eq!(places[2], [3.0, 3.0, 7.0]);
    let values = file.root["accessors"][second]["bufferView"].clone();
    file.root["accessors"][weights]["sparse"]["values"]["bufferView"] = values;
    assert_eq!(only(&file.read().unwrap()).positions[2], [1.0, 11.0, 0.0]);
}

#[test]
fn inverse_bind_matrices_come_before_the_joints() {
    let mut file = with_skin();
    let matrices = [DVec3::new(-1.0, 0.0, 0.0), DVec3::ZERO].map(DMat4::from_translation);
    let rows = matrices.map(|matrix| matrix.to_cols_array().map(|number| number as f32));
    let number = file.floats(&rows, "MAT4");
    file.root["skins"][0]["inverseBindMatrices"] = json!(number);
    assert_eq!(first(only(&file.read().unwrap())), [-3.0, 0.0, 7.0]);
}

#[test]
fn normals_of_a_skin_go_by_the_inverse_transpose_and_mirrors_turn_faces() {
    let mut file = with_skin();
    set_weights(&mut file, [0.0, 1.0, 0.0, 0.0]);
    let found = of_corners(&only(&file.read().unwrap()).normals)[0];
    // (0, 0.6, 0.8) with z twice as long.
    let expected = DVec3::new(0.0, 0.6, 0.4).normalize().as_vec3().to_array();
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
    let faces = only(&file.read().unwrap()).faces.clone();
    file.root["nodes"][3]["scale"] = json!([-1, 1, 2]);
    let model = file.read().unwrap();
    let turned: Vec<_> = faces.iter().map(|&[a, b, c]| [a, c, b]).collect();
    assert_eq!(only(&model).faces, turned);
    assert_eq!(only(&model).positions[1], [-1.0, 10.0, 0.0]);
    let mirrored = of_corners(&only(&model).normals)[0];
    assert_eq!(mirrored, found, "the mirror is along x");
}

#[test]
fn tangents_are_read_and_moved_by_poses() {
    let mut file = with_skin();
    let tangents = file.floats(&[[0.0, 0.0, 2.0, -1.0]; 4], "VEC4");
    file.primitive()["attributes"]["TANGENT"] = json!(tangents);
    let found = |file: &File| of_corners(&only(&file.read().unwrap()).tangents)[0];
    assert_eq!(found(&file), [0.0, 0.0, 1.0, -1.0]);
    let lean = file.floats(&[[0.0, 1.5, 0.0]; 4], "VEC3");
    file.primitive()["targets"] = json!([{"TANGENT": lean}]);
    file.root["meshes"][0]["weights"] = json!([1]);
    assert_eq!(found(&file), [0.0, 0.6, 0.8, -1.0]);
    // The other joint has z twice as long, and then y mirrored.
    set_weights(&mut file, [0.0, 1.0, 0.0, 0.0]);
    let long = DVec3::new(0.0, 1.5, 4.0).normalize().as_vec3();
    let near = |found: [f32; 4], expected: [f32; 4]| {
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{found:?}");
    };
    near(found(&file), [0.0, long.y, long.z, -1.0]);
    file.root["nodes"][3]["scale"] = json!([1, -1, 2]);
    near(found(&file), [0.0, -long.y, long.z, 1.0]);
    // The format has no tangents without normals.
    file.primitive()["attributes"].as_object_mut().unwrap().remove("NORMAL");
    let model = file.read().unwrap();
    assert!(only(&model).tangents.is_none());
    assert!(model.notes.iter().any(|note| note.contains("tangents of a mesh without normals")));
}

#[test]
fn weights_sum_to_1_or_are_divided_by_their_sum() {
    let mut file = with_skin();
    set_weights(&mut file, [0.5, 0.0, 0.0, 0.0]);
    let model = file.read().unwrap();
    assert_eq!(first(only(&model)), [0.0, 0.0, 7.0]);
    let note =
        "a vertex's weights of joints did not sum to 1, and were divided by their sum (4 times)";
    assert_eq!(model.notes, [note]);
    set_weights(&mut file, [0.0; 4]);
    let model = file.read().unwrap();
    assert_eq!(first(only(&model)), [0.0, 0.0, 7.0]);
    assert_eq!(
        model.notes,
        ["a vertex without a weight of a joint goes with its first joint (4 times)"]
    );
    // A second set counts as the first.
    let joints = file.accessor(&[1, 0, 0, 0].repeat(4), 5121, "VEC4", 4);
    let weights = file.floats(&[[0.5, 0.5, 0.0, 0.0]; 4], "VEC4");
    file.primitive()["attributes"]["JOINTS_1"] = json!(joints);
    file.primitive()["attributes"]["WEIGHTS_1"] = json!(weights);
    assert_eq!(first(only(&file.read().unwrap())), [0.0, 5.0, 3.5]);
}

#[test]
fn broken_skins_are_refused_with_the_rule() {
    let cases: [(Change, &str); 11] = [
        (|root| root["nodes"][0]["skin"] = json!(2), "has 2 skins, and a node names 2"),
        (|root| root["skins"][0]["joints"] = json!([]), "a joint or more, and skin 0 has none"),
        (|root| root["skins"][0]["joints"] = json!([9]), "4 nodes, and skin 0 has the joint 9"),
        (
            |root| root["skins"][0]["inverseBindMatrices"] = json!(0),
            "an element has [16] numbers, and these have 3",
        ),
        (
            |root| root["skins"][0]["joints"] = json!([2]),
            "skin 0: it has 1 joints, and vertex 0 names joint 1",
        ),
        (
            |root| [1, 2].iter().for_each(|&k| root["nodes"][k]["scale"] = json!([1e38, 1, 1])),
            "positions are finite",
        ),
        (
            |root| drop(attributes(root).remove("WEIGHTS_0")),
            "has joints and weights, and this lacks WEIGHTS_0",
        ),
        (
            |root| drop(attributes(root).remove("JOINTS_0")),
            "has joints and weights, and this lacks JOINTS_0",
        ),
        (
            |root| drop(attributes(root).insert("JOINTS_0".to_owned(), json!(4))),
            "joints are four unsigned integers, and these are F32 with 4 numbers",
        ),
        (
            |root| drop(attributes(root).insert("WEIGHTS_0".to_owned(), json!(7))),
            "a weight is finite and not below 0, and one of vertex 0 is -0.5",
        ),
        (
            |root| root["accessors"][3]["count"] = json!(3),
            "there are as many joints as positions, 4, and these are 3",
        ),
    ];
    for (change, expected) in cases {
        let mut file = with_skin();
        set_weights(&mut file, [0.5, 0.5, 0.0, 0.0]);
        file.floats(&[[-0.5, 1.5, 0.0, 0.0]; 4], "VEC4");
        change(&mut file.root);
        let error = message(file.read());
        assert!(error.contains(expected), "{expected}: {error}");
    }
}

fn attributes(root: &mut serde_json::Value) -> &mut serde_json::Map<String, serde_json::Value> {
    root["meshes"][0]["primitives"][0]["attributes"].as_object_mut().unwrap()
}
