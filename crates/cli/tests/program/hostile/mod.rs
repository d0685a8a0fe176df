//! Files made to do harm, as `bokashi inspect` and `bokashi fit` meet them: each is refused with its place and
//! the rule that it breaks, in little memory and time, and nothing outside its folder is read.
//!
//! The units of `bokashi-scene` have more cases of each kind. Here a limit of the system stands behind each.

#[cfg(target_os = "linux")]
mod memory;
mod written;

use std::fs;
use std::io::{Read, Seek};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use bokashi_scene::{Location, Picture, Samples};
use serde_json::{Value, json};

use crate::PROGRAM;
use crate::run::{text, write};

/// The addresses that the program may have, in KiB, where the system can limit them: half a GiB. It takes less
/// than a fifth of them for a small mesh.
const MOST_KIB: u32 = 512 << 10;
/// Longer than any of these files may take.
const LONG: Duration = Duration::from_secs(60);

/// Runs the program within its limits.
fn bokashi(folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(if cfg!(target_os = "linux") { "sh" } else { PROGRAM });
    if cfg!(target_os = "linux") {
        command.args(["-c", &format!("ulimit -v {MOST_KIB}; exec \"$0\" \"$@\""), PROGRAM]);
    }
    // Each thread takes addresses that it does not use.
    command.env("MALLOC_ARENA_MAX", "1").env("RAYON_NUM_THREADS", "2");
    command.args(words).current_dir(folder).stdin(Stdio::null());
    // Files, since a pipe that nobody reads holds up who writes more than it takes.
    let mut ends = [tempfile::tempfile().unwrap(), tempfile::tempfile().unwrap()];
    let [stdout, stderr] = ends.each_ref().map(|end| Stdio::from(end.try_clone().unwrap()));
    let mut child = command.stdout(stdout).stderr(stderr).spawn().unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > LONG {
            child.kill().unwrap();
            panic!("{words:?} takes longer than {LONG:?}");
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let [stdout, stderr] = ends.each_mut().map(|end| {
        let mut bytes = Vec::new();
        end.rewind().unwrap();
        end.read_to_end(&mut bytes).unwrap();
        bytes
    });
    Output { status, stdout, stderr }
}

/// What the program says as it ends with status 1: all of it, and the error alone.
#[track_caller]
fn refused(folder: &Path, words: &[&str]) -> [String; 2] {
    let output = bokashi(folder, words);
    let [told, error] = [text(&output.stdout), text(&output.stderr)];
    assert_eq!(output.status.code(), Some(1), "{words:?}: {told}{error}");
    assert_eq!(error.lines().count(), 1, "{words:?}: {error}");
    assert!(error.starts_with("bokashi: ") && error.len() < 2000, "{words:?}: {error}");
    [format!("{told}{error}"), error]
}

/// Asserts that `inspect` refuses a file with a message that begins with its place and has the rule.
#[track_caller]
fn inspect_refuses(folder: &Path, name: &str, bytes: impl AsRef<[u8]>, place: &str, rule: &str) {
    write(folder, name, bytes);
    let [_, error] = refused(folder, &["inspect", name]);
    assert!(error.starts_with(&format!("bokashi: {place}: ")), "not at {place}: {error}");
    assert!(error.contains(rule), "no {rule:?}: {error}");
}

const PLY: &str = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\n\
                   property float y\nproperty float z\nelement face 1\n\
                   property list uchar int vertex_indices\nend_header\n";

/// A binary PLY of a triangle.
fn ply(positions: [f32; 9], indices: [i32; 3]) -> Vec<u8> {
    let mut bytes = PLY.as_bytes().to_vec();
    bytes.extend(positions.iter().flat_map(|x| x.to_le_bytes()));
    bytes.push(3);
    bytes.extend(indices.iter().flat_map(|k| k.to_le_bytes()));
    bytes
}

const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// A glTF file of a triangle whose numbers are in `b.bin`, and these.
fn gltf(change: impl FnOnce(&mut Value)) -> (String, Vec<u8>) {
    let mut root = json!({
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 42, "uri": "b.bin"}],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 6}
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"}
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0
    });
    change(&mut root);
    let mut bytes: Vec<u8> = TRIANGLE.iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend([0, 0, 1, 0, 2, 0]);
    (root.to_string(), bytes)
}

