//! What is read of glTF files.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DMat4, DQuat, DVec3};
use serde_json::{Value, json};

use super::{at_corners, message, of_corners, only, read, read_with};
use crate::error::SceneError;
use crate::mesh::MeshKind::Gltf;
use crate::model::Model;

/// A file that is being built: one buffer, with a view and an accessor for each call.
#[derive(Debug)]
pub(super) struct File {
    pub(super) root: Value,
    pub(super) bytes: Vec<u8>,
}

impl File {
    /// A square with positions (0), coordinates (1) and indices (2), placed by one node.
    pub(super) fn square() -> Self {
        let mut file = Self {
            root: json!({
                "asset": {"version": "2.0"}, "buffers": [{}], "bufferViews": [], "accessors": [],
                "meshes": [{"primitives": [
                    {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}
                ]}],
                "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0
            }),
            bytes: Vec::new(),
        };
        file.floats(&SQUARE, "VEC3");
        file.floats(&[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]], "VEC2");
        let indices: Vec<u8> =
            [0_u16, 1, 2, 0, 2, 3].iter().flat_map(|k| k.to_le_bytes()).collect();
        file.accessor(&indices, 5123, "SCALAR", 6);
        file
    }

    /// Adds these bytes to the buffer, with a view and an accessor: the accessor's number.
    pub(super) fn accessor(
        &mut self,
        bytes: &[u8],
        component: u32,
        kind: &str,
        count: usize,
    ) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = self.list("bufferViews").len();
        let range = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.list("bufferViews").push(range);
        self.bytes.extend_from_slice(bytes);
        self.list("accessors").push(json!(
            {"bufferView": view, "componentType": component, "count": count, "type": kind}
        ));
        self.list("accessors").len() - 1
    }

    pub(super) fn floats<const N: usize>(&mut self, rows: &[[f32; N]], kind: &str) -> usize {
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        self.accessor(&bytes, 5126, kind, rows.len())
    }

    pub(super) fn list(&mut self, name: &str) -> &mut Vec<Value> {
        if self.root.get(name).is_none() {
            self.root[name] = json!([]);
        }
        self.root[name].as_array_mut().unwrap()
    }

    pub(super) fn primitive(&mut self) -> &mut Value {
        &mut self.root["meshes"][0]["primitives"][0]
    }

    /// The file as text, with its buffer in a URI.
    pub(super) fn text(&self) -> String {
        let mut root = self.root.clone();
        let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&self.bytes));
        root["buffers"][0] = json!({"byteLength": self.bytes.len(), "uri": uri});
        root.to_string()
    }

    /// The file as GLB.
    pub(super) fn binary(&self) -> Vec<u8> {
        let mut root = self.root.clone();
        root["buffers"][0] = json!({"byteLength": self.bytes.len()});
        let glb = gltf::Glb {
            header: gltf::binary::Header { magic: *b"glTF", version: 2, length: 0 },
            json: root.to_string().into_bytes().into(),
            bin: Some(self.bytes.clone().into()),
        };
        glb.to_vec().unwrap()
    }

    pub(super) fn read(&self) -> Result<Model, SceneError> {
        read(Gltf, self.text())
    }
}

/// What breaks a file.
pub(super) type Change = fn(&mut Value);

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

#[test]
fn buffers_are_chunks_uris_and_files() {
    let file = File::square();
    let expected = file.read().unwrap();
    let mesh = only(&expected);
    assert_eq!(mesh.positions, SQUARE);
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3]]);
    // v is down in the file and here.
    assert_eq!(of_corners(&mesh.coordinates)[..2], [[0.0, 1.0], [1.0, 1.0]]);
    assert!(expected.notes.is_empty(), "{:?}", expected.notes);
    assert_eq!(read(Gltf, file.binary()).unwrap(), expected);
    let mut root = file.root.clone();
    root["buffers"][0] = json!({"byteLength": file.bytes.len(), "uri": "sub%20folder/a.bin"});
    let folder = tempfile::tempdir().unwrap();
    let files: [(&str, &[u8]); 1] = [("sub folder/a.bin", &file.bytes)];
    assert_eq!(read_with(Gltf, root.to_string(), &files, folder.path()).unwrap(), expected);
    let missing = read(Gltf, root.to_string());
    assert!(matches!(missing, Err(SceneError::Read { .. })), "{missing:?}");
    root["buffers"][0]["uri"] = json!("../../../../../../../etc/passwd");
    let outside = read(Gltf, root.to_string());
    assert!(matches!(outside, Err(SceneError::Outside { .. })), "{outside:?}");
}

