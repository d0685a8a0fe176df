//! Meshes of scenes: where they stand, what they are made of, and what is written of them.

use std::fs;
use std::path::Path;

use bokashi_scene::glam::{DMat4, DVec3};
use bokashi_scene::{
    Borders, Folder, Geometry, Indexed, MaterialFile, MaterialMap, Model, Placed, Scene, SceneFit,
    Submesh, glb, read_model,
};

use super::fixtures::{furthest, load, picture, png, value};

#[test]
fn an_instance_stands_where_the_place_of_its_mesh_leads_it() {
    let folder = tempfile::tempdir().unwrap();
    let text = "[[meshes]]\nshape = \"cube\"\n\
        place = { scale = 2, rotation = [0, 0, 1, 1], translation = [5, 0, 0] }\n\
        instances = [{ translation = [1, 0, 0] }]\n";
    let scene = load(folder.path(), text);
    let [first, second] = scene.objects[0].places[..] else { panic!("two places") };
    // A quarter of a turn about z brings x to y.
    let expected = |x: f64, y: f64| DVec3::new(x, y, 0.0);
    let origin = |place: DMat4| place.transform_point3(DVec3::ZERO);
    assert!(origin(first).distance(expected(5.0, 0.0)) < 1e-12);
    assert!(origin(second).distance(expected(5.0, 2.0)) < 1e-12);
    assert!(second.transform_point3(DVec3::X).distance(expected(5.0, 4.0)) < 1e-12);
}

/// The sphere of a scene as an OBJ file, with `offset` added to its positions.
fn sphere_at(folder: &Path, name: &str, offset: DVec3) {
    let scene = load(folder, "[[meshes]]\nshape = \"sphere\"\nfaces = 300\n");
    let mut text = String::new();
    for row in scene.objects[0].positions.data().chunks_exact(3) {
        // So many bits that the sum with the offset has all of them.
        let row = [0, 1, 2].map(|k| (f64::from(row[k]) * 1048576.0).round() / 1048576.0);
        let [x, y, z] = (DVec3::from(row) + offset).to_array();
        text.push_str(&format!("v {x:?} {y:?} {z:?}\n"));
    }
    for face in scene.objects[0].mesh.faces() {
        let [a, b, c] = face.map(|vertex| vertex + 1);
        text.push_str(&format!("f {a} {b} {c}\n"));
    }
    fs::write(folder.join(name), text).unwrap();
}

#[test]
fn a_mesh_of_a_map_is_drawn_learnt_and_written_as_one_at_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    png(folder);
    let offset = DVec3::new(500_000.0, 4_649_776.0, 100.0);
    let image_of = |file: &str, at: DVec3| {
        sphere_at(folder, file, at);
        let [x, y, z] = (-at).to_array();
        let text = format!(
            "[[meshes]]\nfile = \"{file}\"\nname = \"ball\"\nplace = {{ translation = [{x}, {y}, {z}] }}\n\
             [[views]]\nimage = \"a.png\"\ncamera = {{ position = [0.5, 0.4, 4], angle = 40 }}\n\
             [learn.vertices]\n[stop]\nsteps = 3\n"
        );
        let mut fit = SceneFit::new(load(folder, &text)).unwrap();
        let mut images = vec![fit.compare(0).unwrap().image];
        while fit.step().unwrap().is_some() {}
        images.push(fit.compare(0).unwrap().image);
        let out = folder.join("out").join(file);
        fit.learnt().unwrap().save_results(&out).unwrap();
        let notes = fit.scene().notes.clone();
        (images, value(&fit, "vertices/ball"), Folder::new(out).unwrap(), notes)
    };
    let (near, far) = (image_of("near.obj", DVec3::ZERO), image_of("far.obj", offset));
    assert_eq!(near.0, far.0);
    assert_eq!(near.1, far.1);
    assert!(near.3.is_empty() && far.3[0].contains("[500000.0, 4649776.0, 100.0]"), "{:?}", far.3);
    // In the world they are the same.
    let model = |folder: &Folder, file: &str| read_model(folder, file).unwrap();
    for file in ["mesh.glb", "mesh.obj", "ball.ply"] {
        let [near, far] = [&near, &far].map(|keys| model(&keys.2, file));
        assert!(near == far, "{file}");
        assert_eq!(near.geometries[0].offset, DVec3::ZERO);
    }

    // Without a place the world is that of the file.
    let scene = load(folder, "[[meshes]]\nfile = \"far.obj\"\n");
    scene.save_results(folder.join("out")).unwrap();
    let again = model(&Folder::new(folder.join("out")).unwrap(), "mesh.glb");
    assert_eq!(again.placed[0].transform, DMat4::from_translation(offset));
    assert_eq!(again.geometries[0].faces.len(), scene.objects[0].mesh.faces().len());
    for file in ["far.ply", "mesh.obj"] {
        let again = model(&Folder::new(folder.join("out")).unwrap(), file);
        assert_eq!(again.geometries[0].offset, offset, "{file}");
        assert_eq!(again.geometries[0].positions.as_flattened(), scene.objects[0].positions.data());
    }
    // Places lead from the coordinates of the file.
    let numbers = fs::read_to_string(folder.join("out/numbers.json")).unwrap();
    let numbers: serde_json::Value = serde_json::from_str(&numbers).unwrap();
    let rows =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    assert_eq!(numbers["objects"]["far"]["places"], serde_json::json!([rows]));
}