/// The file of a triangle, and the numbers beside it.
fn write_gltf(folder: &Path, change: impl FnOnce(&mut Value)) -> String {
    let (text, bytes) = gltf(change);
    write(folder, "b.bin", bytes);
    text
}

#[test]
fn the_files_that_harm_is_made_of_are_read_within_the_limits() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(folder, "a.ply", ply(TRIANGLE, [0, 1, 2]));
    write(folder, "a.gltf", write_gltf(folder, |_| ()));
    write(folder, "a.png", png(&[]));
    write(folder, "scene.toml", scene());
    for name in ["a.ply", "a.gltf", "a.png", "scene.toml"] {
        let output = bokashi(folder, &["inspect", name]);
        let said = [text(&output.stdout), text(&output.stderr)];
        assert_eq!(output.status.code(), Some(0), "{name}: {said:?}");
    }
}

#[test]
fn meshes_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let texts = [
        ("v nan 0 0\n", ":4", "a vertex has finite numbers, and \"nan\" is none"),
        ("v 1e40 0 0\n", ":4", "a vertex has finite numbers"),
        ("f 1 2 4\n", ":4", "the file has 3 of the kind \"vertex\", and a face names number 4"),
        ("f 1 2 -4\n", ":4", "a vertex has a number from 1 on or back to -3, and this is -4"),
        ("f 1 2 0\n", ":4", "a vertex has a number from 1 on"),
        ("f 1 2 99999999999999999999\n", ":4", "a corner has whole numbers"),
        ("f 1 2 4294967297\n", ":4", "a vertex has a number from 1 on"),
        ("f 1 1 2\n", "", "a face that names a vertex twice was left out"),
        ("f 1/1 2/1 3/\\\n", ":4", "the file has 0 of the kind \"texture coordinate\""),
    ];
    for (line, at, rule) in texts {
        let text = format!("{corners}{line}");
        inspect_refuses(folder, "a.obj", text, &format!("a.obj{at}"), rule);
    }
    let whole = ply(TRIANGLE, [0, 1, 2]);
    let nan = ply([0.0, f32::NAN, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0, 1, 2]);
    let huge = |count: &str| PLY.replace("vertex 3", &format!("vertex {count}")).into_bytes();
    let binary = [
        (
            whole[..whole.len() - 1].to_vec(),
            "face 0 has the property \"vertex_indices\", and the file ends",
        ),
        (whole[..PLY.len() + 20].to_vec(), "the elements' rows need 37 bytes, and 20 follow"),
        (whole[..PLY.len() - 5].to_vec(), "a header ends with the line end_header"),
        (nan, "positions are finite, and vertex 0 is at [0.0, NaN, 0.0]"),
        (
            ply(TRIANGLE, [0, 1, -1]),
            "face 0 has vertices that are whole numbers from 0 on, and this is -1",
        ),
        (ply(TRIANGLE, [0, 1, 3]), "the file has 3 vertices, and a face names vertex 3"),
        (ply(TRIANGLE, [0, 1, 1]), "a face that names a vertex twice was left out"),
        (huge("4294967295"), "the elements' rows need 51539607541 bytes"),
        (huge("18446744073709551615"), "the elements' rows need 18446744073709551615 bytes"),
    ];
    for (bytes, rule) in binary {
        inspect_refuses(folder, "a.ply", bytes, "a.ply", rule);
    }
}

