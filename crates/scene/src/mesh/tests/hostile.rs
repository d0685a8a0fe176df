//! Files that are cut, changed, or ask for too much: each is read or refused, and nothing panics.

use std::time::{Duration, Instant};

use serde_json::json;

use super::gltf::File;
use super::{HERE, message, read, read_with};
use crate::error::SceneError;
use crate::mesh::MeshKind::{self, Gltf, Obj, Ply};
use crate::mesh::{glb, ply};
use crate::model::Model;

/// Longer than any of these files may take, and far shorter than what a mistake costs.
const LONG: Duration = Duration::from_secs(30);

const OBJ: &str = "mtllib m.mtl\nv 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 .5 .5 .5\nv 1 1 0 0 0 0\n\
                   vt 0 0\nvn 0 0 1\no a\nusemtl m\nf 1/1/1 2/1/1 3/1/1\nf -1//1 \\\n 1//1 2//1\n";
const MTL: &str =
    "newmtl m\nKd .5 .5 .5\nd 1\nmap_Kd -s 1 1 1 a.png\nPr 0.5\nmap_Pr b.png\nnorm -bm 1 c.png\n";
const PLY: &str = "ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 3\nproperty float x\n\
                   property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
                   property uchar blue\nelement face 1\nproperty list uchar int vertex_indices\n\
                   property list uchar float texcoord\nend_header\n0 0 0 1 2 3\n1 0 0 1 2 3\n\
                   0 1 0 1 2 3\n3 0 1 2 6 0 0 1 0 0 1\n";

fn small() -> Model {
    read(Obj, OBJ).unwrap()
}

/// The small files of all formats.
fn files() -> Vec<(MeshKind, Vec<u8>)> {
    let square = File::square();
    vec![
        (Obj, OBJ.into()),
        (Ply, PLY.into()),
        (Ply, ply(&small().geometries[0], HERE, &[], |_| None).unwrap()),
        (Gltf, square.text().into()),
        (Gltf, square.binary()),
        (Gltf, glb(&small()).unwrap()),
    ]
}

#[test]
fn files_of_every_shorter_length_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (kind, bytes) in files() {
        // One folder for all: making one takes longer than reading.
        let read = |bytes: &[u8]| read_with(kind, bytes, &[], folder.path());
        assert!(read(&bytes).is_ok());
        let refused = (0..bytes.len()).filter(|&length| read(&bytes[..length]).is_err()).count();
        assert!(refused > bytes.len() / 2, "{kind:?}: {refused} of {}", bytes.len());
    }
    for length in 0..MTL.len() {
        let mtl: (&str, &[u8]) = ("m.mtl", &MTL.as_bytes()[..length]);
        let _ = read_with(Obj, OBJ, &[mtl], folder.path());
    }
}

#[test]
fn files_with_a_byte_changed_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    for (kind, bytes) in files() {
        let mut state = 1_u32;
        for k in 0..bytes.len() {
            let mut changed = bytes.clone();
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            // Two of these at each byte: files have many bytes of a kind.
            let values = [[0, b'9'], [255, b'-'], [bytes[k] ^ 0x80, (state >> 24) as u8]];
            for value in values[k % 3] {
                changed[k] = value;
                if let Ok(model) = read_with(kind, &changed, &[], folder.path()) {
                    // What is read can be written.
                    assert!(glb(&model).is_ok(), "{kind:?}: byte {k} is {value}");
                }
            }
        }
    }
}

#[test]
fn headers_with_huge_counts_take_no_memory() {
    let huge = [1 << 20, 1 << 32, usize::MAX / 2, usize::MAX];
    for count in huge {
        for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
            let text = format!(
                "ply\nformat {format} 1.0\nelement vertex {count}\nproperty float x\nproperty float y\n\
                 property float z\nelement face {count}\nproperty list uint uint vertex_indices\n\
                 end_header\n0 0 0\n"
            );
            let error = message(read(Ply, text));
            assert!(error.contains("the elements' rows need"), "{count} {format}: {error}");
        }
    }
    // A list of 4 billion numbers in a row of a few bytes.
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\n\
                      property float y\nproperty float z\nelement face 1\n\
                      property list uint uint vertex_indices\nend_header\n"
        .to_vec();
    bytes.extend([0; 12]);
    bytes.extend([255; 12]);
    assert!(
        message(read(Ply, bytes))
            .contains("face 0 has the property \"vertex_indices\", and the file ends")
    );
    // A length of a GLB or a chunk beyond the file, and one that is too small for its header.
    for (place, lengths) in [(8, vec![0, 11, 13, u32::MAX]), (12, vec![0, 3, u32::MAX])] {
        for length in lengths {
            let mut bytes = File::square().binary();
            bytes[place..place + 4].copy_from_slice(&length.to_le_bytes());
            if length != 13 {
                assert!(read(Gltf, bytes).is_err(), "{place}: {length}");
            }
        }
    }
}

#[test]
fn a_short_file_that_names_one_part_often_is_refused() {
    let start = Instant::now();
    let too_large = |file: &File| {
        let found = read(Gltf, file.text());
        assert!(matches!(found, Err(SceneError::TooLarge { .. })), "{found:?}");
    };
    // Elements that lie in no buffer.
    let mut file = File::square();
    file.root["accessors"][0] =
        json!({"componentType": 5126, "count": 1_u64 << 31, "type": "VEC3"});
    too_large(&file);
    // Accessors that overlap, in a primitive each.
    let mut file = File::square();
    let rows = vec![[0.5_f32; 3]; 21_000];
    let first = file.floats(&rows, "VEC3");
    let accessor = file.root["accessors"][first].clone();
    let mut primitives = Vec::new();
    for k in 0..2000 {
        file.list("accessors").push(accessor.clone());
        primitives.push(json!({"attributes": {"POSITION": first + k}}));
    }
    file.root["meshes"] = json!([{"primitives": primitives}]);
    too_large(&file);
    assert!(start.elapsed() < LONG, "{:?}", start.elapsed());
}