#[test]
fn vertex_colours_are_of_the_space_that_the_scene_names_and_are_written_as_srgb() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let text = "v 0 0 0 .5 .5 .5\nv 1 0 0 .5 .5 .5\nv 0 1 0 .5 .5 .5\nf 1 2 3\n";
    fs::write(folder.join("a.obj"), text).unwrap();
    let image_of = |file: &str, space: &str| {
        let scene = load(folder, &format!("[[meshes]]\nfile = \"{file}\"\n{space}"));
        scene.save_results(folder.join("out")).unwrap();
        fs::copy(folder.join("out/a.ply"), folder.join("a.ply")).unwrap();
        scene.objects[0].colors.as_ref().unwrap().rows.data()[0]
    };
    // The same grey as a byte of 128, to within the steps of bytes.
    for (space, light) in [("linear", 0.5), ("srgb", 0.214_041)] {
        let found = image_of("a.obj", &format!("vertex_color_space = \"{space}\"\n"));
        assert!((found - light).abs() < 1e-6, "{space}: {found}");
        let again = image_of("a.ply", "");
        assert!((again - light).abs() < 4e-3, "{space}: {again}");
    }
    assert_eq!(image_of("a.obj", ""), image_of("a.obj", "vertex_color_space = \"srgb\"\n"));
    let file = folder.join("scene.toml");
    let shape = "[[meshes]]\nshape = \"cube\"\nvertex_color_space = \"srgb\"\n";
    fs::write(&file, shape).unwrap();
    let error = Scene::load(&file).unwrap_err().to_string();
    assert!(error.contains("vertex_color_space"), "{error}");
}

#[test]
fn what_a_scene_does_not_do_of_its_meshes_is_noted() {
    let folder = tempfile::tempdir().unwrap();
    let faces = vec![[0, 1, 2]];
    let one = vec![[0; 3]];
    let triangle = Geometry {
        name: String::new(),
        positions: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
        offset: DVec3::ZERO,
        faces: faces.clone(),
        colors: None,
        coordinates: Some(Indexed { rows: vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], faces }),
        normals: Some(Indexed { rows: vec![[0.0, 0.0, 1.0]], faces: one.clone() }),
        tangents: Some(Indexed { rows: vec![[1.0, 0.0, 0.0, 1.0]], faces: one }),
        submeshes: vec![Submesh { material: Some(0), faces: 0..1 }],
    };
    let notes = |geometry: Geometry, rest: &str| {
        let material = MaterialFile {
            normal_map: MaterialMap::new(0, Borders::default()),
            ..MaterialFile::default()
        };
        let placed = Placed { name: String::new(), geometry: 0, transform: DMat4::IDENTITY };
        let model = Model {
            geometries: vec![geometry],
            materials: vec![material],
            images: vec![picture(false)],
            placed: vec![placed],
            notes: vec![],
        };
        fs::write(folder.path().join("a.glb"), glb(&model).unwrap()).unwrap();
        load(folder.path(), &format!("[[meshes]]\nfile = \"a.glb\"\n{rest}")).notes
    };
    let light = "[[lights]]\nkind = \"ambient\"\ncolor = [1, 1, 1]\n";
    assert_eq!(notes(triangle.clone(), light), Vec::<String>::new());
    let learnt = format!("{light}[learn.vertices]\n");
    let rebuilt =
        "a: its vertices are learnt, so tangents follow from its coordinates, not from its file";
    assert_eq!(notes(triangle.clone(), &learnt), [rebuilt]);
    assert_eq!(notes(triangle.clone(), &format!("{learnt}meshes = []\n")), Vec::<String>::new());
    let bare = Geometry { coordinates: None, ..triangle.clone() };
    let without = "a: images of its material were left out, as it has no texture coordinates";
    assert_eq!(notes(bare, light), [without]);
    let flat = Geometry { normals: None, tangents: None, ..triangle };
    let smooth = "a: its file has no normals: they are smooth, where glTF has flat ones";
    assert_eq!(notes(flat.clone(), light), [smooth]);
    assert_eq!(notes(flat, ""), Vec::<String>::new(), "nothing is lit");
}