#[test]
fn gltf_files_are_refused() {
    type Change = fn(&mut Value);
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let rows: [(Change, &str); 11] = [
        (|root| root["nodes"] = json!([{"children": [1]}, {"children": [0]}]), "not below itself"),
        (|root| root["nodes"] = json!([{"children": [0], "mesh": 0}]), "not below itself"),
        (|root| root["nodes"] = json!([{"mesh": 7}]), "has 1 meshes, and node 0 has 7"),
        (|root| root["accessors"][0]["count"] = json!(1_u64 << 31), "2147483648 elements lie in"),
        (|root| root["accessors"][0]["count"] = json!(1_u64 << 62), "fewer elements than 2^32 - 1"),
        (|root| root["accessors"][0]["byteOffset"] = json!(u64::MAX), "elements lie in 36 bytes"),
        (|root| root["bufferViews"][0]["byteLength"] = json!(u64::MAX), "bytes of its buffer"),
        (|root| root["buffers"][0]["byteLength"] = json!(1_u64 << 40), "buffer 0 has 42 of"),
        (
            |root| {
                root["accessors"][0] =
                    json!({"componentType": 5126, "count": 1_u64 << 31, "type": "VEC3"});
            },
            "bytes of meshes in a file of this length are read",
        ),
        (|root| root["accessors"][1]["componentType"] = json!(5126), "an index is an unsigned"),
        (|root| root["meshes"][0]["primitives"][0]["indices"] = json!(5), "a mesh names 5"),
    ];
    for (change, rule) in rows {
        inspect_refuses(folder, "a.gltf", write_gltf(folder, change), "a.gltf", rule);
    }
    let (text, bytes) = gltf(|_| ());
    let mut wrong = bytes.clone();
    wrong[40] = 9;
    write(folder, "b.bin", &wrong);
    inspect_refuses(folder, "a.gltf", &text, "a.gltf", "and index 2 is 9");
    wrong[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    wrong[40] = 2;
    write(folder, "b.bin", &wrong);
    inspect_refuses(folder, "a.gltf", &text, "a.gltf", "positions are finite, and vertex 0");
    write(folder, "b.bin", &bytes[..41]);
    inspect_refuses(folder, "a.gltf", &text, "a.gltf", "buffer 0 has 41 of 42");
    inspect_refuses(folder, "a.gltf", &text[..99], "a.gltf:1:99", "the text ends within");
    let deep = format!("{{\"asset\": {}", "[".repeat(1_000_000));
    inspect_refuses(folder, "a.gltf", deep, "a.gltf:1:11", "this is a list");
    let mut glb = b"glTF\x02\0\0\0\xff\xff\xff\x7fJSON".to_vec();
    inspect_refuses(folder, "a.glb", &glb, "a.glb", "a GLB has a chunk of JSON");
    glb.truncate(7);
    inspect_refuses(folder, "a.glb", &glb, "a.glb", "a GLB has a length of 12 bytes or more");
}

/// Chunks of a PNG of 3 x 2 pixels, gray, with `others` before the pixels.
fn png(others: &[(&[u8; 4], Vec<u8>)]) -> Vec<u8> {
    png_of([3, 2], others, &zlib_of_zeros(8))
}

fn png_of(size: [u32; 2], others: &[(&[u8; 4], Vec<u8>)], pixels: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let mut chunk = |name: &[u8; 4], data: &[u8]| {
        bytes.extend((data.len() as u32).to_be_bytes());
        let named = [name, data].concat();
        bytes.extend(&named);
        bytes.extend(crc32(&named).to_be_bytes());
    };
    let header: Vec<u8> = size.iter().flat_map(|extent| extent.to_be_bytes()).collect();
    chunk(b"IHDR", &[&header[..], &[8, 0, 0, 0, 0]].concat());
    others.iter().for_each(|(name, data)| chunk(name, data));
    chunk(b"IDAT", pixels);
    chunk(b"IEND", &[]);
    bytes
}

/// The checksum of PNG, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |sum: u32| if sum & 1 == 1 { 0xedb8_8320 ^ (sum >> 1) } else { sum >> 1 };
    let byte = |sum: u32, byte: &u8| (0..8).fold(sum ^ u32::from(*byte), |sum, _| step(sum));
    !bytes.iter().fold(u32::MAX, byte)
}