#[test]
fn strips_and_fans_are_triangles_that_run_the_same_way() {
    for (mode, indices, expected) in [
        (4, [0, 1, 2, 0, 2, 3], vec![[0, 1, 2], [0, 2, 3]]),
        (5, [1, 2, 0, 3, 3, 3], vec![[1, 2, 0], [2, 3, 0]]),
        (6, [0, 1, 2, 3, 3, 3], vec![[1, 2, 0], [2, 3, 0]]),
    ] {
        for component in [5121, 5123, 5125] {
            let mut file = File::square();
            let bytes = indices.iter().flat_map(|&index: &u32| match component {
                5121 => vec![index as u8],
                5123 => (index as u16).to_le_bytes().to_vec(),
                _ => index.to_le_bytes().to_vec(),
            });
            let count = if mode == 4 { 6 } else { 4 };
            let number = file.accessor(&bytes.collect::<Vec<u8>>(), component, "SCALAR", count);
            file.primitive()["indices"] = json!(number);
            file.primitive()["mode"] = json!(mode);
            let model = file.read().unwrap();
            let parsed = |faces: &[[u32; 3]]| at_corners(&SQUARE, faces);
            // The second face of the strip has its corners turned, and begins elsewhere.
            let corners = at_corners(&only(&model).positions, &only(&model).faces);
            for (found, expected) in corners.chunks(3).zip(parsed(&expected).chunks(3)) {
                let turned = (0..3).any(|k| (0..3).all(|j| found[j] == expected[(j + k) % 3]));
                assert!(turned, "mode {mode}: {found:?} {expected:?}");
            }
            assert_eq!(corners.len(), 6);
        }
    }
    let mut file = File::square();
    file.root["meshes"][0]["primitives"]
        .as_array_mut()
        .unwrap()
        .push(json!({"attributes": {"POSITION": 0}, "mode": 1}));
    assert_eq!(file.read().unwrap().notes, ["points and lines were left out"]);
}

#[test]
fn a_mesh_without_indices_has_a_corner_for_each_vertex() {
    let mut file = File::square();
    let corners = [SQUARE[0], SQUARE[1], SQUARE[2], SQUARE[0], SQUARE[2], SQUARE[3]];
    let number = file.floats(&corners, "VEC3");
    *file.primitive() = json!({"attributes": {"POSITION": number}});
    let model = file.read().unwrap();
    assert_eq!(only(&model).positions.len(), 4);
    assert_eq!(only(&model).faces, [[0, 1, 2], [0, 2, 3]]);
}

#[test]
fn colours_are_fractions_and_opacities_are_noted() {
    let parsed = |bytes: &[u8], component: u32, kind: &str| {
        let mut file = File::square();
        let number = file.accessor(bytes, component, kind, 4);
        file.primitive()["attributes"]["COLOR_0"] = json!(number);
        let model = file.read().unwrap();
        (of_corners(&only(&model).colors)[0], model.notes.len())
    };
    let floats: Vec<u8> =
        [0.5_f32, 0.25, 2.0].repeat(4).iter().flat_map(|x| x.to_le_bytes()).collect();
    assert_eq!(parsed(&floats, 5126, "VEC3"), ([0.5, 0.25, 2.0], 0));
    assert_eq!(parsed(&[255, 0, 51, 255].repeat(4), 5121, "VEC4"), ([1.0, 0.0, 0.2], 0));
    assert_eq!(parsed(&[255, 0, 51, 254].repeat(4), 5121, "VEC4"), ([1.0, 0.0, 0.2], 1));
    let wide: Vec<u8> =
        [65535_u16, 0, 13107].repeat(4).iter().flat_map(|x| x.to_le_bytes()).collect();
    assert_eq!(parsed(&wide, 5123, "VEC3"), ([1.0, 0.0, 0.2], 0));
}