/// A ball of two materials, by the side of each face, as an OBJ beside `m.mtl`; its faces, those of the first
/// material first.
fn two_halves(folder: &Path) -> Vec<[u32; 3]> {
    let scene = load(folder, "[[meshes]]\nshape = \"sphere\"\nfaces = 300\n");
    let object = &scene.objects[0];
    let point = |vertex: u32| &object.positions.data()[3 * vertex as usize..][..3];
    let is_left = |face: &[u32; 3]| face.iter().map(|&vertex| point(vertex)[0]).sum::<f32>() < 0.0;
    let mut faces = object.mesh.faces().to_vec();
    faces.sort_by_key(|face| !is_left(face));
    let mut text = "mtllib m.mtl\n".to_owned();
    for row in object.positions.data().chunks_exact(3) {
        text.push_str(&format!("v {} {} {}\n", row[0], row[1], row[2]));
    }
    for (name, is_of) in [("a", true), ("b", false)] {
        text.push_str(&format!("usemtl {name}\n"));
        for face in faces.iter().filter(|face| is_left(face) == is_of) {
            let [a, b, c] = face.map(|vertex| vertex + 1);
            text.push_str(&format!("f {a} {b} {c}\n"));
        }
    }
    fs::write(folder.join("two.obj"), &text).unwrap();
    let one: String = text
        .lines()
        .filter(|line| !line.starts_with("usemtl"))
        .fold(String::new(), |text, line| text + line + "\n");
    fs::write(folder.join("one.obj"), one).unwrap();
    faces
}

const VIEW: &str =
    "[[views]]\nimage = \"a.png\"\ncamera = { position = [0.5, 0.4, 4], angle = 40 }\n";

#[test]
fn a_surface_of_several_materials_is_learnt_as_one() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    png(folder);
    let faces = two_halves(folder);
    fs::write(folder.join("m.mtl"), "newmtl a\nKd .5 .5 .5\nnewmtl b\nKd .5 .5 .5\n").unwrap();
    let fitted = |file: &str, learn: &str| {
        let mut fit = SceneFit::new(load(
            folder,
            &format!(
                "[[meshes]]\nfile = \"{file}.obj\"\nname = \"ball\"\n{VIEW}[[lights]]\nkind = \"directional\"\n\
                 direction = [1, 2, 3]\ncolor = [2, 2, 2]\n[learn.vertices]\nsmoothing = 10.0\n\
                 rigid = 0.1\nlaplacian = 0.1\n{learn}[stop]\nsteps = 5\n"
            ),
        ))
        .unwrap();
        while fit.step().unwrap().is_some() {}
        fit
    };
    // With the same materials it is the mesh of one: the same vertices, and regularizers across the border.
    let [one, two] = ["one", "two"].map(|file| fitted(file, ""));
    let [a, b] = [&one, &two].map(|fit| value(fit, "vertices/ball"));
    let off = |a: &[f32], b: &[f32]| {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(off(&a, &b) < 1e-5, "{}", off(&a, &b));
    assert!(off(&a, one.scene().objects[0].positions.data()) > 1e-3);
    // Each material keeps what is learnt of it, by its own name.
    let both = fitted("two", "[learn.texture]\n[learn.roughness]\nmeshes = [\"ball/b\"]\n");
    let names: Vec<_> =
        both.parameters().iter().map(|parameter| parameter.name().to_owned()).collect();
    let expected = ["vertices/ball", "texture/ball/a", "texture/ball/b", "roughness/ball/b"];
    assert_eq!(names, expected);
    let [left, right] = ["texture/ball/a", "texture/ball/b"].map(|name| value(&both, name));
    assert_ne!(left, right);
    let learnt = both.learnt().unwrap();
    let materials = &learnt.objects[0].materials;
    assert_eq!(
        [&materials[0].base_color[..], &materials[1].base_color[..]],
        [&left[..], &right[..]]
    );
    // What is written has them, and one set of vertices.
    let out = folder.join("out");
    learnt.save_results(&out).unwrap();
    let out = Folder::new(&out).unwrap();
    for file in ["mesh.glb", "mesh.obj", "ball.ply"] {
        let model = read_model(&out, file).unwrap();
        let [mesh] = &model.geometries[..] else { panic!("{file}: {}", model.geometries.len()) };
        assert_eq!((mesh.faces.as_slice(), mesh.submeshes.len()), (faces.as_slice(), 2), "{file}");
        for (submesh, expected) in mesh.submeshes.iter().zip([&left, &right]) {
            let found = model.materials[submesh.material.unwrap()].base_color;
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 5e-3, "{file}: {found} {expected}");
            }
        }
    }
    let text =
        format!("[[meshes]]\nfile = \"two.obj\"\n{VIEW}[learn.texture]\nmeshes = [\"two/c\"]\n");
    let error = SceneFit::new(load(folder, &text)).err().unwrap().to_string();
    assert!(error.contains("are among two, two/a, two/b, and \"two/c\" is not"), "{error}");
}

