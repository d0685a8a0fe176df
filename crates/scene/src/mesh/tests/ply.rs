//! What is read of PLY files.

use super::{message, of_corners, only, read, read_with};
use crate::error::{Location, SceneError};
use crate::folder::Folder;
use crate::mesh::MeshKind::Ply;
use crate::mesh::colors::decoded;
use crate::mesh::{MeshOptions, glb, read_model, read_model_with};
use crate::model::Model;
use crate::picture::{ColorSpace, Picture, Samples};

const SQUARE: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

/// An ascii file with these lines of a header and these rows.
fn ascii(header: &str, rows: &str) -> String {
    format!("ply\nformat ascii 1.0\n{header}end_header\n{rows}")
}

fn square(more: &str, faces: &str, rows: &str) -> String {
    let header = format!(
        "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n{more}\
         element face {faces}\nproperty list uchar int vertex_indices\n"
    );
    ascii(&header, rows)
}

#[test]
fn polygons_become_fans() {
    let text = square("comment a\n", "2", &format!("{SQUARE}4 0 1 2 3\n3 3 2 1\n"));
    let model = read(Ply, text).unwrap();
    let mesh = only(&model);
    assert_eq!(mesh.positions[2], [1.0, 1.0, 0.0]);
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [3, 2, 1]]);
    assert_eq!([model.placed.len(), model.notes.len()], [1, 0]);
}

#[test]
fn binary_files_of_both_orders_are_the_ascii_one() {
    let header = "element vertex 3\nproperty double x\nproperty float y\nproperty short z\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\n\
                  element face 1\nproperty uchar flags\nproperty list ushort uint vertex_index\n";
    let rows = "0 0 -1 255 0 0\n1.5 0 2 0 255 0\n0 1 300 0 0 255\n7 3 0 1 2\n";
    let expected = read(Ply, ascii(header, rows)).unwrap();
    assert_eq!(only(&expected).positions[2], [0.0, 1.0, 300.0]);
    for is_big in [false, true] {
        let order = if is_big { "big" } else { "little" };
        let mut bytes =
            format!("ply\nformat binary_{order}_endian 1.0\n{header}end_header\n").into_bytes();
        let mut push = |number: &[u8]| match is_big {
            true => bytes.extend(number),
            false => bytes.extend(number.iter().rev()),
        };
        let vertices = [(0.0_f64, 0.0_f32, -1_i16), (1.5, 0.0, 2), (0.0, 1.0, 300)];
        for (k, (x, y, z)) in vertices.into_iter().enumerate() {
            push(&x.to_be_bytes());
            push(&y.to_be_bytes());
            push(&z.to_be_bytes());
            (0..3).for_each(|j| push(&[if j == k { 255 } else { 0 }]));
        }
        push(&[7]);
        push(&3_u16.to_be_bytes());
        (0..3_u32).for_each(|k| push(&k.to_be_bytes()));
        assert_eq!(read(Ply, bytes).unwrap(), expected, "{order}");
    }
}

/// The colour of the first vertex, where all numbers are of the type `kind`; and the notes.
fn first_color(kind: &str, names: [&str; 3], color: &str) -> ([f32; 3], Vec<String>) {
    let more = names.map(|name| format!("property {kind} {name}\n")).concat();
    let normals = "property float nx\nproperty float ny\nproperty float nz\n";
    let rows = format!(
        "0 0 0 {color} 0 0 1\n1 0 0 0 0 0 0 0 1\n0 1 0 0 0 0 0 0 2\n9 9 9 0 0 0 0 0 0\n3 0 1 2\n"
    );
    let model = read(Ply, square(&format!("{more}{normals}"), "1", &rows)).unwrap();
    assert_eq!(of_corners(&only(&model).normals), [[0.0, 0.0, 1.0]; 3]);
    (of_corners(&only(&model).colors)[0], model.notes)
}