/// Zeros compressed by zlib, 158 of them to a byte: one, then copies of 258 each, by fixed codes; `count` is 1
/// and a multiple of 258, or the next such number.
fn zlib_of_zeros(count: usize) -> Vec<u8> {
    let (mut bytes, mut filled) = (vec![0x78, 0x01, 0], 0);
    // Codes begin with their highest bit, bytes with their lowest.
    let mut push = |code: u32, length: u32| {
        for k in (0..length).rev() {
            if filled == 8 {
                (filled, _) = (0, bytes.push(0));
            }
            *bytes.last_mut().unwrap() |= ((code >> k & 1) as u8) << filled;
            filled += 1;
        }
    };
    // The last block, of fixed codes; a zero.
    push(0b110, 3);
    push(0b0011_0000, 8);
    let copies = (count - 1).div_ceil(258);
    for _ in 0..copies {
        // A length of 258, a distance of 1.
        push(0b1100_0101, 8);
        push(0, 5);
    }
    push(0, 7);
    let sum = ((1 + 258 * copies) % 65521) as u32;
    bytes.extend((sum << 16 | 1).to_be_bytes());
    bytes
}

#[test]
fn images_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    for name in ["a.png", "a.jpg", "a.exr"] {
        inspect_refuses(folder, name, b"", name, "and the file is empty");
        inspect_refuses(folder, name, b"hello", name, "begins with the bytes 68 65 6c 6c");
    }
    let whole = png(&[]);
    inspect_refuses(folder, "a.png", &whole[..50], "a.png", "the image can't be decoded");
    let most = "at most 268435456 samples of an image are read";
    for size in [[50_000, 50_000], [u32::MAX >> 1, u32::MAX >> 1]] {
        inspect_refuses(folder, "a.png", png_of(size, &[], &[]), "a.png", most);
    }
    let rule = "an image of 16000 x 16000 needs more bytes than its file has";
    inspect_refuses(folder, "a.png", png_of([16_000, 16_000], &[], &[]), "a.png", rule);
    // A JPEG that claims 65535 columns and rows.
    let jpeg = b"\xff\xd8\xff\xc0\0\x0b\x08\xff\xff\xff\xff\x01\x01\x11\0\xff\xda\0\x08\x01\x01\0\0\x3f\0\xff\xd9";
    inspect_refuses(folder, "a.jpg", jpeg, "a.jpg", most);
}

/// As many zeros as the program may have addresses.
const BOMB: usize = (MOST_KIB as usize) << 10;