#[test]
fn accessors_may_have_strides_offsets_integers_and_replaced_elements() {
    let mut file = File::square();
    // Positions of bytes with a stride of 4, after an offset of 8.
    let mut bytes = vec![99; 8];
    SQUARE.iter().for_each(|row| bytes.extend(row.map(|x| x as u8 * 127).into_iter().chain([99])));
    let number = file.accessor(&bytes, 5120, "VEC3", 4);
    file.list("bufferViews").last_mut().unwrap()["byteStride"] = json!(4);
    let accessor = file.list("accessors").last_mut().unwrap();
    accessor["byteOffset"] = json!(8);
    accessor["normalized"] = json!(true);
    file.primitive()["attributes"]["POSITION"] = json!(number);
    file.root["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    file.root["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    let model = file.read().unwrap();
    assert_eq!(only(&model).positions, SQUARE);
    assert!(model.notes.is_empty(), "{:?}", model.notes);

    // All zero but the elements 1 to 3.
    let mut file = File::square();
    let rows = [SQUARE[1], SQUARE[2], SQUARE[3]];
    let values = file.floats(&rows, "VEC3");
    let indices = file.accessor(&[1, 2, 3], 5121, "SCALAR", 3);
    let views = [indices, values].map(|k| file.root["accessors"][k]["bufferView"].clone());
    file.list("accessors").push(json!({
        "componentType": 5126, "count": 4, "type": "VEC3", "sparse": {
            "count": 3, "indices": {"bufferView": views[0], "componentType": 5121},
            "values": {"bufferView": views[1]}
        }
    }));
    let number = file.list("accessors").len() - 1;
    file.primitive()["attributes"]["POSITION"] = json!(number);
    assert_eq!(only(&file.read().unwrap()).positions, SQUARE);
}

#[test]
fn nodes_place_meshes_and_shared_accessors_are_one_geometry() {
    let mut file = File::square();
    let mesh = file.root["meshes"][0].clone();
    file.list("meshes").push(mesh);
    file.root["nodes"] = json!([
        {"children": [1, 2], "translation": [1, 2, 3], "rotation": [0, 0, 1, 1]},
        {"mesh": 0, "scale": [2, 3, 4], "name": "a"},
        {"mesh": 1, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]},
        {"mesh": 0, "name": "elsewhere"}
    ]);
    let model = file.read().unwrap();
    assert_eq!(only(&model).positions, SQUARE);
    let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let top = DMat4::from_rotation_translation(turn, DVec3::new(1.0, 2.0, 3.0));
    let expected = [
        top * DMat4::from_scale(DVec3::new(2.0, 3.0, 4.0)),
        top * DMat4::from_translation(DVec3::new(5.0, 6.0, 7.0)),
    ];
    assert_eq!(model.placed.len(), 2);
    for (placed, expected) in model.placed.iter().zip(expected) {
        assert!(placed.transform.abs_diff_eq(expected, 1e-7), "{placed:?}");
        assert_eq!(placed.geometry, 0);
    }
    assert_eq!(model.placed[0].name, "a");
    // Without a default scene the first is read, without scenes all nodes, and without nodes all meshes.
    file.root.as_object_mut().unwrap().remove("scene");
    let model = file.read().unwrap();
    assert_eq!(model.placed.len(), 2);
    let outside = "a mesh of a node outside the scene that is read was left out";
    assert_eq!(model.notes, [outside]);
    file.root["scenes"] = json!([{"nodes": [0]}, {"nodes": [3]}]);
    let model = file.read().unwrap();
    assert_eq!(model.placed.len(), 2);
    let first = "the file has 2 scenes, and none is the default one: the first was read";
    assert_eq!(model.notes, [first, outside]);
    file.root["scene"] = json!(1);
    let model = file.read().unwrap();
    assert_eq!(model.placed.iter().map(|placed| &*placed.name).collect::<Vec<_>>(), ["elsewhere"]);
    assert_eq!(model.notes, [format!("{outside} (2 times)")]);
    file.root.as_object_mut().unwrap().retain(|name, _| name != "scenes" && name != "scene");
    assert_eq!(file.read().unwrap().placed.len(), 3);
    file.root.as_object_mut().unwrap().remove("nodes");
    assert_eq!(file.read().unwrap().placed.len(), 1);
}

#[test]
fn a_scene_without_a_list_of_nodes_places_nothing() {
    let mut file = File::square();
    file.root["scenes"] = json!([{"name": "empty"}, {"nodes": [0]}]);
    let model = file.read().unwrap();
    assert_eq!((model.geometries.len(), model.placed.len()), (1, 0));
    let outside = "a mesh of a node outside the scene that is read was left out";
    assert_eq!(model.notes, [outside, "no node places a mesh"]);
    file.root["scene"] = json!(1);
    assert_eq!(file.read().unwrap().placed.len(), 1);
    // What else is wrong is still said.
    file.root["nodes"] = json!([{"mesh": "a"}]);
    let error = message(file.read());
    let rule = "a glTF file has the parts of the specification";
    let message = "a whole number, 0 or above, is needed here, and this is the text \"a\"";
    assert!(error.ends_with(&format!("{rule}: {message}")), "{error}");
}

#[test]
fn a_chain_of_many_nodes_is_walked() {
    let mut file = File::square();
    // Deeper than a thread's stack, were they walked by recursion.
    let count = 50_000;
    let mut nodes: Vec<Value> = (1..count).map(|k| json!({"children": [k]})).collect();
    nodes.push(json!({"mesh": 0}));
    file.root["nodes"] = json!(nodes);
    assert_eq!(file.read().unwrap().placed.len(), 1);
}

