//! Laws of what glTF files say: it is read, or a note names it, or the file is refused.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Map, Value, json};

use super::gltf::File;
use crate::error::Location;
use crate::model::Model;
use crate::picture::{Picture, Samples};

fn png(byte: u8) -> Vec<u8> {
    let samples = Samples::U8(vec![byte; 3]);
    let picture = Picture { width: 1, height: 1, channels: 3, samples };
    picture.encode_png(&Location::new("image")).unwrap()
}

/// A file in which every part of the specification says something.
fn rich() -> File {
    let mut file = File::square();
    // Positions of bytes, with offsets and a stride.
    let mut bytes = vec![99; 8];
    for row in [[0, 0, 0], [127, 0, 0], [127, 127, 0], [0, 127, 0]] {
        bytes.extend(row.into_iter().chain([99]));
    }
    let positions = file.accessor(&bytes, 5120, "VEC3", 4);
    file.list("bufferViews").last_mut().unwrap()["byteStride"] = json!(4);
    file.list("bufferViews").last_mut().unwrap()["target"] = json!(34962);
    file.list("bufferViews").last_mut().unwrap()["name"] = json!("view");
    let accessor = file.list("accessors").last_mut().unwrap();
    accessor["byteOffset"] = json!(8);
    accessor["normalized"] = json!(true);
    (accessor["min"], accessor["max"]) = (json!([0, 0, 0]), json!([127, 127, 0]));
    accessor["name"] = json!("accessor");
    let normals = file.floats(&[[0.0, 0.6, 0.8]; 4], "VEC3");
    let tangents = file.floats(&[[1.0, 0.0, 0.0, 1.0]; 4], "VEC4");
    let colors = file.floats(&[[0.5, 0.25, 1.0]; 4], "VEC3");
    let second = file.floats(&[[0.0, 0.5], [0.5, 0.5], [0.5, 0.0], [0.0, 0.25]], "VEC2");
    let joints = file.accessor(&[1, 0, 0, 0].repeat(4), 5121, "VEC4", 4);
    let weights = file.floats(&[[0.25, 0.75, 0.0, 0.0]; 4], "VEC4");
    let matrix = glam::Mat4::from_translation(glam::Vec3::X).to_cols_array();
    let matrices = file.floats(&[matrix, matrix], "MAT4");
    // A target that moves one vertex, after offsets of the sparse parts.
    let moves = file.floats(&[[0.0; 3], [0.0, 0.0, 5.0]], "VEC3");
    let indices = file.accessor(&[9, 9, 9, 9, 2], 5121, "SCALAR", 1);
    let [indices, values] =
        [indices, moves].map(|k| file.root["accessors"][k]["bufferView"].clone());
    let last = file.list("accessors").len() - 2;
    file.list("accessors").truncate(last);
    file.list("accessors").push(json!({
        "componentType": 5126, "count": 4, "type": "VEC3", "bufferView": 3, "sparse": {
            "count": 1,
            "indices": {"bufferView": indices, "byteOffset": 4, "componentType": 5121},
            "values": {"bufferView": values, "byteOffset": 12}
        }
    }));
    let target = file.list("accessors").len() - 1;
    // Its other rows are those of the normals.
    file.root["accessors"][target]["bufferView"] =
        file.root["accessors"][normals]["bufferView"].clone();
    let lean = file.floats(&[[0.0, 0.5, 0.0]; 4], "VEC3");
    let image = file.bytes.len().next_multiple_of(4);
    file.bytes.resize(image, 0);
    file.bytes.extend(png(7));
    let length = file.bytes.len() - image;
    file.list("bufferViews").push(json!({"buffer": 0, "byteOffset": image, "byteLength": length}));
    let view = file.list("bufferViews").len() - 1;
    let uri = format!("data:image/png;base64,{}", STANDARD.encode(png(8)));
    let transform = json!({"KHR_texture_transform": {
        "offset": [0.5, 0.25], "scale": [2, 4], "rotation": 1, "texCoord": 1
    }});
    let root = json!({
        "asset": {"version": "2.0", "minVersion": "2.0", "generator": "g", "copyright": "c"},
        "extensionsUsed": ["KHR_texture_transform"],
        "extensionsRequired": ["KHR_texture_transform"],
        "images": [
            {"bufferView": view, "mimeType": "image/png", "name": "image"},
            {"uri": uri}
        ],
        "samplers": [{
            "wrapS": 33071, "wrapT": 33648, "name": "sampler"
        }, {"magFilter": 9728}, {"minFilter": 9728}],
        "textures": [
            {"source": 1, "sampler": 0, "name": "texture"}, {"source": 0, "sampler": 1},
            {"source": 1, "sampler": 2}
        ],
        "materials": [{
            "name": "material", "alphaMode": "MASK", "alphaCutoff": 0.25, "doubleSided": true,
            "emissiveFactor": [1, 0, 0], "emissiveTexture": {"index": 0},
            "occlusionTexture": {"index": 0, "strength": 0.5},
            "normalTexture": {"index": 1, "scale": 0.5, "extensions": transform},
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 0.25, 1.0, 0.75], "metallicFactor": 0.125,
                "roughnessFactor": 0.375,
                "baseColorTexture": {"index": 0, "extensions": transform},
                "metallicRoughnessTexture": {"index": 2, "extensions": transform}
            }
        }, {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}
        }],
        "meshes": [
            {"name": "mesh", "weights": [0.5], "primitives": [{
                "attributes": {
                    "POSITION": positions, "NORMAL": normals, "TANGENT": tangents,
                    "COLOR_0": colors, "TEXCOORD_0": 1, "TEXCOORD_1": second,
                    "JOINTS_0": joints, "WEIGHTS_0": weights
                },
                "indices": 2, "material": 0, "mode": 5,
                "targets": [{"POSITION": target, "NORMAL": lean, "TANGENT": lean}]
            }]},
            {"primitives": [{
                "attributes": {"POSITION": 0, "TEXCOORD_1": second}, "indices": 2, "material": 1,
                "targets": [{"POSITION": target}]
            }, {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}]}
        ],
        "nodes": [
            {"mesh": 0, "skin": 0, "name": "node"},
            {"children": [2], "translation": [0, 0, 7], "rotation": [0, 0, 0.6, 0.8]},
            {"scale": [3, 2, 1], "camera": 0},
            {"mesh": 1, "weights": [2], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1]},
            {"mesh": 1}
        ],
        "scenes": [{"nodes": [4]}, {"nodes": [0, 1, 3], "name": "scene"}], "scene": 1,
        "skins": [{
            "joints": [1, 2], "inverseBindMatrices": matrices, "skeleton": 1, "name": "skin"
        }],
        "animations": [{"channels": [], "samplers": []}],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}],
        "extras": {"a": 1}
    });
    for (key, value) in root.as_object().unwrap() {
        file.root[key] = value.clone();
    }
    file.root["buffers"][0] = json!({"name": "buffer"});
    // It is 0.
    file.root["bufferViews"][0].as_object_mut().unwrap().remove("byteOffset");
    file
}