#[test]
fn what_is_packed_into_little_takes_little() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let zeros = zlib_of_zeros(BOMB);
    // More pixels than the header says, a colour profile, a text.
    let profile = [b"a\0\0", &zeros[..]].concat();
    let bombs = [
        png_of([3, 2], &[], &zeros),
        png(&[(b"iCCP", profile.clone())]),
        png(&[(b"zTXt", profile)]),
        png(&[(b"iTXt", [b"a\0\x01\0\0\0", &zeros[..]].concat())]),
    ];
    for (k, bomb) in bombs.iter().enumerate() {
        assert!(bomb.len() < BOMB / 100);
        write(folder, "a.png", bomb);
        let output = bokashi(folder, &["inspect", "a.png"]);
        let said = [text(&output.stdout), text(&output.stderr)];
        // The image is there in any case.
        assert_eq!(output.status.code(), Some(0), "{k}: {said:?}");
        assert!(said[0].contains("3 x 2 pixels"), "{k}: {said:?}");
    }
    // A geometry for each few letters: time and memory in proportion.
    let objects = "o\nf 1 2 3\n";
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let own = format!("o\n{corners}f -3 -2 -1\n");
    // Those that share vertices are one surface, with a face again and again: that is a problem.
    for (all, status) in
        [(own.repeat(60_000), 0), (format!("{corners}{}", objects.repeat(60_000)), 1)]
    {
        write(folder, "a.obj", all);
        let output = bokashi(folder, &["inspect", "a.obj"]);
        assert_eq!(output.status.code(), Some(status), "{}", text(&output.stderr));
    }
    let (place, rule) = (format!("a.obj:{}", 3 + 2 * 100_001), "at most 100000 meshes of a file");
    let all = format!("{corners}{}", objects.repeat(500_000));
    inspect_refuses(folder, "a.obj", all, &place, rule);
    let nodes = vec!["{}"; 2_000_000].join(",");
    let all = format!("{{\"asset\": {{\"version\": \"2.0\"}}, \"nodes\": [{nodes}]}}");
    let rule = "bytes of meshes in a file of this length are read";
    inspect_refuses(folder, "a.gltf", all, "a.gltf", rule);
    let all = format!("{{\"frames\": [{}]}}", vec!["{}"; 2_000_000].join(","));
    inspect_refuses(folder, "a.json", all, "a.json:1:14", "the key `file_path` is missing");
    let all = format!("meshes = [{}]", "{},".repeat(2_000_000));
    inspect_refuses(folder, "a.toml", all, "a.toml", "at most 1048576 tables and lists");
    // A block of an EXR that says how long it is, and is longer.
    let samples = Samples::F32(vec![0.0; 64 * 16]);
    let picture = Picture { width: 64, height: 16, channels: 1, samples };
    let mut exr = picture.encode_exr(&Location::new("a.exr")).unwrap();
    let word = |at: usize| u64::from_le_bytes(exr[at..at + 8].try_into().unwrap());
    // The only entry of the table of blocks leads to what follows it: the row, the length, the data.
    let table = (0..exr.len() - 8).find(|&at| word(at) == at as u64 + 8).unwrap();
    exr.truncate(table + 12);
    exr.extend((zeros.len() as u32).to_le_bytes());
    exr.extend(&zeros);
    inspect_refuses(folder, "a.exr", exr, "a.exr", "the image can't be decoded");
}

const OBJ: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// A scene that can be fitted, beside `a.ply` and `a.png`.
fn scene() -> String {
    "[[meshes]]\nfile = \"a.ply\"\n[[views]]\nimage = \"a.png\"\n\
     camera = { focal = 3, position = [0.3, 0.2, 4] }\n[learn.vertices]\n[stop]\nsteps = 1\n"
        .to_owned()
}