#[test]
fn colours_of_each_name_and_type_are_srgb() {
    let rgb = ["red", "green", "blue"];
    // 188 of 255 is half of the light.
    let expected = [0.502_886_4, 0.0, 1.0];
    for (kind, color, notes) in [
        ("uchar", "188 0 255", 0),
        ("ushort", "48316 0 65535", 1),
        ("ushort", "188 0 255", 1),
        ("int", "188 0 255", 1),
        ("uint", "48316 0 65535", 1),
        ("float", "0.737254902 0 1", 0),
        ("double", "0.737254902 0. 1.", 0),
        ("float", "188 0 255.0", 1),
    ] {
        let (found, message) = first_color(kind, rgb, color);
        approx::assert_abs_diff_eq!(&found[..], &expected[..], epsilon = 1e-6);
        assert_eq!(message.len(), notes, "{kind} {color}: {message:?}");
    }
    let others = [["r", "g", "b"], ["diffuse_red", "diffuse_green", "diffuse_blue"]];
    for names in others {
        assert_eq!(
            first_color("uchar", names, "188 0 255"),
            first_color("uchar", rgb, "188 0 255")
        );
    }
}

#[test]
fn colours_are_of_the_space_that_the_caller_says() {
    let more = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    let rows = "0 0 0 0 51 255\n1 0 0 0 51 255\n0 1 0 0 51 255\n9 9 9 9 9 9\n3 0 1 2\n";
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.ply"), square(more, "1", rows)).unwrap();
    let obj = "v 0 0 0 0 .2 1\nv 1 0 0 0 .2 1\nv 0 1 0 0 .2 1\nf 1 2 3\n";
    std::fs::write(folder.path().join("a.obj"), obj).unwrap();
    let folder = Folder::new(folder.path()).unwrap();
    let linear = [0.0, 0.2, 1.0];
    let srgb = linear.map(|number| decoded(f64::from(number)));
    let parsed = |file: &str, vertex_color_space| {
        let model =
            read_model_with(&folder, file, MeshOptions { vertex_color_space, weld: None }).unwrap();
        of_corners(&only(&model).colors)[2]
    };
    for file in ["a.ply", "a.obj"] {
        approx::assert_abs_diff_eq!(&parsed(file, None)[..], &srgb[..], epsilon = 1e-6);
        assert_eq!(parsed(file, Some(ColorSpace::Srgb)), parsed(file, None));
        assert_eq!(parsed(file, Some(ColorSpace::Linear)), linear);
    }
    // glTF's are linear.
    let bytes = glb(&read_model(&folder, "a.obj").unwrap()).unwrap();
    std::fs::write(folder.join("a.glb"), bytes).unwrap();
    assert_eq!(parsed("a.glb", None), parsed("a.obj", None));
    assert_eq!(parsed("a.glb", Some(ColorSpace::Linear)), parsed("a.obj", None));
    let twice = parsed("a.obj", None).map(|light| decoded(light.into()));
    assert_eq!(parsed("a.glb", Some(ColorSpace::Srgb)), twice);
}

#[test]
fn colours_of_faces_are_read_where_vertices_have_none() {
    let header = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 2\nproperty list uchar int vertex_indices\nproperty uchar red\n\
                  property uchar green\nproperty uchar blue\n";
    let model = read(Ply, ascii(header, &format!("{SQUARE}4 0 1 2 3 255 0 0\n3 0 2 3 0 255 0\n")));
    let model = model.unwrap();
    let [red, green] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    assert_eq!(of_corners(&only(&model).colors), [[red; 6].as_slice(), &[green; 3]].concat());
    assert!(model.notes.is_empty(), "{:?}", model.notes);
}

#[test]
fn strips_are_triangles_that_turn_alike() {
    let header = "element vertex 5\nproperty float x\nproperty float y\nproperty float z\n\
                  element tristrips 1\nproperty list int int vertex_indices\n";
    let rows = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n2 1 0\n";
    // The second strip goes on behind a vertex that is there twice.
    let strips = "13 0 1 2 3 -1 1 4 3 -1 0 1 2 2\n".to_owned();
    let model = read(Ply, ascii(header, &format!("{rows}{strips}"))).unwrap();
    let mesh = only(&model);
    assert_eq!(mesh.faces, [[0, 1, 2], [2, 1, 3], [1, 4, 3], [0, 1, 2]]);
    assert!(model.notes.is_empty(), "{:?}", model.notes);
    let both = format!("{header}element face 1\nproperty list uchar int vertex_index\n");
    let model = read(Ply, ascii(&both, &format!("{rows}3 0 1 2\n3 1 4 3\n"))).unwrap();
    assert_eq!(only(&model).faces, [[0, 1, 2], [1, 4, 3]]);
    let error = message(read(Ply, ascii(header, &format!("{rows}3 0 1 -2\n"))));
    assert!(error.contains("strip 0 has vertices that are whole numbers"), "{error}");
}