/// What a text is read as, or what it is refused with.
fn found(file: &File) -> Result<Model, String> {
    file.read().map_err(|error| error.to_string())
}

/// The objects of a file by their paths, but what is inside of what a note names as a whole.
fn objects(value: &Value, path: &str, all: &mut Vec<String>) {
    const WHOLE: [&str; 5] =
        ["/extras", "/animations", "/cameras", "/occlusionTexture", "/emissiveTexture"];
    if WHOLE.iter().any(|end| path.ends_with(end)) {
        return;
    }
    match value {
        Value::Object(map) => {
            all.push(path.to_owned());
            map.iter().for_each(|(key, value)| objects(value, &format!("{path}/{key}"), all));
        }
        Value::Array(list) => {
            let parts = list.iter().enumerate();
            parts.for_each(|(k, value)| objects(value, &format!("{path}/{k}"), all));
        }
        _ => (),
    }
}

fn all_objects(file: &File) -> Vec<String> {
    let mut all = Vec::new();
    objects(&file.root, "", &mut all);
    // The file is written with what a buffer has.
    all.retain(|path| path != "/buffers/0");
    assert!(all.len() > 60, "{}", all.len());
    all
}

fn object<'f>(file: &'f mut File, path: &str) -> &'f mut Map<String, Value> {
    file.root.pointer_mut(path).unwrap().as_object_mut().unwrap()
}