#[test]
fn nothing_outside_the_folder_is_read() {
    let place = tempfile::tempdir().unwrap();
    let folder = &place.path().join("in");
    fs::create_dir(folder).unwrap();
    // Whoever opens one of these waits for ever.
    for name in ["s.bin", "s.obj", "s.mtl", "s.png", "s.json", "s.ply"] {
        let path = place.path().join(name);
        if !cfg!(unix) {
            fs::write(&path, OBJ).unwrap();
        } else if !Command::new("mkfifo").arg(&path).status().is_ok_and(|status| status.success()) {
            panic!("mkfifo makes {}", path.display());
        }
        #[cfg(unix)]
        std::os::unix::fs::symlink(&path, folder.join(format!("link{name}"))).unwrap();
    }
    write(folder, "a.png", png(&[]));
    write(folder, "a.ply", ply(TRIANGLE, [0, 1, 2]));
    write(folder, "below/a.obj", OBJ);
    let outside = place.path().display().to_string();
    let paths = |name: &str| {
        let mut all =
            vec![format!("../{name}"), format!("below/../../{name}"), format!("{outside}/{name}")];
        all.extend(cfg!(unix).then(|| format!("link{name}")));
        all
    };
    let rule = "files lie in the scene's folder";
    let is_refused = |words: &[&str], path: &str| {
        let [said, _] = refused(folder, words);
        assert!(said.contains(rule), "{words:?}, {path}: {said}");
    };
    for path in paths("s.bin") {
        let escaped = path.replace('.', "%2e").replace('/', "%2F");
        for uri in [path, escaped] {
            write(
                folder,
                "a.gltf",
                write_gltf(folder, |root| root["buffers"][0]["uri"] = json!(uri)),
            );
            is_refused(&["inspect", "a.gltf"], &uri);
        }
    }
    for path in paths("s.png") {
        let image = |root: &mut Value| {
            root["images"] = json!([{"uri": path}]);
            root["textures"] = json!([{"source": 0}]);
            root["materials"] =
                json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
        };
        write(folder, "a.gltf", write_gltf(folder, image));
        is_refused(&["inspect", "a.gltf"], &path);
        write(folder, "m.mtl", format!("newmtl m\nmap_Kd {path}\n"));
        write(folder, "a.obj", format!("mtllib m.mtl\nusemtl m\n{OBJ}"));
        is_refused(&["inspect", "a.obj"], &path);
        let comment = format!("1.0\ncomment TextureFile {path}\n");
        let mut textured = PLY.replace("1.0\n", &comment).into_bytes();
        textured.extend(&ply(TRIANGLE, [0, 1, 2])[PLY.len()..]);
        write(folder, "t.ply", textured);
        is_refused(&["inspect", "t.ply"], &path);
        let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]";
        let frame = json!({"file_path": path, "transform_matrix": 0}).to_string();
        let frame =
            frame.replace("\"transform_matrix\":0", &format!("\"transform_matrix\":{pose}"));
        write(folder, "t.json", format!("{{\"fl_x\": 3, \"frames\": [{frame}]}}"));
        is_refused(&["inspect", "t.json"], &path);
        write(folder, "m/cameras.txt", "1 SIMPLE_PINHOLE 3 2 3 1 1\n");
        write(folder, "m/images.txt", format!("1 1 0 0 0 0 0 4 1 {path}\n\n"));
        let colmap = "[[meshes]]\nfile = \"a.ply\"\n[cameras]\ncolmap = \"m\"\nimages = \".\"\n";
        write(folder, "colmap.toml", format!("{colmap}[learn.vertices]\n"));
        is_refused(&["inspect", "colmap.toml"], &path);
        is_refused(&["fit", "colmap.toml"], &path);
        let quoted = format!("{path:?}");
        write(folder, "scene.toml", scene().replace("\"a.png\"", &quoted));
        is_refused(&["inspect", "scene.toml"], &path);
        is_refused(&["fit", "scene.toml"], &path);
        let masked = scene().replace("image = ", &format!("mask = {quoted}\nimage = "));
        write(folder, "scene.toml", format!("{masked}[loss]\nsilhouette = 1\n"));
        is_refused(&["inspect", "scene.toml"], &path);
        is_refused(&["fit", "scene.toml"], &path);
    }
    for path in paths("s.mtl") {
        write(folder, "a.obj", format!("mtllib {path}\n{OBJ}"));
        is_refused(&["inspect", "a.obj"], &path);
    }
    for path in paths("s.ply") {
        write(folder, "scene.toml", scene().replace("\"a.ply\"", &format!("{path:?}")));
        is_refused(&["inspect", "scene.toml"], &path);
        is_refused(&["fit", "scene.toml"], &path);
    }
    for path in paths("s.json") {
        write(folder, "scene.toml", format!("[cameras]\ntransforms = {path:?}\n{}", scene()));
        is_refused(&["inspect", "scene.toml"], &path);
    }
}