#[test]
fn numbers_of_text_are_those_that_others_write() {
    let more = "property float nx\nproperty float ny\nproperty float nz\nproperty float quality\n";
    let parsed = |rows: &str| read(Ply, square(more, "1", &format!("{rows}3 0 1 2\n")));
    let plain = parsed("0 0 0 0 0 1 0\n2 0 0 0 0 1 0\n0 2 0 0 0 1 0\n9 9 9 0 0 1 0\n").unwrap();
    let dots =
        "0. .0 +0 0. 0. 1. nan\n2. -0. 0 0 0 1 inf\n.0 2e0 0 0 0 1 -NaN\n9 9 9 0 0 1 1.#QNAN\n";
    assert_eq!(parsed(dots).unwrap(), plain);
    let note = "the property \"quality\" of the element \"vertex\" was left out";
    assert_eq!(plain.notes, [note]);
    // Normals that are none.
    let rows = "0 0 0 nan nan nan 0\n2 0 0 -nan(ind) 0 1 0\n0 2 0 0 0 1 0\n9 9 9 0 0 1 0\n";
    let model = parsed(rows).unwrap();
    assert_eq!(only(&model).positions, only(&plain).positions);
    assert!(
        only(&model).normals.is_none() && model.notes[1].contains("normals"),
        "{:?}",
        model.notes
    );
    for (row, expected) in [
        ("0 1,5 0 0 0 1 0", "mesh:14: vertex 0 has a number as \"y\", and \"1,5\" is none"),
        ("0 1 0 0 0 1 0,5", "mesh:14: vertex 0 has a number as \"quality\", and \"0,5\" is none"),
        ("0 1 0 0 0 1", "mesh:14: vertex 0 has the property \"quality\", and the line ends"),
        (
            "0 1 0 0 0 1 0 7",
            "mesh:14: vertex 0 has the properties of the header, and \"7\" follows",
        ),
        ("0 nan 0 0 0 1 0", "positions are finite, and vertex 0 is at [0.0, NaN, 0.0]"),
    ] {
        let error =
            message(parsed(&format!("{row}\n2 0 0 0 0 1 0\n0 2 0 0 0 1 0\n9 9 9 0 0 1 0\n")));
        assert!(error.contains(expected), "{row}: {error}");
    }
}

/// The reader of another crate finds the same numbers.
#[test]
fn rows_are_those_of_ply_rs() {
    use ply_rs_bw::parser::Parser;
    use ply_rs_bw::ply::{DefaultElement, Property};
    let header = "element vertex 3\nproperty float x\nproperty double y\nproperty short z\n\
                  element face 1\nproperty list uchar uint vertex_indices\n";
    let mut bytes = format!("ply\nformat binary_big_endian 1.0\n{header}end_header\n").into_bytes();
    for (x, y, z) in [(0.5_f32, 1.25_f64, -3_i16), (1e-3, 7.0, 300), (4.0, -2.0, 12)] {
        bytes.extend(x.to_be_bytes());
        bytes.extend(y.to_be_bytes());
        bytes.extend(z.to_be_bytes());
    }
    bytes.push(3);
    bytes.extend([2_u32, 0, 1].iter().flat_map(|vertex| vertex.to_be_bytes()));
    let model = read(Ply, &bytes).unwrap();
    let theirs = Parser::<DefaultElement>::new().read_ply(&mut &bytes[..]).unwrap();
    for (row, ours) in theirs.payload["vertex"].iter().zip(&only(&model).positions) {
        let [Property::Float(x), Property::Double(y), Property::Short(z)] =
            ["x", "y", "z"].map(|name| row[name].clone())
        else {
            panic!("{row:?}")
        };
        assert_eq!(*ours, [x, y as f32, f32::from(z)]);
    }
    let Property::ListUInt(corners) = &theirs.payload["face"][0]["vertex_indices"] else {
        panic!()
    };
    assert_eq!(only(&model).faces[0][..], corners[..]);
}

/// A file whose vertices and faces have these properties more, each with a value; texture coordinates
/// need no image to be there.
fn with(of_vertices: &[(&str, &str)], of_faces: &[(&str, &str)]) -> Result<Model, SceneError> {
    let lines = |all: &[(&str, &str)]| -> String {
        all.iter().map(|(property, _)| format!("property {property}\n")).collect()
    };
    let values = |all: &[(&str, &str)]| -> String {
        all.iter().map(|(_, value)| format!(" {value}")).collect()
    };
    let (vertex, face) = (values(of_vertices), values(of_faces));
    let header = format!(
        "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n{}element face 1\n\
         property list uchar int vertex_indices\n{}",
        lines(of_vertices),
        lines(of_faces)
    );
    let rows = format!("0 0 0{vertex}\n1 0 0{vertex}\n0 1 0{vertex}\n3 0 1 2{face}\n");
    read(Ply, ascii(&header, &rows))
}