#[test]
fn a_texture_that_is_learnt_is_one_that_was_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    two_halves(folder);
    png(folder);
    let text = fs::read_to_string(folder.join("one.obj")).unwrap() + "vt 0 0\n";
    let text = text.replacen("\nv ", "\nusemtl a\nv ", 1);
    let with_places = |line: &str| match line.strip_prefix("f ") {
        Some(corners) => corners.split(' ').fold("f".to_owned(), |all, k| all + &format!(" {k}/1")),
        None => line.to_owned(),
    };
    let text = text.lines().map(with_places).collect::<Vec<_>>().join("\n");
    fs::write(folder.join("a.obj"), text).unwrap();
    fs::write(folder.join("a.tga"), [0; 18]).unwrap();
    for (file, note) in [("a.tga", "can't be read"), ("b.png", "is missing")] {
        fs::write(folder.join("m.mtl"), format!("newmtl a\nmap_Kd {file}\n")).unwrap();
        let mesh = format!("{VIEW}[[meshes]]\nfile = \"a.obj\"\n");
        let scene = load(folder, &format!("{mesh}[learn.vertices]\n"));
        assert!(scene.notes.iter().any(|keys| keys.contains(note)), "{:?}", scene.notes);
        assert!(SceneFit::new(scene).is_ok());
        let error = SceneFit::new(load(folder, &format!("{mesh}[learn.texture]\n")));
        let error = error.err().unwrap().to_string();
        assert!(error.contains("`learn.texture` learns is there, and of \"a\""), "{error}");
        let keys = format!("{mesh}material = {{ texture_size = 4 }}\n[learn.texture]\n");
        assert!(SceneFit::new(load(folder, &keys)).is_ok());
        fs::write(folder.join("m.mtl"), format!("newmtl a\nmap_Pm {file}\n")).unwrap();
        let error = SceneFit::new(load(folder, &format!("{mesh}[learn.roughness]\n")));
        let error = error.err().unwrap().to_string();
        assert!(error.contains("`learn.roughness` learns is there"), "{error}");
    }
}

#[test]
fn a_scene_far_from_the_origin_is_drawn_and_learnt_as_one_at_the_origin() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    png(folder);
    let offset = DVec3::new(500_000.0, 4_649_776.0, 100.0);
    let fitted = |file: &str, at: DVec3| {
        sphere_at(folder, file, at);
        let place = |keys: [f64; 3]| format!("{:?}", (DVec3::from(keys) + at).to_array());
        let (eye, target) = (place([0.5, 0.4, 4.0]), place([0.0; 3]));
        let lamp = place([2.0, 1.0, 3.0]);
        let mut fit = SceneFit::new(load(
            folder,
            &format!(
                "[[meshes]]\nfile = \"{file}\"\nname = \"ball\"\n[[views]]\nimage = \"a.png\"\n\
                 camera = {{ position = {eye}, target = {target}, angle = 40 }}\n[[lights]]\n\
                 kind = \"point\"\nposition = {lamp}\ncolor = [30, 30, 30]\n[learn.vertices]\n\
                 [learn.pose]\n[learn.cameras]\n[stop]\nsteps = 3\n"
            ),
        ))
        .unwrap();
        let mut images = vec![fit.compare(0).unwrap().image];
        while fit.step().unwrap().is_some() {}
        images.push(fit.compare(0).unwrap().image);
        // Put back, it is the same scene once more.
        let again = SceneFit::new(fit.learnt().unwrap()).unwrap();
        images.push(again.compare(0).unwrap().image);
        (images, value(&fit, "vertices/ball"))
    };
    let (near, far) = (fitted("near.obj", DVec3::ZERO), fitted("far.obj", offset));
    assert!(furthest(&near.0[0], &near.0[1]) > 1e-3);
    for (near, far) in near.0.iter().zip(&far.0) {
        assert!(furthest(near, far) < 1e-4, "{}", furthest(near, far));
    }
    assert!(furthest(&far.0[1], &far.0[2]) < 1e-4);
    let off = near.1.iter().zip(&far.1).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(off < 1e-4, "{off}");
}