#[test]
fn descriptions_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(folder, "a.png", png(&[]));
    write(folder, "a.ply", ply(TRIANGLE, [0, 1, 2]));
    let camera = "camera = { focal = 3, position = [0.3, 0.2, 4] }";
    let shape = |keys: &str| scene().replace("file = \"a.ply\"", keys);
    let camera_of = |keys: &str| scene().replace(camera, &format!("camera = {{ {keys} }}"));
    let rows = [
        (format!("seed = {}", "[".repeat(1_000_000)), ":1:", "a value lies in at most"),
        (format!("{}a = 1", "a.".repeat(1_000_000)), ": ", "a value lies in at most"),
        (format!("[{}a]", "a.".repeat(1_000_000)), ": ", "a value lies in at most"),
        (format!("seed = {}", "{a=".repeat(1_000_000)), ":1:", "a value lies in at most"),
        (scene().replace("steps = 1", "steps = nan"), ":8:9: ", "a whole number from 1 to"),
        (scene().replace("focal = 3", "focal = inf"), ":5:20: ", "a finite number above 0"),
        (scene().replace("0.3", "nan"), ":5:34: ", "a finite number is needed here"),
        (camera_of("angle = 1e-320, position = [0, 0, 4]"), ":3:1: ", "too extreme"),
        (camera_of("focal = 3, position = [0, 0, 0]"), ":3:1: ", "another place than its own"),
        (
            shape("shape = \"sphere\"\nfaces = 1000000000"),
            ":1:1: ",
            "at most 10000000 faces of a shape are read, and there are 1000000000",
        ),
        (
            shape("shape = \"plane\"\nmaterial = { texture_size = 1000000000 }"),
            ":1:1: ",
            "at most 268435456 samples of an image are read",
        ),
        (
            format!("{}\n[environment]\ncolor = [1, 1, 1]\nsize = 1000000000\n", scene()),
            ":10:1: ",
            "the side of a cube map is a power of two from 8 to 256",
        ),
        (
            camera_of("size = [1000000000, 1000000000], focal = 3, position = [0, 0, 4]"),
            ": ",
            "at most 268435456 pixels of a view are read",
        ),
    ];
    for (text, at, rule) in rows {
        write(folder, "scene.toml", &text);
        for command in ["inspect", "fit"] {
            let [_, error] = refused(folder, &[command, "scene.toml"]);
            let begin: String = text.chars().take(300).collect();
            assert!(error.starts_with(&format!("bokashi: scene.toml{at}")), "{begin}: {error}");
            assert!(error.contains(rule), "{begin}: {error}");
        }
    }
    assert!(!folder.join("out/index.html").exists());
}