#[test]
fn each_property_is_read_or_a_note_names_it() {
    let bare = with(&[], &[]).unwrap();
    // What is read, and what is left out alone. Where a property is one of several, the others are beside it.
    let groups = [
        "nx ny nz",
        "red green blue",
        "diffuse_red diffuse_green diffuse_blue",
        "r g b",
        "s t",
        "u v",
        "texture_u texture_v",
        "texture_s texture_t",
        "nx ny",
        "red green",
        "red green b",
        "s v",
        "s",
        "X",
        "quality",
        "confidence",
        "intensity",
        "radius",
        "flags",
        "scalar_Label",
        "f_dc_0",
        "ambient_red",
        "hello",
    ];
    for group in groups {
        let names: Vec<&str> = group.split(' ').collect();
        let floats: Vec<String> = names.iter().map(|name| format!("float {name}")).collect();
        for (k, name) in names.iter().enumerate() {
            let parsed = |value: &str| {
                let extra: Vec<(&str, &str)> = (0..names.len())
                    .map(|j| (&*floats[j], if j == k { value } else { "0.5" }))
                    .collect();
                [with(&extra, &[]).unwrap(), with(&[], &extra).unwrap()]
            };
            for (a, b) in parsed("0.25").into_iter().zip(parsed("0.75")) {
                let is_named = a.notes.iter().any(|note| note.contains(&format!("{name:?}")));
                let is_read = a.geometries != b.geometries;
                assert!(is_named != is_read, "{name} of {group}: {:?}", a.notes);
            }
        }
    }
    let lists =
        with(&[("list uchar int hello", "2 5 6")], &[("list int float you", "1 7")]).unwrap();
    let expected = [
        "the property \"hello\" of the element \"vertex\" was left out",
        "the property \"you\" of the element \"face\" was left out",
    ];
    assert_eq!(lists.notes, expected);
    assert_eq!(lists.geometries, bare.geometries);
    // The list of another type than the number, and the other way round.
    for extra in [("list uchar float nx", "1 5"), ("list uchar float vertex_index", "3 2 1 0")] {
        assert!(with(&[extra], &[]).unwrap().notes[0].contains("left out"), "{extra:?}");
        assert!(with(&[], &[extra]).unwrap().notes[0].contains("left out"), "{extra:?}");
    }
    // Opacities say something where they are not full.
    for (kind, full, other) in
        [("uchar", "255", "254"), ("float", "1", "0.5"), ("ushort", "65535", "1")]
    {
        for name in ["alpha", "diffuse_alpha", "a"] {
            let property = format!("{kind} {name}");
            let notes = |value| {
                [
                    with(&[(&property, value)], &[]).unwrap().notes,
                    with(&[], &[(&property, value)]).unwrap().notes,
                ]
            };
            let message = ["vertices", "faces"]
                .map(|parsed| vec![format!("opacities of {parsed} were left out")]);
            assert_eq!([notes(full), notes(other)], [[vec![], vec![]], message], "{property}");
        }
    }
    assert!(with(&[], &[("int texnumber", "0")]).unwrap().notes.is_empty());
    let others = with(&[], &[("int texnumber", "1")]).unwrap().notes;
    assert_eq!(others, ["faces name materials or images, and the file has none"]);
}