#[test]
fn files_of_nothing_but_parts_are_refused() {
    let too_large = |kind: MeshKind, text: String| {
        let found = read(kind, text);
        assert!(matches!(found, Err(SceneError::TooLarge { .. })), "{found:?}");
    };
    for list in ["nodes", "materials", "meshes"] {
        let parts = vec!["{}"; 200_000].join(",");
        too_large(Gltf, format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"{list}\": [{parts}]}}"));
    }
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let objects = "o\nf 1 2 3\n".repeat(100_001);
    too_large(Obj, format!("{corners}{objects}"));
}

#[test]
fn many_small_parts_take_time_in_proportion() {
    let start = Instant::now();
    // Objects that name the same few vertices and so are one, materials that are not there, and a file for each
    // line. The last ten thousand parts have no material.
    let mut text = "v 0 0 0\nv 1 0 0\nv 0 1 0\n".to_owned();
    (0..100_000).for_each(|_| text.push_str("v 0 0 1\n"));
    for k in 0..30_000 {
        text.push_str(&format!("mtllib m.mtl\no a\nusemtl {k}\nf 1 2 3\n"));
    }
    let mtl: String = (0..20_000).map(|k| format!("newmtl {k}\nmap_Pr a.png\n")).collect();
    let folder = tempfile::tempdir().unwrap();
    let model = read_with(Obj, text, &[("m.mtl", mtl.as_bytes())], folder.path()).unwrap();
    let found =
        [model.geometries.len(), model.geometries[0].submeshes.len(), model.materials.len()];
    assert_eq!(found, [1, 20_001, 20_000]);
    assert!(model.notes.len() < 200, "{}", model.notes.len());
    // A primitive for each face of a large accessor.
    let mut file = File::square();
    let rows: Vec<[f32; 3]> =
        (0..60_000).map(|k| [(k % 3) as f32, (k / 3 % 2) as f32, k as f32]).collect();
    let positions = file.floats(&rows, "VEC3");
    let mut primitives = Vec::new();
    for k in 0..5000_u32 {
        let bytes: Vec<u8> = (3 * k..3 * k + 3).flat_map(u32::to_le_bytes).collect();
        let indices = file.accessor(&bytes, 5125, "SCALAR", 3);
        primitives.push(json!({"attributes": {"POSITION": positions}, "indices": indices}));
    }
    file.root["meshes"] = json!([{"primitives": &primitives}]);
    assert_eq!(read(Gltf, file.binary()).unwrap().geometries[0].faces.len(), 5000);
    // A mesh for each face.
    let meshes = primitives.into_iter().map(|primitive| json!({"primitives": [primitive]}));
    file.root["meshes"] = meshes.collect();
    assert_eq!(read(Gltf, file.binary()).unwrap().geometries.len(), 5000);
    assert!(start.elapsed() < LONG, "{:?}", start.elapsed());
}

#[test]
fn text_that_is_none_is_refused_in_short() {
    let zeros = vec![0; 10_000];
    let deep = "[".repeat(100_000);
    let long = "a".repeat(1 << 21);
    for kind in [Obj, Ply, Gltf] {
        for bytes in [&zeros, deep.as_bytes(), long.as_bytes(), b"", b"\xff\xfe", b"\xef\xbb\xbf"] {
            let error = message(read(kind, bytes));
            assert!(error.len() < 1000, "{kind:?}: {}", error.len());
        }
    }
    let long_line =
        format!("ply\nformat ascii 1.0\nelement {long} 1\nproperty int a\nend_header\n1\n");
    assert!(message(read(Ply, long_line)).len() < 1000);
    let text = format!("v 1 2 {long}\n");
    assert!(message(read(Obj, text)).len() < 1000);
    let uri = json!({"asset": {"version": "2.0"}, "buffers": [{"uri": format!("{long}:a")}]});
    assert!(read(Gltf, uri.to_string()).is_err());
}

#[test]
fn notes_about_very_many_long_names_are_short() {
    let mut header =
        "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n".to_owned();
    for element in 0..200 {
        header.push_str(&format!("element {element} 0\n"));
        (0..10)
            .for_each(|k| header.push_str(&format!("property int {}{k}\n", "\u{1}".repeat(300))));
    }
    for k in 0..50 {
        header.push_str(&format!("element face{k} 0\nproperty int {}{k}\n", "\u{1}".repeat(300)));
    }
    header.push_str("element face 1\nproperty list uchar int vertex_indices\n");
    (0..500).for_each(|k| header.push_str(&format!("property int {}{k}\n", "\u{1}".repeat(200))));
    let row = "0 ".repeat(500);
    let text = format!("ply\nformat ascii 1.0\n{header}end_header\n0 0 0\n3 0 0 0 {row}\n");
    let _ = message(read(Ply, &text));
    let text = text.replace("element vertex 1", "element vertex 3");
    let text = text.replace("0 0 0\n3 0 0 0", "0 0 0\n1 0 0\n0 1 0\n3 0 1 2");
    let notes = read(Ply, text).unwrap().notes;
    assert!(notes.iter().map(String::len).sum::<usize>() < 1 << 16);
    assert!(notes.last().unwrap().contains("further notes"), "{notes:?}");
}
