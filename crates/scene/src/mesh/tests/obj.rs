//! What is read of OBJ and MTL files.

use std::io::BufReader;

use bokashi_render_ops::TextureBorder;

use super::{at_corners, message, of_corners, only, read, read_with};
use crate::error::{Location, SceneError};
use crate::mesh::MeshKind::Obj;
use crate::mesh::colors::decoded;
use crate::model::{Model, NO_ROW};
use crate::picture::{Picture, Samples};

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

/// A PNG of one row, whose pixels have three channels.
fn png(samples: &[u8]) -> Vec<u8> {
    let width = samples.len() / 3;
    let picture = Picture { width, height: 1, channels: 3, samples: Samples::U8(samples.to_vec()) };
    picture.encode_png(&Location::new("image")).unwrap()
}

#[test]
fn a_face_of_five_corners_is_three_triangles() {
    let text = "v 0 0 0\nv 2 0 0\nv 3 1 0\nv 1 2 0\nv -1 1 0\nf 1 2 3 4 5\n";
    let model = read(Obj, text).unwrap();
    assert_eq!(only(&model).faces, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
    assert_eq!(model.placed.len(), 1);
}

#[test]
fn corners_name_positions_coordinates_and_normals_from_either_end() {
    let text = format!(
        "{TRIANGLE}vt 0 0\nvt 0.5 0.25\nvn 0 0 1\nvn 0 0 -1\n\
         f 1/1/1 2/2/2 3/1/1\nf -3/-2/-2 -2/-1/-1 -1/-2/-2\n"
    );
    let model = read(Obj, text).unwrap();
    let mesh = only(&model);
    assert_eq!(mesh.faces, [[0, 1, 2]; 2]);
    // v is up in the file and down here.
    let corners = [[0.0, 1.0], [0.5, 0.75], [0.0, 1.0]];
    assert_eq!(of_corners(&mesh.coordinates), [corners, corners].concat());
    assert_eq!(of_corners(&mesh.normals)[1], [0.0, 0.0, -1.0]);
    assert!(mesh.colors.is_none() && mesh.materials().eq([None]));
}

#[test]
fn faces_may_come_before_their_vertices_and_lines_go_on() {
    let text = format!("f 1 2 \\\n 3 # a corner each\n{TRIANGLE}v 1 1 0 # the last\nf 2 4 3");
    assert_eq!(only(&read(Obj, text).unwrap()).faces, [[0, 1, 2], [1, 3, 2]]);
}

#[test]
fn colours_follow_positions_as_srgb_and_a_fourth_number_divides() {
    let parsed = |white: f32| {
        let numbers = [0.5, 0.25, 1.0].map(|x| x * white);
        let [r, g, b] = numbers;
        let text = format!("v 0 0 0 {r} {g} {b}\nv 1 0 0 0 0 0 1\nv 0 1 0 0 0 0\nf 1 2 3\n");
        let model = read(Obj, text).unwrap();
        (of_corners(&only(&model).colors), model.notes)
    };
    // By the curve of IEC 61966-2-1.
    let expected = [0.214_041_14, 0.050_876_09, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    for (white, notes) in [(1.0, 0), (255.0, 1)] {
        let (found, message) = parsed(white);
        approx::assert_abs_diff_eq!(found.as_flattened(), &expected[..], epsilon = 1e-6);
        assert_eq!(message.len(), notes, "{message:?}");
    }
    let text = "v 0 0 0\nv 2 0 0 2\nv 0 1 0\nf 1 2 3\n";
    assert_eq!(only(&read(Obj, text).unwrap()).positions[1], [1.0, 0.0, 0.0]);
}

#[test]
fn attributes_that_some_corners_lack_are_left_out_of_that_mesh_alone() {
    // Of the two objects the second one has colours, coordinates and normals at all of its corners.
    let text = "v 0 0 0\nv 1 0 0\nv 0 2 0 1 1 1\nv 0 1 0 1 1 1\nv 0 0 1 .5 .5 .5\nv 1 0 1 0 0 0\nvt 0 0\n\
                vn 0 0 1\no a\nf 1/1/1 2//1 3/1\no b\nf 4/1/1 5/1/1 6/1/1\n";
    let model = read(Obj, text).unwrap();
    let [a, b] = &model.geometries[..] else { panic!("{}", model.geometries.len()) };
    assert!(a.colors.is_none() && a.coordinates.is_none() && a.normals.is_none());
    let grey = decoded(0.5);
    assert_eq!(of_corners(&b.colors), [[1.0; 3], [grey; 3], [0.0; 3]]);
    assert_eq!([&*a.name, &*b.name], ["a", "b"]);
    assert_eq!(model.notes.len(), 3, "{:?}", model.notes);
}

#[test]
fn a_surface_of_several_materials_is_one_mesh_with_one_set_of_vertices() {
    let text = format!(
        "{TRIANGLE}v 1 1 0\nmtllib m.mtl\no a\nusemtl x\nf 1 2 3\nusemtl y\nf 1 2 4\n\
         usemtl x\ng part\nf 2 4 3\no a\nf 1 3 4\nusemtl z\nf 1 4 3\n"
    );
    let folder = tempfile::tempdir().unwrap();
    let mtl = b"newmtl y\nKd 1 0 0\nnewmtl unused\nnewmtl x\nKd 0 1 0\nd 0.5\n";
    let model = read_with(Obj, text, &[("m.mtl", mtl)], folder.path()).unwrap();
    let mesh = only(&model);
    assert_eq!(mesh.positions.len(), 4);
    assert_eq!(mesh.faces, [[0, 1, 2], [1, 3, 2], [0, 2, 3], [0, 1, 3], [0, 3, 2]]);
    let found: Vec<_> = mesh.submeshes.iter().map(|k| (k.material, k.faces.clone())).collect();
    assert_eq!(found, [(Some(0), 0..3), (Some(1), 3..4), (None, 4..5)]);
    assert_eq!(mesh.submesh(3), Some(&mesh.submeshes[1]));
    assert_eq!(mesh.submesh(5), None);
    let names: Vec<&str> = model.materials.iter().map(|material| &*material.name).collect();
    assert_eq!(names, ["x", "y"]);
    assert_eq!(model.materials[0].base_color, [0.0, 1.0, 0.0, 0.5]);
    let expected = [
        "the material \"z\" is missing and was left out",
        "an object shares vertices with another one, and became one mesh with it",
    ];
    assert_eq!(model.notes, expected);
}

#[test]
fn objects_are_joined_along_a_chain_of_shared_vertices_and_no_further() {
    let vertices = (0..12).map(|k| format!("v {k} {} {}\n", k * k, k % 3)).collect::<String>();
    // The second shares no vertex with the first, but the last one shares vertices with both.
    let text = format!("{vertices}o a\nf 1 2 3\no b\nf 4 5 6\no c\nf 7 8 9\no d\nf 3 4 10\n");
    let model = read(Obj, text).unwrap();
    let found: Vec<_> = model.geometries.iter().map(|g| (&*g.name, g.faces.len())).collect();
    assert_eq!(found, [("a", 3), ("c", 1)]);
    assert_eq!(model.geometries[0].positions.len(), 7);
}

#[test]
fn parts_keep_the_attributes_that_they_have() {
    let text = format!(
        "{TRIANGLE}v 1 1 0\nvt 0 0\nvt 1 0\nvn 0 0 1\nusemtl x\nf 1/1 2/2 3/1\nusemtl y\n\
         f 2//1 4//1 3//1\n"
    );
    let model = read(Obj, text).unwrap();
    let mesh = only(&model);
    let coordinates = mesh.coordinates.as_ref().unwrap();
    assert_eq!(coordinates.faces, [[0, 1, 0], [NO_ROW; 3]]);
    assert_eq!(mesh.normals.as_ref().unwrap().faces, [[NO_ROW; 3], [0; 3]]);
    assert!(coordinates.covers(&(0..1)) && !coordinates.covers(&(1..2)));
}

#[test]
fn vertices_of_two_numbers_stay_two_with_a_note() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 4 5 6\n";
    let model = read(Obj, text).unwrap();
    assert_eq!(only(&model).positions.len(), 6);
    assert!(model.notes[0].contains("lies where another one does"), "{:?}", model.notes);
}

#[test]
fn materials_have_images_and_factors() {
    let mtl = b"newmtl a b\nKd 0.5 0.25 1\nTr 0.25\nPr 0.5\nPm 0.75\n\
                map_Kd -o 0 0 0 -clamp on images\\the color.png\n\
                norm -bm 2 images/normal.png\nmap_Bump height.png\n\
                newmtl packed\nmap_Pr images/rough.png\nmap_Pm images/normal.png\n\
                newmtl same\nmap_Kd -clamp off images/rough.png\n";
    let text = format!(
        "mtllib sub/the material.mtl\n{TRIANGLE}usemtl a b\nf 1 2 3\nusemtl packed\nf 1 3 2\n\
         usemtl same\nf 1 2 3\n"
    );
    let images = [png(&[1, 2, 3]), png(&[4, 5, 6]), png(&[7, 8, 9])];
    let files: [(&str, &[u8]); 4] = [
        ("sub/the material.mtl", mtl),
        ("sub/images/the color.png", &images[0]),
        ("sub/images/normal.png", &images[1]),
        ("sub/images/rough.png", &images[2]),
    ];
    let folder = tempfile::tempdir().unwrap();
    let model = read_with(Obj, text, &files, folder.path()).unwrap();
    let image = |number: Option<usize>| match &model.images[number.unwrap()].samples {
        Samples::U8(samples) => samples.clone(),
        other => panic!("{other:?}"),
    };
    let [a, packed, same] = &model.materials[..] else { panic!("{:?}", model.materials) };
    assert_eq!(a.base_color, [0.5, 0.25, 1.0, 0.75]);
    assert_eq!([a.roughness, a.metallic, a.normal_scale], [0.5, 0.75, 2.0]);
    assert_eq!(image(a.base_color_map.image), [1, 2, 3]);
    assert_eq!(a.base_color_map.borders, [TextureBorder::Clamp; 2]);
    assert_eq!(a.normal_map.borders, [TextureBorder::Wrap; 2]);
    assert_eq!(image(a.normal_map.image), [4, 5, 6]);
    // Roughness in green, metallic in blue: the first channels of both.
    assert_eq!(image(packed.metallic_roughness_map.image), [255, 7, 4]);
    assert_eq!([packed.roughness, packed.metallic], [1.0, 1.0]);
    assert_eq!(image(same.base_color_map.image), [7, 8, 9]);
    assert_eq!(same.base_color_map.borders, [TextureBorder::Wrap; 2]);
    assert_eq!([same.roughness, same.metallic], [1.0, 0.0]);
    assert_eq!(model.images.len(), 4);
    let notes = model.notes.join("; ");
    assert_eq!(notes, "a height map of a material was left out");
}

#[test]
fn missing_and_broken_images_are_notes_and_those_outside_are_errors() {
    let text = format!("mtllib m.mtl\n{TRIANGLE}usemtl m\nf 1 2 3\n");
    let folder = tempfile::tempdir().unwrap();
    let model = read_with(Obj, &text, &[], folder.path()).unwrap();
    assert_eq!(model.notes.len(), 2, "{:?}", model.notes);
    let mtl: (&str, &[u8]) = ("m.mtl", b"newmtl m\nmap_Kd a.png\n");
    let model = read_with(Obj, &text, &[mtl], folder.path()).unwrap();
    assert_eq!(model.notes, ["the image \"a.png\" is missing and was left out"]);
    assert_eq!(model.materials[0].base_color_map.image, None);
    // TGA and WebP, which are not read, and a PNG that is cut short.
    let webp = b"RIFF\x1a\0\0\0WEBPVP8L";
    for broken in [&b"\0\0\x02\0"[..], webp, &png(&[1, 2, 3])[..40]] {
        let model = read_with(Obj, &text, &[mtl, ("a.png", broken)], folder.path()).unwrap();
        let note = "the image \"a.png\" can't be read and was left out: ";
        assert!(model.notes.len() == 1 && model.notes[0].starts_with(note), "{:?}", model.notes);
        assert_eq!([model.materials.len(), model.images.len()], [1, 0]);
    }
    let leaves: (&str, &[u8]) = ("m.mtl", b"newmtl m\nmap_Kd ../../../../../../etc/passwd\n");
    let found = read_with(Obj, &text, &[leaves], folder.path());
    assert!(matches!(found, Err(SceneError::Outside { .. })), "{found:?}");
}

#[test]
fn errors_have_the_line_and_the_rule() {
    let cases = [
        ("v 1 2\n", "mesh:1: a vertex has 3 numbers or more, and this has 2"),
        ("v 1 2 x\n", "mesh:1: a vertex has finite numbers, and \"x\" is none"),
        ("v 1 2 nan\n", "mesh:1: a vertex has finite numbers, and \"nan\" is none"),
        ("\nv 1 2 3e50\n", "mesh:2: a vertex has finite numbers, and \"3e50\" is none"),
        ("v 1 2 3 0\n", "mesh:1: a position is finite, and this is [inf, inf, inf]"),
        ("v 1 2 3 1e-300\n", "mesh:1: a position is finite, and this is ["),
        ("v 1 2 3 4 5 6 7 8\n", "mesh:1: a vertex has at most 7 numbers, and there are more"),
        ("vt\n", "mesh:1: a texture coordinate has 1 numbers or more, and this has 0"),
        ("v 0 0 0\n\\\n\nf 1 1 2\n", "mesh:4: the file has 1 of the kind \"vertex\", and a face"),
        ("v 0 0 0\nf 1/1 1 1\n", "mesh:2: the file has 0 of the kind \"texture coordinate\""),
        ("v 0 0 0\nf 1//-1 1 1\n", "mesh:2: a normal has a number from 1 on or back to -0"),
        ("v 0 0 0\nf 0 1 1\n", "mesh:2: a vertex has a number from 1 on or back to -1"),
        ("v 0 0 0\nf -2 1 1\n", "mesh:2: a vertex has a number from 1 on or back to -1"),
        ("f 9223372036854775807 1 1\n", "mesh:1: a vertex has a number from 1 on"),
        ("f -9223372036854775808 1 1\n", "mesh:1: a vertex has a number from 1 on"),
        ("f 4294967296 1 1\n", "mesh:1: a vertex has a number from 1 on"),
        ("f 99999999999999999999 1 1\n", "mesh:1: a corner has whole numbers"),
        ("f 1/2/3/4 1 1\n", "mesh:1: a corner names a vertex, a texture coordinate and a normal"),
        ("f 1 2 a\n", "mesh:1: a corner has whole numbers, and this is \"a\""),
        ("f /1 1 1\n", "mesh:1: a corner has whole numbers, and this is \"/1\""),
        ("", "has a face with three vertices, and this has none"),
        ("v 0 0 0\nl 1 1\np 1\n", "this has none; lines were left out; points were left out"),
    ];
    for (text, expected) in cases {
        let error = message(read(Obj, text));
        assert!(error.contains(expected), "{text:?}: {error}");
    }
    let text = format!("{TRIANGLE}f 1 2 3\nmtllib m.mtl\nusemtl m\n");
    let folder = tempfile::tempdir().unwrap();
    let mtl: (&str, &[u8]) = ("m.mtl", b"newmtl m\nKd 1 x 0\n");
    let error = message(read_with(Obj, text, &[mtl], folder.path()));
    assert!(error.contains("m.mtl:2: Kd has finite numbers"), "{error}");
}

/// tobj reads well-formed files as we do.
#[test]
fn triangles_are_those_of_tobj() {
    let mut text = String::new();
    for k in 0..60 {
        // Corners that follow each other on a parabola are a convex polygon.
        let [x, y, z] = [k, k * k, 2 * k];
        text.push_str(&format!("v {x} {y}.5 {z}e-1\nvt 0.{k} 0.5\nvn 0.6 0 -0.8\n"));
    }
    for k in 1..50 {
        let corner = |k: usize| format!(" {k}/{}/{}", k + 1, k + 2);
        text.push('f');
        (0..3 + k % 4).for_each(|j| text.push_str(&corner(k + j)));
        text.push('\n');
    }
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let loaded = tobj::load_obj_buf(&mut BufReader::new(text.as_bytes()), &options, |_| {
        Ok((Vec::new(), Default::default()))
    });
    let theirs = loaded.unwrap().0.remove(0).mesh;
    let of_three = |numbers: &[f32], indices: &[u32]| {
        let row = |&k: &u32| std::array::from_fn(|j| numbers[3 * k as usize + j]);
        indices.iter().map(row).collect::<Vec<[f32; 3]>>()
    };
    let model = read(Obj, &text).unwrap();
    let ours = only(&model);
    assert!(ours.faces.len() > 100);
    let corners = at_corners(&ours.positions, &ours.faces);
    assert_eq!(corners, of_three(&theirs.positions, &theirs.indices));
    let coordinate =
        |&k: &u32| [theirs.texcoords[2 * k as usize], 1.0 - theirs.texcoords[2 * k as usize + 1]];
    let expected: Vec<[f32; 2]> = theirs.texcoord_indices.iter().map(coordinate).collect();
    assert_eq!(of_corners(&ours.coordinates), expected);
}

#[test]
fn a_file_without_faces_says_what_else_it_has_in_short() {
    let points = message(read(Obj, "v 0 0 0\np 1\nl 1 1\n"));
    let rule = "a mesh file has a face with three vertices, and this has none";
    assert!(
        points.ends_with(&format!("{rule}; points were left out; lines were left out")),
        "{points}"
    );
    let many: String = (0..50).map(|k| format!("usemtl {k}\n")).collect();
    let many = message(read(Obj, many));
    assert!(many.ends_with("\"2\" is missing and was left out; and more was left out"), "{many}");
}

#[test]
fn keywords_are_of_any_case_and_options_may_follow_the_path() {
    let text = format!("mtllib \"a m.mtl\"\n{TRIANGLE}usemtl m\nf 1 2 3\n");
    let folder = tempfile::tempdir().unwrap();
    let image = png(&[1, 2, 3]);
    let parsed = |line: &str| {
        let mtl = format!("# by hand\nNewMtl m\n{line}\n");
        let files: [(&str, &[u8]); 2] = [("a m.mtl", mtl.as_bytes()), ("a -b c.png", &image)];
        let model = read_with(Obj, &text, &files, folder.path()).unwrap();
        assert_eq!(model.materials[0].base_color_map.image, Some(0), "{line}: {:?}", model.notes);
        model.notes
    };
    let none: [&str; 0] = [];
    for line in [
        "map_kd a -b c.png",
        "MAP_KD a -b c.png",
        "map_Kd \"a -b c.png\"",
        "map_Kd a -b c.png -s 1 1 1",
        "map_Kd -o 0 0 0 a -b c.png -S 1.0 1 1 -mm 0 1 -clamp OFF",
        "map_Kd a -b c.png\nKd 1 1 1\nKe 0 0 0",
    ] {
        assert_eq!(parsed(line), none, "{line}");
    }
    let moved = "the option -s of an image was left out";
    assert_eq!(parsed("map_Kd a -b c.png -s 2 2 2"), [moved]);
    assert_eq!(parsed("map_Kd -clamp off -s 2 2 a -b c.png -mm 0 1"), [moved]);
    assert_eq!(parsed("map_Kd -mm 0.5 1 a -b c.png"), ["the option -mm of an image was left out"]);
    // The format says so.
    let black = "the material \"m\" is black: its Kd of 0 multiplies its image";
    assert_eq!(parsed("Kd 0 0 0\nmap_Kd a -b c.png"), [black]);
    let twice = "the material \"m\" is described again: the last time counts";
    assert_eq!(parsed("Kd 0 1 0\nnewmtl m\nmap_Kd a -b c.png"), [twice]);
}

/// What is read of an OBJ file with these lines more, beside a material with these.
fn with(lines: &str, of_material: &str) -> Model {
    let text = format!("mtllib m.mtl\n{TRIANGLE}usemtl m\n{lines}\nf 1 2 3\n");
    let mtl = format!("newmtl m\nKd 1 0 0\n{of_material}\n");
    let folder = tempfile::tempdir().unwrap();
    read_with(Obj, text, &[("m.mtl", mtl.as_bytes())], folder.path()).unwrap()
}

#[test]
fn each_statement_is_read_or_a_note_names_it() {
    let bare = with("", "");
    assert!(bare.notes.is_empty(), "{:?}", bare.notes);
    // Of the format's words those that are not read, and some that are none.
    let words = "vp deg bmat step cstype parm trim hole scrv sp end con mg bevel c_interp d_interp lod \
                 shadow_obj trace_obj ctech stech maplib usemap call csh V F vx fx hello ß";
    for word in words.split_whitespace() {
        let model = with(&format!("{word} 1 2 3"), "");
        let expected = format!("the statement {word:?} was left out");
        assert_eq!(model.notes, [expected]);
        assert_eq!(Model { notes: vec![], ..model }, bare);
    }
    let words = "Ka Ks Ke Ns Ni Tf illum sharpness Pc Pcr Ps aniso anisor map_Ka map_Ks map_Ns map_aat \
                 disp decal refl map_refl hello";
    for word in words.split_whitespace() {
        let model = with("", &format!("{word} 1 2 3"));
        let expected = format!("the statement {word:?} of materials was left out");
        assert_eq!(model.notes, [expected]);
        assert_eq!(Model { notes: vec![], ..model }, bare);
    }
    let both = with("b 1\na 2\nb 3", "d 1\nb 2\na 3");
    let expected = [
        "the statements \"a\", \"b\" were left out",
        "the statements \"a\", \"b\" of materials were left out",
    ];
    assert_eq!(both.notes, expected);
    // Numbers beyond those that are read.
    for (lines, part) in [
        ("vt 0 0 0.5", "third texture coordinates"),
        ("v 0 0 0 1 1", "five numbers"),
        ("v 0 0 0 1 1 1 0.5", "opacities"),
        ("s off", "smoothing groups"),
        ("s 1\nf 1 2 3\ns 2", "smoothing groups"),
        ("p 1", "points"),
        ("l 1 2", "lines"),
        ("curv 1 2", "curves"),
    ] {
        let notes = with(lines, "").notes;
        assert!(notes.len() == 1 && notes[0].contains(part), "{lines}: {notes:?}");
    }
    // What says nothing that is not done.
    for lines in ["vt 0 0 0", "v 0 0 0 1 1 1 1", "s 1", "g a b", "# hello", ""] {
        let notes = with(lines, "").notes;
        assert!(notes.is_empty(), "{lines}: {notes:?}");
    }
}