/// Whatever an element or a property that nobody reads is called, and of whatever type it is.
#[test]
fn any_name_that_is_not_read_is_in_a_note_and_changes_nothing() {
    let bare = with(&[], &[]).unwrap();
    let mut state = 5_u32;
    let mut below = |count: usize| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as usize % count
    };
    let types = [
        ("char", "-1"),
        ("uint16", "7"),
        ("int", "3"),
        ("float32", "nan"),
        ("double", ".5"),
        ("list uchar int", "2 0 1"),
        ("list int float", "0"),
    ];
    for _ in 0..300 {
        let letters = "abcxyz_09XÄ-.".chars().collect::<Vec<_>>();
        let mut name: String = (0..1 + below(6)).map(|_| letters[below(13)]).collect();
        // Longer than all that are read.
        name.push_str("_of_somebody");
        let (kind, value) = types[below(types.len())];
        let property = format!("{kind} {name}");
        let extra = [(&*property, value)];
        let model = match below(2) {
            0 => with(&extra, &[]),
            _ => with(&[], &extra),
        };
        let model = model.unwrap();
        assert!(model.notes.len() == 1 && model.notes[0].contains(&format!("{name:?}")), "{name}");
        assert_eq!(Model { notes: vec![], ..model }, bare, "{property}");
        let lists = format!("element {name} 2\nproperty {property}\n");
        let text = square(&lists, "1", &format!("{SQUARE}{value}\n{value}\n3 0 1 2\n"));
        let model = read(Ply, text).unwrap();
        assert_eq!(model.notes, [format!("the element {name:?} was left out")]);
        assert_eq!(only(&model).faces, [[0, 1, 2]]);
    }
}

#[test]
fn coordinates_are_at_vertices_or_at_corners_and_v_is_up() {
    for names in [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]] {
        let more = names.map(|name| format!("property float {name}\n")).concat();
        let rows = "0 0 0 0 0.25\n1 0 0 1 0\n1 1 0 1 1\n0 1 0 0 1\n3 0 1 2\n";
        let model = read(Ply, square(&more, "1", rows)).unwrap();
        assert_eq!(of_corners(&only(&model).coordinates), [[0.0, 0.75], [1.0, 1.0], [1.0, 0.0]]);
    }
    let header = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 2\nproperty list uchar int vertex_indices\n\
                  property list uchar float texcoord\n";
    let parsed = |rows: &str| read(Ply, ascii(header, &format!("{SQUARE}{rows}")));
    let model = parsed("4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 2 6 0 0 0.5 0 0.5 0.5\n").unwrap();
    let [a, b, c, d] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    let last = [a, [0.5, 1.0], [0.5, 0.5]];
    let expected = [[a, b, c], [a, c, d], last].concat();
    assert_eq!(of_corners(&only(&model).coordinates), expected);
    let model = parsed("4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 2 0\n").unwrap();
    assert!(only(&model).coordinates.is_none());
    assert!(model.notes[0].contains("not all faces"), "{:?}", model.notes);
    let error = message(parsed("4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 2 4 0 0 0 0\n"));
    assert!(error.contains("mesh:16: face 1 has two coordinates at each of 3 corners"), "{error}");
}

#[test]
fn the_image_of_the_header_is_the_base_colour() {
    let picture = Picture { width: 1, height: 1, channels: 1, samples: Samples::U8(vec![7]) };
    let png = picture.encode_png(&Location::new("image")).unwrap();
    let text = square("comment TextureFile the image.png\n", "1", &format!("{SQUARE}3 0 1 2\n"));
    let folder = tempfile::tempdir().unwrap();
    let model = read_with(Ply, &text, &[("the image.png", &png)], folder.path()).unwrap();
    assert_eq!(model.images, [picture]);
    assert_eq!(model.materials[0].base_color_map.image, Some(0));
    assert!(only(&model).materials().eq([Some(0)]));
    let model = read(Ply, &text).unwrap();
    assert!(model.images.is_empty() && model.notes[0].contains("missing"), "{:?}", model.notes);
}

#[test]
fn what_is_not_used_is_read_over() {
    let header = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  property uchar alpha\nproperty list uchar int things\n\
                  element edge 1\nproperty int a\nproperty int b\n\
                  element face 2\nproperty list uchar int vertex_indices\n";
    let rows = "0 0 0 1 0\n1 0 0 2 2 5 6\n\n0 1 0 3 0\n0 1\n2 0 1\n3 0 1 2";
    let model = read(Ply, ascii(header, rows)).unwrap();
    assert_eq!(only(&model).faces, [[0, 1, 2]]);
    let notes = model.notes.join("; ");
    for expected in ["opacities", "\"things\"", "\"edge\"", "fewer than three corners"] {
        assert!(notes.contains(expected), "{notes}");
    }
}