#[test]
fn cameras_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(folder, "a.png", png(&[]));
    write(folder, "a.ply", ply(TRIANGLE, [0, 1, 2]));
    let frames = |matrix: &str| {
        format!("\"frames\": [{{\"file_path\": \"a.png\", \"transform_matrix\": {matrix}}}]")
    };
    let still = "[[1,0,0,0],[0,1,0,0],[0,0,1,4]]";
    let rows = [
        (format!("{{\"fl_x\": NaN, {}}}", frames(still)), ":1:10", "a file of cameras is JSON"),
        (format!("{{\"fl_x\": 1e999, {}}}", frames(still)), ":1:14", "number out of range"),
        (format!("{{\"fl_x\": \"nan\", {}}}", frames(still)), ":1:14", "a number is needed here"),
        (
            format!("{{\"fl_x\": 3, {}}}", frames("[[1e200,0,0,0],[0,1,0,0],[0,0,1,0]]")),
            "",
            "perpendicular",
        ),
        (format!("{{\"fl_x\": 3, {}}}", frames("[[1,0],[0,1]]")), "", "3 or 4 rows of 4 numbers"),
        (format!("{{\"camera_angle_x\": 1e-320, {}}}", frames(still)), "", "too extreme"),
        (
            format!("{{\"fl_x\": 3, \"w\": 1e300, \"h\": 2, {}}}", frames(still)),
            "",
            "from 1 to 65535",
        ),
        (
            format!("{{\"frames\": {}", "[".repeat(1_000_000)),
            ":1:13",
            "needed here, and this is a list",
        ),
        (format!("{{\"other\": {}", "[".repeat(1_000_000)), ":1:", "the text ends within a list"),
    ];
    let toml =
        "[[meshes]]\nfile = \"a.ply\"\n[cameras]\ntransforms = \"t.json\"\n[learn.vertices]\n";
    write(folder, "scene.toml", toml);
    for (text, at, rule) in rows {
        write(folder, "t.json", &text);
        for words in [["inspect", "t.json"], ["inspect", "scene.toml"], ["fit", "scene.toml"]] {
            let [_, error] = refused(folder, &words);
            assert!(error.starts_with(&format!("bokashi: t.json{at}")), "{words:?}: {error}");
            assert!(error.contains(rule), "{words:?}: {error}");
        }
    }
    // COLMAP's, as text and binary: broken numbers, counts beyond the file, no end.
    let lens = "1 PINHOLE 3 2 3 3 1 1\n";
    let shot = "1 1 0 0 0 0 0 4 1 a.png\n\n";
    let huge = [&u64::MAX.to_le_bytes()[..], &[0; 60]].concat();
    let rows: [(&str, &[u8], &str, &str); 7] = [
        ("cameras.txt", b"1 PINHOLE 3 2 nan 3 1 1\n", ":1", "parameters of a camera are finite"),
        (
            "cameras.txt",
            b"1 PINHOLE 3 99999999999 3 3 1 1\n",
            ":1",
            "from 1 to 65535 columns and rows",
        ),
        ("cameras.txt", b"1 PINHOLE 3 2 3 3 1", ":1", "has 4 parameters, and this has 3"),
        ("images.txt", b"1 nan 0 0 0 0 0 4 1 a.png\n\n", "", "a pose is a finite quaternion"),
        ("images.txt", b"1 1 0 0 0 0 0 inf 1 a.png\n\n", "", "a pose is a finite quaternion"),
        ("cameras.bin", &huge, "", "records fit in the bytes that are left"),
        ("images.bin", &huge[..7], "", "8 bytes follow, and 7 are left"),
    ];
    write(
        folder,
        "scene.toml",
        toml.replace("transforms = \"t.json\"", "colmap = \"m\"\nimages = \".\""),
    );
    for (name, bytes, at, rule) in rows {
        let _ = fs::remove_dir_all(folder.join("m"));
        write(folder, "m/cameras.txt", lens);
        write(folder, "m/images.txt", shot);
        write(folder, &format!("m/{name}"), bytes);
        for command in ["inspect", "fit"] {
            let [_, error] = refused(folder, &[command, "scene.toml"]);
            assert!(error.starts_with(&format!("bokashi: m/{name}{at}: ")), "{error}");
            assert!(error.contains(rule), "{command}: {error}");
        }
    }
}

#[test]
fn a_fit_refuses_what_its_images_are_not() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(folder, "a.ply", ply(TRIANGLE, [0, 1, 2]));
    let sized = scene().replace("focal = 3", "size = [3, 2], focal = 3");
    let rows: [(Vec<u8>, &str); 4] = [
        (Vec::new(), "and the file is empty"),
        (png(&[])[..50].to_vec(), "the image can't be decoded"),
        (png_of([50_000, 50_000], &[], &[]), "at most 268435456 samples of an image are read"),
        (png_of([4, 2], &[], &zlib_of_zeros(10)), "the size of its"),
    ];
    for (bytes, rule) in rows {
        write(folder, "a.png", bytes);
        for text in [&sized, &scene()] {
            write(folder, "scene.toml", text);
            for command in ["inspect", "fit"] {
                if text.as_str() == scene() && rule.contains("size of its") {
                    continue;
                }
                let [said, _] = refused(folder, &[command, "scene.toml"]);
                assert!(said.contains("a.png: ") && said.contains(rule), "{command}: {said}");
            }
        }
    }
}