#[test]
fn what_nobody_knows_is_noted_wherever_it_stands() {
    let file = rich();
    let notes = |file: &File| found(file).unwrap().notes;
    let before = notes(&file);
    let mut added = 0;
    for path in all_objects(&file) {
        for (key, value) in [
            ("madeUp", json!(0)),
            ("_MADE_UP", json!(0)),
            ("extras", json!({"targetNames": ["a"]})),
            ("extensions", json!({"EXT_made_up": {}})),
        ] {
            let is_nested = value.is_object();
            if is_nested
                && ["/attributes", "/extensions", "/0/targets/0"]
                    .iter()
                    .any(|end| path.ends_with(end))
            {
                continue;
            }
            let mut file = rich();
            let part = object(&mut file, &path);
            let name = if key == "extensions" { "EXT_made_up" } else { key };
            match part.get_mut(key) {
                Some(Value::Object(there)) => drop(there.insert(name.to_owned(), json!({}))),
                _ => drop(part.insert(key.to_owned(), value)),
            }
            let now = notes(&file);
            let is_new = |note: &&String| !before.contains(note) && note.contains(name);
            let is_root = path.is_empty() && key == "extras";
            assert!(is_root || now.iter().any(|note| is_new(&note)), "{path}/{key}: {now:?}");
            added += 1;
        }
    }
    assert!(added > 200, "{added}");
}

#[test]
fn names_of_extensions_are_noted_with_what_has_them() {
    let mut file = rich();
    for (path, name) in [
        ("", "KHR_lights_punctual"),
        ("/nodes/4", "EXT_mesh_gpu_instancing"),
        ("/materials/1", "KHR_materials_unlit"),
        ("/meshes/1/primitives/0", "KHR_materials_variants"),
        ("/meshes/1/primitives/0/attributes", "_CUSTOM"),
        ("/meshes/1/primitives/0/attributes", "COLOR_1"),
        ("/meshes/1/primitives/0/targets/0", "COLOR_0"),
    ] {
        match name.contains("_m") || name.starts_with("KHR") {
            true => {
                object(&mut file, path).insert("extensions".to_owned(), json!({name: {"a": 0}}))
            }
            false => object(&mut file, path).insert(name.to_owned(), json!(0)),
        };
    }
    let notes = found(&file).unwrap().notes.join("\n");
    for expected in [
        "the extension \"KHR_lights_punctual\" of the file was left out",
        "the extension \"EXT_mesh_gpu_instancing\" of a node was left out",
        "the extension \"KHR_materials_unlit\" of a material was left out",
        "the extension \"KHR_materials_variants\" of a primitive was left out",
        "the attribute \"_CUSTOM\" of a primitive was left out",
        "the attribute \"COLOR_1\" of a primitive was left out",
        "the attribute \"COLOR_0\" of a morph target was left out",
    ] {
        assert!(notes.contains(expected), "{expected}: {notes}");
    }
}

/// Keys without which a file is read alike, by their paths without numbers. They say nothing about surfaces. Or
/// others say it: the list of cameras is noted, and so are the nodes of a scene that is not read. Which faces are
/// culled is said by `cull` of the pipeline.
const SAYS_NOTHING: [&str; 20] = [
    ".extensionsRequired",
    ".extensionsUsed",
    "accessors.max",
    "accessors.min",
    "accessors.name",
    "asset.copyright",
    "asset.generator",
    "asset.minVersion",
    "bufferViews.name",
    "bufferViews.target",
    "images.mimeType",
    "images.name",
    "materials.doubleSided",
    "nodes.camera",
    "samplers.name",
    "scenes.name",
    "scenes.nodes",
    "skins.name",
    "skins.skeleton",
    "textures.name",
];

#[test]
fn no_key_can_be_taken_away_unnoticed() {
    let file = rich();
    let before = found(&file);
    assert!(before.is_ok(), "{before:?}");
    let mut unnoticed = Vec::new();
    for path in all_objects(&file) {
        for key in object(&mut rich(), &path).keys().cloned().collect::<Vec<_>>() {
            let mut file = rich();
            object(&mut file, &path).remove(&key);
            // The file is written with one.
            if key != "buffers" && found(&file) == before {
                let parts = path.split('/').filter(|part| part.parse::<usize>().is_err());
                let parts: Vec<_> = parts.filter(|part| !part.is_empty()).collect();
                unnoticed.push(format!("{}.{key}", parts.join(".")));
            }
        }
    }
    unnoticed.sort();
    unnoticed.dedup();
    assert_eq!(unnoticed, SAYS_NOTHING);
}