#[test]
fn errors_have_the_place_and_the_rule() {
    let vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\n";
    let face = "element face 1\nproperty list uchar int vertex_indices\n";
    let cases = [
        ("plx\n".to_owned(), "begins with the line ply"),
        ("ply\nformat ascii 1.0\n".to_owned(), "a header ends with the line end_header"),
        ("ply\nformat ascii 9\nend_header\n".to_owned(), "mesh:2: a format is ascii"),
        ("ply\nend_header\n".to_owned(), "a header has a line that begins with format"),
        (
            ascii(&format!("Made by hand\n{vertex}{face}"), ""),
            "mesh:3: a line of a header begins with ply, format, comment, obj_info, element, \
             property, end_header, and this begins with \"Made\"",
        ),
        (ascii(vertex, "0 0 0\n"), "a mesh has the element face, and this has none"),
        (ascii(&format!("{vertex}{}", face.replace('1', "0")), "0 0 0\n"), "faces, and this has 0"),
        (ascii(&format!("{vertex}{vertex}{face}"), ""), "elements have different names"),
        (ascii(&format!("{vertex}property int x\n{face}"), ""), "properties have different names"),
        (ascii(&format!("{vertex}element a 7\n{face}"), "0 0 0\n3 0 0 0\n"), "7 rows of none"),
        (ascii(&format!("element vertex 1\nproperty int x\n{face}"), "0\n3 0 0 0\n"), "x, y and z"),
        (
            ascii(&format!("{vertex}element face 1\nproperty int a\n"), "0 0 0\n0\n"),
            "vertex_indices",
        ),
        (ascii(&format!("{vertex}{face}"), "0 0\n3 0 0 0 0 0\n"), "mesh:10: vertex 0 has"),
        (
            ascii(&format!("{vertex}{face}"), "0 0 nan\n3 0 0 0\n"),
            "positions are finite, and vertex 0",
        ),
        (ascii(&format!("{vertex}{face}"), "0 0 0\n3 0 0 -1\n"), "mesh:11: face 0 has"),
        (
            ascii(&format!("{vertex}{face}"), "0 0 0\n3 0 0 1\n"),
            "1 vertices, and a face names vertex 1",
        ),
        (ascii(&format!("{vertex}{face}"), "0 0 0\n9 0 0 0\n"), "mesh:11: face 0 has"),
    ];
    for (text, expected) in cases {
        let error = message(read(Ply, &text));
        assert!(error.contains(expected), "{text:?}: {error}");
    }
}

#[test]
fn faces_have_the_materials_that_they_name() {
    let file = |elements: &str, property: &str, faces: &str| {
        format!(
            "ply\nformat ascii 1.0\ncomment TextureFile a.png\ncomment TextureFile b.png\n\
             element vertex 4\nproperty float x\nproperty float y\nproperty float z\n{elements}\
             element face 3\nproperty list uchar int vertex_indices\nproperty int {property}\n\
             end_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n{faces}"
        )
    };
    let images = "3 0 1 2 1\n3 1 3 2 0\n3 0 3 2 1\n";
    let model = read(Ply, file("", "texnumber", images)).unwrap();
    let mesh = only(&model);
    assert_eq!(mesh.faces, [[0, 1, 2], [0, 3, 2], [1, 3, 2]]);
    let found: Vec<_> = mesh.submeshes.iter().map(|k| (k.material, k.faces.clone())).collect();
    assert_eq!(found, [(Some(1), 0..2), (Some(0), 2..3)]);
    assert_eq!(model.materials.len(), 2);
    let error = message(read(Ply, file("", "texnumber", &images.replace("2 0", "2 2"))));
    assert!(error.contains("has 2 materials") && error.contains("names number 2"), "{error}");
    let error = message(read(Ply, file("", "texnumber", &images.replace("2 0", "2 -2"))));
    assert!(error.contains("a whole number from 0 on, or -1, and this is -2"), "{error}");
    let rows = "element material 1\nproperty uchar diffuse_red\nproperty uchar diffuse_green\n\
                property uchar diffuse_blue\nproperty float roughness\nproperty int texnumber\n";
    let faces = "255 188 0 0.25 -1\n3 0 1 2 -1\n3 1 3 2 0\n3 0 3 2 -1\n";
    let model = read(Ply, file(rows, "material_index", faces)).unwrap();
    let found: Vec<_> =
        only(&model).submeshes.iter().map(|k| (k.material, k.faces.clone())).collect();
    assert_eq!(found, [(None, 0..2), (Some(0), 2..3)]);
    let [material] = &model.materials[..] else { panic!("{:?}", model.materials) };
    assert_eq!((material.roughness, material.metallic), (0.25, 0.0));
    let [red, green, blue, _] = material.base_color;
    assert!(red == 1.0 && (green - 0.5029).abs() < 1e-4 && blue == 0.0, "{green}");
}
