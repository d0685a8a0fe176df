//! What is read of PLY files.

use super::{of_corners, only, read, read_with, said};
use crate::error::Place;
use crate::mesh::MeshKind::Ply;
use crate::picture::{Picture, Samples};

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

#[test]
fn bytes_of_colours_are_decoded_and_floats_are_linear() {
    let of = |kind: &str, rows: &str| {
        let more = format!(
            "property {kind} red\nproperty {kind} green\nproperty {kind} blue\nproperty float nx\n\
             property float ny\nproperty float nz\n"
        );
        let text = square(&more, "1", &format!("{rows}3 0 1 2\n"));
        let model = read(Ply, text).unwrap();
        assert_eq!(of_corners(&only(&model).normals), [[0.0, 0.0, 1.0]; 3]);
        of_corners(&only(&model).colors)[0]
    };
    let rows = |color: &str| {
        format!(
            "0 0 0 {color} 0 0 1\n1 0 0 {color} 0 0 1\n0 1 0 {color} 0 0 2\n9 9 9 0 0 0 0 0 0\n"
        )
    };
    assert_eq!(of("float", &rows("0.5 0.25 2")), [0.5, 0.25, 2.0]);
    let [red, green, blue] = of("uchar", &rows("188 0 255"));
    assert!((red - 0.5029).abs() < 1e-4, "{red}");
    assert_eq!([green, blue], [0.0, 1.0]);
    let [wide, ..] = of("ushort", &rows("48316 0 65535"));
    assert!((wide - red).abs() < 1e-6, "{wide}");
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
    let of = |rows: &str| read(Ply, ascii(header, &format!("{SQUARE}{rows}")));
    let model = of("4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 2 6 0 0 0.5 0 0.5 0.5\n").unwrap();
    let [a, b, c, d] = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    let last = [a, [0.5, 1.0], [0.5, 0.5]];
    let expected = [[a, b, c], [a, c, d], last].concat();
    assert_eq!(of_corners(&only(&model).coordinates), expected);
    let model = of("4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 2 0\n").unwrap();
    assert!(only(&model).coordinates.is_none());
    assert!(model.notes[0].contains("not all faces"), "{:?}", model.notes);
    let error = said(of("4 0 1 2 3 8 0 0 1 0 1 1 0 1\n3 0 1 2 4 0 0 0 0\n"));
    assert!(error.contains("mesh:16: face 1 has two coordinates at each of 3 corners"), "{error}");
}

#[test]
fn the_image_of_the_header_is_the_base_colour() {
    let picture = Picture { width: 1, height: 1, channels: 1, samples: Samples::U8(vec![7]) };
    let png = picture.encode_png(&Place::of("image")).unwrap();
    let text = square("comment TextureFile the image.png\n", "1", &format!("{SQUARE}3 0 1 2\n"));
    let folder = tempfile::tempdir().unwrap();
    let model = read_with(Ply, &text, &[("the image.png", &png)], folder.path()).unwrap();
    assert_eq!(model.images, [picture]);
    assert_eq!(model.materials[0].base_color_image, Some(0));
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
    for expected in ["opacities", "\"edge\"", "fewer than three corners"] {
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
        ("ply\nformat ascii 9\nend_header\n".to_owned(), "mesh:2: a header has the lines"),
        ("ply\nend_header\n".to_owned(), "No format line found"),
        (
            ascii(&format!("Made by hand\n{vertex}{face}"), ""),
            "mesh:3: a line of a header begins with ply, format, comment, obj_info, element, \
             property, end_header, and this begins with \"Made\"",
        ),
        (ascii(vertex, "0 0 0\n"), "a mesh has the element face, and this has none"),
        (ascii(&format!("{vertex}{}", face.replace('1', "0")), "0 0 0\n"), "faces, and this has 0"),
        (ascii(&format!("{vertex}{vertex}{face}"), ""), "elements have different names"),
        (ascii(&format!("{vertex}property int x\n{face}"), ""), "elements have different names"),
        (ascii(&format!("{vertex}element a 7\n{face}"), "0 0 0\n3 0 0 0\n"), "7 rows of none"),
        (ascii(&format!("element vertex 1\nproperty int x\n{face}"), "0\n3 0 0 0\n"), "x, y and z"),
        (
            ascii(&format!("{vertex}element face 1\nproperty int a\n"), "0 0 0\n0\n"),
            "vertex_indices",
        ),
        (ascii(&format!("{vertex}{face}"), "0 0\n3 0 0 0 0 0\n"), "mesh:10: vertex 0 has"),
        (ascii(&format!("{vertex}{face}"), "0 0 nan\n3 0 0 0\n"), "mesh:10: vertex 0 has"),
        (ascii(&format!("{vertex}{face}"), "0 0 0\n3 0 0 -1\n"), "mesh:11: face 0 has"),
        (
            ascii(&format!("{vertex}{face}"), "0 0 0\n3 0 0 1\n"),
            "1 vertices, and a face names vertex 1",
        ),
        (ascii(&format!("{vertex}{face}"), "0 0 0\n9 0 0 0\n"), "mesh:11: face 0 has"),
    ];
    for (text, expected) in cases {
        let error = said(read(Ply, &text));
        assert!(error.contains(expected), "{text:?}: {error}");
    }
}