#[test]
fn errors_have_the_rule_and_what_broke_it() {
    let cases: [(Change, &str); 32] = [
        (|root| root["asset"]["version"] = json!("1.0"), "glTF of version 2 is read, and this is"),
        (|root| *root = json!({"asset": {"version": "1.1"}, "nodes": {}}), "of version 1.1"),
        (|root| root["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]), "\"KHR_draco"),
        (|root| root["nodes"] = json!([{"children": [0]}]), "a node is not below itself"),
        (|root| root["nodes"] = json!([{"children": [1]}, {"children": [0]}]), "not below itself"),
        (
            |root| root["nodes"] = json!([{"children": [2]}, {"children": [2]}, {}]),
            "one node at most",
        ),
        (
            |root| root["nodes"] = json!([{"children": [7]}]),
            "has 1 nodes, and node 0 names child 7",
        ),
        (|root| root["nodes"][0]["mesh"] = json!(3), "has 1 meshes, and node 0 has 3"),
        (|root| root["nodes"][0]["scale"] = json!([1e38, 1e38, 1e39]), "glTF file has"),
        (|root| root["scene"] = json!(1), "has 1 scenes, and the default one is 1"),
        (|root| root["scenes"][0]["nodes"] = json!([1]), "has 1 nodes, and a scene names 1"),
        (|root| root["scenes"][0]["nodes"] = json!([0, 0]), "each once, and node 0"),
        (|root| primitive(root)["attributes"] = json!({}), "a primitive has positions"),
        (
            |root| primitive(root)["attributes"]["POSITION"] = json!(9),
            "3 accessors, and a mesh names 9",
        ),
        (
            |root| primitive(root)["attributes"]["POSITION"] = json!(1),
            "has [3] numbers, and these have 2",
        ),
        (
            |root| primitive(root)["attributes"]["NORMAL"] = json!(2),
            "has [3] numbers, and these have 1",
        ),
        (|root| primitive(root)["indices"] = json!(0), "an index is an unsigned integer"),
        (|root| primitive(root)["mode"] = json!(7), "its mode is one of the specification"),
        (|root| primitive(root)["material"] = json!(0), "the file has 0 materials"),
        (|root| root["accessors"][0]["count"] = json!(3), "as many coordinates as positions, 3"),
        (|root| root["accessors"][2]["count"] = json!(5), "three corners, and here are 5"),
        (|root| root["accessors"][0]["count"] = json!(u64::MAX), "fewer elements than 2^32 - 1"),
        (|root| root["accessors"][0]["count"] = json!(4_000_000_000_u32), "as many bytes or more"),
        (
            |root| root["accessors"][0]["byteOffset"] = json!(4),
            "elements lie in 48 bytes of a view",
        ),
        (|root| root["accessors"][0]["byteOffset"] = json!(u64::MAX), "elements lie in 48 bytes"),
        (|root| root["accessors"][0]["componentType"] = json!(5124), "its types are those"),
        (|root| root["accessors"][0]["type"] = json!("MAT3"), "and these are Mat3"),
        (|root| root["bufferViews"][0]["byteLength"] = json!(u64::MAX), "a buffer view has bytes"),
        (|root| root["bufferViews"][0]["byteStride"] = json!(4), "the next begins after 4"),
        (|root| root["bufferViews"][0]["buffer"] = json!(1), "has 1 buffers, and a view names 1"),
        (
            |root| root["accessors"][0]["bufferView"] = json!(8),
            "has 3 buffer views, and one names 8",
        ),
        (|root| root["meshes"] = json!({}), "mesh:1:"),
    ];
    for (change, expected) in cases {
        let mut file = File::square();
        change(&mut file.root);
        let text = match file.root.get("buffers") {
            Some(_) => file.text(),
            None => file.root.to_string(),
        };
        let error = message(read(Gltf, text));
        assert!(error.contains(expected), "{expected}: {error}");
    }
    let mut file = File::square();
    file.bytes[80] = 4;
    let found = message(file.read());
    let expected = "mesh 0, primitive 0: an index is below the number of positions, 4, and index";
    assert!(found.contains(expected), "{found}");
    let mut file = File::square();
    file.bytes[4..8].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(message(file.read()).contains("mesh 0: positions are finite, and vertex 0 is"));
    let mut root = File::square().root;
    root["buffers"][0] = json!({"byteLength": 9, "uri": "data:,a"});
    assert!(message(read(Gltf, root.to_string())).contains("buffer 0 has 1 of 9"));
    root["buffers"][0] = json!({"byteLength": 9});
    assert!(message(read(Gltf, root.to_string())).contains("buffer 0 has neither"));
}

fn primitive(root: &mut Value) -> &mut Value {
    &mut root["meshes"][0]["primitives"][0]
}
