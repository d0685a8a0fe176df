//! Scenes of one's own as the users of `new`, `inspect`, `fit` and `render` meet them.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use bokashi_scene::{Folder, Picture, Place, Samples, Scene, SceneFit, read_model};
use glam::{DMat4, DVec3};
use serde_json::{Value, json};

mod photographs;

fn bokashi(folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bokashi"));
    command.args(words).current_dir(folder).stdin(Stdio::null());
    command.output().expect("the program starts")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("text")
}

/// What it says; it succeeds without a word on standard error.
fn said(folder: &Path, words: &[&str]) -> String {
    let output = bokashi(folder, words);
    assert_eq!(text(&output.stderr), "", "{words:?}: {}", text(&output.stdout));
    assert_eq!(output.status.code(), Some(0), "{words:?}");
    text(&output.stdout)
}

/// What it says on standard output and error; it ends with `status`.
fn ended(folder: &Path, words: &[&str], status: i32) -> [String; 2] {
    let output = bokashi(folder, words);
    let all = [text(&output.stdout), text(&output.stderr)];
    assert_eq!(output.status.code(), Some(status), "{words:?}: {all:?}");
    assert!(!all[1].contains("panicked"), "{words:?}: {all:?}");
    all
}

fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

/// A disk of radius 10 in the middle, as a PNG of these channels.
fn disk(width: usize, height: usize, channels: usize) -> Vec<u8> {
    let is_inside = |k: usize| {
        let [x, y] = [k % width, k / width].map(|at| at as f64 + 0.5);
        (x - 0.5 * width as f64).hypot(y - 0.5 * height as f64) < 10.0
    };
    let sample = |k: usize| if is_inside(k / channels) { 40 + (k % 5 * 50) as u8 } else { 0 };
    let samples = Samples::U8((0..width * height * channels).map(sample).collect());
    Picture { width, height, channels, samples }.encode_png(&Place::new("disk")).unwrap()
}

/// The poses of cameras around a place, as OpenGL has them.
fn around(target: DVec3, count: usize) -> impl Iterator<Item = [[f64; 4]; 4]> {
    let turns = (0..count).map(move |k| k as f64 / count as f64 * std::f64::consts::TAU);
    turns.map(move |angle| {
        let eye = target + 4.0 * DVec3::new(angle.sin(), 0.3, angle.cos());
        let back = (eye - target).normalize();
        let right = DVec3::Y.cross(back).normalize();
        let up = back.cross(right);
        let [right, up, back] = [right, up, back].map(|axis| axis.extend(0.0));
        DMat4::from_cols(right, up, back, eye.extend(1.0)).transpose().to_cols_array_2d()
    })
}

const TEXTURED: &str = "mtllib quad.mtl\nusemtl skin\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n\
    vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

fn textured(folder: &Path) {
    write(folder, "model/quad.obj", TEXTURED);
    write(folder, "model/quad.mtl", "newmtl skin\nmap_Kd -s 1 1 1 maps/my skin.png\n");
    write(folder, "model/maps/my skin.png", disk(16, 8, 3));
}

/// Photographs with a `transforms.json`; each image has so many channels.
fn photographs(folder: &Path, count: usize, channels: usize) {
    let poses = around(DVec3::new(2.0, 1.0, 0.0), count).enumerate();
    let frames = poses.map(|(k, pose)| {
        let name = format!("images/{k:02}.png");
        write(folder, &format!("photos/{name}"), disk(32, 32, channels));
        json!({ "file_path": name, "transform_matrix": pose })
    });
    let frames: Vec<_> = frames.collect();
    let all = json!({ "w": 32, "h": 32, "fl_x": 48, "frames": frames });
    write(folder, "photos/transforms.json", all.to_string());
}

/// Does a step of the scene that was made.
fn step(folder: &Path, scene: &str) -> SceneFit {
    let scene = Scene::load(folder.join(scene)).unwrap();
    let mut fit = SceneFit::new(scene).unwrap();
    assert!(fit.step().unwrap().unwrap().loss.is_finite());
    fit
}

fn names(fit: &SceneFit) -> Vec<String> {
    fit.parameters().iter().map(|own| own.name().to_owned()).collect()
}

#[test]
fn photographs_with_cameras_and_opacity_are_ready_for_a_fit_of_a_sphere() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 9, 4);
    let said = said(folder, &["new", "ball", "--images", "photos"]);
    assert!(said.contains("cameras of transforms.json"), "{said}");
    assert!(said.ends_with("  bokashi fit ball/scene.toml\n"), "{said}");
    let fit = step(folder, "ball/scene.toml");
    assert_eq!(names(&fit), ["vertices/object", "texture/object"]);
    let scene = fit.scene();
    assert!(scene.objects[0].mesh.faces().len().abs_diff(5000) < 500);
    assert_eq!(scene.description.loss.silhouette.unwrap().0, 1.0);
    assert_eq!(scene.views.iter().filter(|view| view.held_out).count(), 2);
    // Where the cameras look, and seen whole.
    let (center, _) = scene.ball();
    assert!(center.distance(DVec3::new(2.0, 1.0, 0.0)) < 1e-3, "{center}");
    let [told, _] = ended(folder, &["inspect", "ball/scene.toml"], 0);
    assert!(told.contains("at least      100 % of an object's vertices"), "{told}");
    assert!(told.lines().all(|line| line.chars().count() <= 80), "{told}");
    assert!(!told.contains("problem"), "{told}");
}

/// A recipe that is there as a comment works without its comment signs.
#[test]
fn the_recipe_for_a_pose_that_is_far_off_can_be_taken_as_it_stands() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 9, 4);
    textured(folder);
    said(folder, &["new", "ball", "--images", "photos"]);
    said(folder, &["new", "quad", "--from", "model/quad.obj", "--images", "photos"]);
    for name in ["ball", "quad"] {
        let file = folder.join(name).join("scene.toml");
        let text = fs::read_to_string(&file).unwrap();
        let keys = [
            "[",
            "rates = ",
            "steps = ",
            "reduce = ",
            "views_per_step = ",
            "learn = ",
            "silhouette = ",
        ];
        let is_light = |line: &str| line.contains("[lights]");
        let bare = |line: &str| match line.strip_prefix("# ") {
            Some(own) if keys.iter().any(|key| own.starts_with(key)) && !is_light(own) => {
                own.to_owned()
            }
            _ => line.to_owned(),
        };
        let lines: Vec<_> = text.lines().map(bare).collect();
        fs::write(&file, lines.join("\n")).unwrap();
        let fit = step(folder, &format!("{name}/scene.toml"));
        let description = &fit.scene().description;
        assert_eq!(description.stages.len(), 2, "{text}");
        assert_eq!(description.stages[0].learn, Some(vec!["pose".to_owned()]));
        assert_eq!(description.loss.silhouette.unwrap().0, 1.0);
        assert!(names(&fit).iter().any(|own| own.starts_with("pose/")), "{:?}", names(&fit));
    }
}

#[test]
fn a_textured_mesh_is_copied_with_its_files_and_its_texture_is_learnt() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    textured(folder);
    photographs(folder, 3, 3);
    let said = said(folder, &["new", "a b", "--from", "model/quad.obj", "--images", "photos"]);
    assert!(said.contains("mesh/quad.obj and 2 files that it names"), "{said}");
    assert!(said.contains("bokashi fit 'a b/scene.toml'"), "{said}");
    let fit = step(folder, "a b/scene.toml");
    assert_eq!(names(&fit), ["texture/quad"]);
    assert!(fit.scene().description.cameras.as_ref().unwrap().get_ref().held_out_every.is_none());
    let model = |folder: &Path| read_model(&Folder::new(folder).unwrap(), "quad.obj").unwrap();
    assert_eq!(model(&folder.join("a b/mesh")), model(&folder.join("model")));
}

#[test]
fn each_kind_of_mesh_has_something_to_learn() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 2, 3);
    let points = "v -1 -1 0\nv 1 -1 0\nv 0 1 0\n";
    let colored = points.replace(" 0\n", " 0 1 0 0\n");
    let rows = [
        ("colored", format!("{colored}f 1 2 3\n"), vec!["colors/colored"]),
        (
            "mapped",
            format!("{points}vt 0 0\nvt 1 0\nvt 1 1\nf 1/1 2/2 3/3\n"),
            vec!["texture/mapped"],
        ),
        ("bare", format!("{points}f 1 2 3\n"), vec!["vertices/bare", "texture/bare"]),
    ];
    for (name, obj, expected) in rows {
        write(folder, &format!("{name}.obj"), obj);
        let from = format!("{name}.obj");
        said(folder, &["new", name, "--from", &from, "--images", "photos"]);
        assert_eq!(names(&step(folder, &format!("{name}/scene.toml"))), expected);
    }
}

#[test]
fn images_without_cameras_have_views_to_fill_in() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    for (name, channels) in [("IMG 1.png", 3), ("b\"ü.png", 3), ("c.PNG", 3)] {
        write(folder, &format!("photos/{name}"), disk(40, 30, channels));
        write(folder, &format!("photos/masks/{name}"), disk(40, 30, 1));
    }
    write(folder, "photos/notes.txt", "no image");
    let said = said(folder, &["new", "a", "--images", "photos"]);
    assert!(said.contains("3 images without cameras"), "{said}");
    assert!(said.contains("\nFill in the camera of each view"), "{said}");
    let fit = step(folder, "a/scene.toml");
    let views = &fit.scene().views;
    assert_eq!(views.len(), 3);
    assert!(views.iter().all(|view| view.mask.is_some()));
    assert_eq!(fit.scene().description.loss.silhouette.unwrap().0, 1.0);
    // Nobody filled them in.
    let [told, error] = ended(folder, &["inspect", "a/scene.toml"], 1);
    let rule = "\nproblem: cameras of different images stand in different places, and ";
    assert!(told.contains(rule) && told.contains(" and 1 more stand in one\n"), "{told}");
    assert_eq!(error, "bokashi: a/scene.toml: 1 problem\n");
}

#[test]
fn masks_that_some_images_lack_are_left_out_and_said() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 2, 3);
    write(folder, "photos/masks/00.png", disk(32, 32, 1));
    let told = said(folder, &["new", "a", "--images", "photos"]);
    assert!(told.contains("note: masks count where each image has one, and 1 of 2"), "{told}");
    assert!(told.contains("masks    none"), "{told}");
    assert!(step(folder, "a/scene.toml").scene().description.loss.silhouette.is_none());
    write(folder, "photos/masks/01.png", disk(32, 32, 1));
    let told = said(folder, &["new", "b", "--images", "photos"]);
    assert!(told.contains("masks    a file for each image"), "{told}");
    let fit = step(folder, "b/scene.toml");
    assert!(fit.scene().views.iter().all(|view| view.mask.is_some()));
}

#[test]
fn a_reconstruction_of_colmap_is_taken_as_it_lies() {
    for (model, images) in [
        ("sparse/0", "images/"),
        ("colmap/sparse/0", "images/"),
        ("sparse/0", ""),
        ("sparse", "images/"),
    ] {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path();
        write(folder, &format!("in/{model}/cameras.txt"), "1 PINHOLE 32 32 48 48 16 16\n");
        let shots = "1 1 0 0 0 0 0 4 1 a.png\n\n2 0.7071 0 0.7071 0 0 0 4 1 b.png\n\n";
        write(folder, &format!("in/{model}/images.txt"), shots);
        write(folder, &format!("in/{model}/points3D.txt"), "");
        for name in ["a", "b"] {
            write(folder, &format!("in/{images}{name}.png"), disk(32, 32, 4));
        }
        said(folder, &["new", "a", "--images", "in"]);
        let fit = step(folder, "a/scene.toml");
        assert_eq!(fit.scene().views.len(), 2, "{model}");
        said(folder, &["inspect", "a/scene.toml"]);
    }
}

#[test]
fn the_largest_of_several_reconstructions_is_copied_and_named() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let one = "1 1 0 0 0 0 0 4 1 a.png\n\n";
    let two = format!("{one}2 0.7071 0 0.7071 0 0 0 4 1 b.png\n\n");
    for (model, shots) in [("sparse/0", one), ("sparse/1", &two)] {
        write(folder, &format!("in/{model}/cameras.txt"), "1 PINHOLE 128 128 192 192 64 64\n");
        write(folder, &format!("in/{model}/images.txt"), shots);
        write(folder, &format!("in/{model}/points3D.txt"), "");
    }
    for name in ["a", "b", "c"] {
        write(folder, &format!("in/images/{name}.png"), disk(32, 32, 4));
    }
    let told = said(folder, &["new", "a", "--images", "in"]);
    for rule in [
        "note: sparse has several models: sparse/1 with 2 images is taken, and sparse/0 with 1 image",
        "note: images: 1 image has no camera, and is left out: c.png\n",
        "note: 2 images are 4 times smaller than their cameras, and focal lengths",
    ] {
        assert_eq!(told.matches(rule).count(), 1, "{told}");
    }
    let fit = step(folder, "a/scene.toml");
    let cameras: Vec<_> = fit.scene().views.iter().map(|view| view.camera).collect();
    assert_eq!(cameras.len(), 2);
    assert_eq!((cameras[0].size.width, cameras[0].intrinsics), (32, [48.0, 48.0, 15.5, 15.5]));
    let told = said(folder, &["inspect", "a/scene.toml"]);
    assert!(told.contains("note: 2 images are 4 times smaller"), "{told}");
}

#[test]
fn edges_that_a_lens_bends_are_said_in_pixels() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let text = "[[meshes]]\nshape = \"plane\"\nplace = { scale = 2.0 }\n[[views]]\nname = \"v\"\n\
        camera = { size = [320, 240], focal = 200, distortion = [-0.3, 0, 0, 0, 0], position = [0, 0, 4] }\n";
    // A byte order mark, as programs of Windows write one.
    write(folder, "scene.toml", format!("\u{feff}{text}"));
    let rule = "note: the lens of 1 view bends edges of faces that are drawn with straight ones: smaller faces \
                are nearer; an edge of \"plane\" in view \"v\" is off by 7.5 pixels\n";
    for words in [&["inspect", "scene.toml"][..], &["render", "scene.toml", "--out", "out"]] {
        let told = said(folder, words);
        assert!(told.contains(rule), "{told}");
    }
    write(folder, "fine.toml", text.replace("scale = 2.0 }", "scale = 2.0 }\nfaces = 5000"));
    let told = said(folder, &["inspect", "fine.toml"]);
    assert!(!told.contains("bends edges"), "{told}");
}

#[test]
fn without_images_there_is_a_view_to_render() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    textured(folder);
    for words in [&["new", "a"][..], &["new", "b", "--from", "model/quad.obj"]] {
        let told = said(folder, words);
        let file = format!("{}/scene.toml", words[1]);
        assert!(told.ends_with(&format!("  bokashi render {file}\n")), "{told}");
        let scene = Scene::load(folder.join(&file)).unwrap();
        assert!(scene.views.len() == 1 && scene.views[0].image.is_none());
        let told = said(folder, &["inspect", &file]);
        assert!(told.contains("at least      100 %"), "{told}");
        assert!(told.contains("note: `learn` names nothing"), "{told}");
    }
}

#[test]
fn an_editor_is_told_of_the_schema() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    said(folder, &["new", "a"]);
    let text = fs::read_to_string(folder.join("a/scene.toml")).unwrap();
    assert!(text.starts_with("#:schema ./scene.schema.json\n"), "{text}");
    let schema = fs::read_to_string(folder.join("a/scene.schema.json")).unwrap();
    assert_eq!(schema, bokashi_scene::description::schema());
    // That of an earlier build is replaced, and nothing else.
    let earlier = "{ \"title\": \"A scene for bokashi\" }";
    write(folder, "b/scene.schema.json", earlier);
    said(folder, &["new", "b"]);
    assert_eq!(fs::read_to_string(folder.join("b/scene.schema.json")).unwrap(), schema);
    write(folder, "c/scene.schema.json", "mine");
    let [_, error] = ended(folder, &["new", "c"], 2);
    let rule = "new needs a folder without another file where the scene's schema goes";
    assert_eq!(error, format!("bokashi: {rule}, and c/scene.schema.json is there\n"));
    assert_eq!(fs::read(folder.join("c/scene.schema.json")).unwrap(), b"mine");
    assert!(!folder.join("c/scene.toml").exists());
}

#[test]
fn what_is_there_is_not_written_over() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 2, 4);
    write(folder, "a/scene.toml", "mine");
    let [_, error] = ended(folder, &["new", "a"], 2);
    assert_eq!(
        error,
        "bokashi: new needs a folder without a scene.toml, and a/scene.toml is there\n"
    );
    assert_eq!(fs::read(folder.join("a/scene.toml")).unwrap(), b"mine");
    write(folder, "b/images/01.png", "mine");
    let [_, error] = ended(folder, &["new", "b", "--images", "photos"], 2);
    assert!(error.ends_with("and b/images/01.png is there\n"), "{error}");
    assert!(!folder.join("b/scene.toml").exists() && !folder.join("b/images/00.png").exists());
    assert_eq!(fs::read(folder.join("b/images/01.png")).unwrap(), b"mine");
    // In their own folder images stay where they are.
    let told = said(folder, &["new", "photos", "--images", "photos"]);
    assert!(told.contains("copied   0 files"), "{told}");
    step(folder, "photos/scene.toml");
}

#[test]
fn what_can_t_be_taken_leaves_no_scene() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    fs::create_dir(folder.join("empty")).unwrap();
    write(folder, "file", "");
    write(folder, "bad/a.png", "no png");
    write(folder, "bad.obj", "v 0 0 0\nf 1 2\n");
    write(folder, "up.mtl", "");
    write(folder, "m/out.obj", "mtllib ../up.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let rows = [
        (["--images", "empty"], 1, "empty: a folder of images has some of .png"),
        (["--images", "nowhere"], 1, "nowhere could not be read"),
        (["--images", "bad"], 1, "bad/a.png: an image is a PNG"),
        (["--from", "bad.obj"], 1, "bad.obj:2"),
        (["--from", "nowhere.obj"], 1, "nowhere.obj could not be read"),
        (["--from", "m/out.obj"], 1, "files lie in the scene's folder m; m/../up.mtl does not"),
        (["--from", "file"], 1, "a mesh file is an .obj"),
    ];
    for (words, status, rule) in rows {
        let [_, error] = ended(folder, &["new", "a", words[0], words[1]], status);
        assert!(error.contains(rule) && error.lines().count() == 1, "{words:?}: {error}");
        assert!(!folder.join("a").exists(), "{words:?}");
    }
    let [_, error] = ended(folder, &["new", "file/a"], 2);
    assert!(error.contains("new needs a folder to write to"), "{error}");
}

#[test]
fn what_is_wrong_with_a_mesh_is_said_and_ends_with_1() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    textured(folder);
    let told = said(folder, &["inspect", "model/quad.obj"]);
    for line in [
        "  vertices      4",
        "  surface       open: 4 edges of one face",
        "  colour map    16 x 8 texels, 3 channels",
    ] {
        assert!(told.contains(&format!("{line}\n")), "{line}: {told}");
    }
    write(folder, "model/quad.obj", format!("{TEXTURED}f 1/1 2/2 3/3\nv 2 2 0\nf 1/1 3/3 5/3\n"));
    fs::remove_file(folder.join("model/maps/my skin.png")).unwrap();
    let [told, error] = ended(folder, &["inspect", "model/quad.obj", "--json", "a.json"], 1);
    let problems: Vec<_> = told.lines().filter(|line| line.starts_with("problem: ")).collect();
    assert_eq!(problems.len(), 5, "{told}");
    for rule in ["three faces or more", "opposite sides", "no area", "same vertices", "is missing"]
    {
        assert!(problems.iter().any(|problem| problem.contains(rule)), "{rule}: {told}");
    }
    assert_eq!(error, "bokashi: model/quad.obj: 5 problems\n");
    let json: Value = serde_json::from_slice(&fs::read(folder.join("a.json")).unwrap()).unwrap();
    assert_eq!(json["problems"].as_array().unwrap().len(), 5);
    write(folder, "model/maps/my skin.png", "RIFF\x1a\0\0\0WEBPVP8L");
    let [told, _] = ended(folder, &["inspect", "model/quad.obj"], 1);
    assert!(told.contains("problem: the image \"maps/my skin.png\" can't be read"), "{told}");
    assert_eq!(json["geometries"][0]["surface"]["repeated_faces"], 1);
    assert_eq!(json["kind"], "mesh");
}

#[test]
fn what_is_wrong_with_a_scene_is_said() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let look = |x: f64| {
        format!("camera = {{ position = [{x}, 0, 5], target = [{x}, 0, 0], angle = 40 }}\n")
    };
    write(folder, "right.png", disk(32, 32, 3));
    write(folder, "masked.png", disk(32, 32, 4));
    write(
        folder,
        "black.png",
        Picture { width: 32, height: 32, channels: 1, samples: Samples::U8(vec![0; 1024]) }
            .encode_png(&Place::new("a"))
            .unwrap(),
    );
    let sized = "camera = { position = [1, 0, 5], angle = 40, size = [64, 32] }\n";
    let scene = format!(
        "[[meshes]]\nshape = \"cube\"\n\
         [[views]]\nimage = \"masked.png\"\n{}\
         [[views]]\nimage = \"masked.png\"\nname = \"again\"\n{}\
         [[views]]\nimage = \"right.png\"\n{}\
         [[views]]\nname = \"away\"\nimage = \"masked.png\"\nmask = \"black.png\"\n{}\
         [[views]]\nname = \"large\"\nimage = \"masked.png\"\n{sized}\
         [[views]]\nname = \"gone\"\nimage = \"gone.png\"\n{}\
         [learn.texture]\n[loss]\nsilhouette = 1\n[[stages]]\nsteps = 1\nlearn = [\"texture\", \"verts\"]\n\
         [stop]\nsteps = 3\n",
        look(0.0),
        look(0.1),
        look(0.2),
        look(50.0),
        look(0.3).replace(" }", ", size = [32, 32] }"),
    );
    write(folder, "scene.toml", scene);
    let [told, _] = ended(folder, &["inspect", "scene.toml"], 1);
    let rules = [
        "\"again\": it has the image of \"masked\"",
        "view \"right\": masks count in the loss",
        "view \"away\": no object lies in front of its camera",
        "black.png: a mask tells objects from background, and this has no object",
        "masked.png: an image has the size of its camera, 64 x 32, and this is 32 x 32",
        "gone.png could not be read",
        "a stage learns some of texture, and not \"verts\"",
    ];
    for rule in rules {
        let count = told
            .lines()
            .filter(|line| line.starts_with("problem: ") && line.contains(rule))
            .count();
        assert_eq!(count, 1, "{rule}: {told}");
    }
    assert!(
        told.contains("note: `stop.steps` is left out: each of the stages says its own\n"),
        "{told}"
    );
    let output = bokashi(folder, &["inspect", "scene.toml", "--json", "-"]);
    let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(json["views"].as_array().unwrap().len(), 6);
    assert_eq!(json["views"][3]["seen"][0], 0.0);
    assert!(json["parameters"].is_null(), "a fit of this scene is refused");
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn images_cameras_and_saved_fits_are_told() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 3, 4);
    let told = said(folder, &["inspect", "photos/images/00.png"]);
    assert!(told.contains("  size          32 x 32 pixels\n"), "{told}");
    assert!(told.contains("  green         from 0 to 240\n"), "{told}");
    let told = said(folder, &["inspect", "photos/transforms.json"]);
    assert!(
        told.contains("  focal         48\n") && told.contains("  look at       2 1 0\n"),
        "{told}"
    );
    write(folder, "photos/images/01.png", disk(16, 32, 4));
    let [told, _] = ended(folder, &["inspect", "photos/transforms.json"], 1);
    assert!(
        told.contains("\nproblem: \"images/01.png\": w and h are 32 x 32, and its image is 16"),
        "{told}"
    );
    write(folder, "photos/images/01.png", disk(32, 32, 4));
    said(folder, &["new", "a", "--images", "photos"]);
    step(folder, "a/scene.toml").save(folder.join("fit.safetensors")).unwrap();
    let told = said(folder, &["inspect", "fit.safetensors"]);
    assert!(told.contains("  steps done    1\n"), "{told}");
    assert!(told.contains("parameter \"vertices/object\"\n  shape         [2402,3]\n"), "{told}");
    let clear =
        Picture { width: 1, height: 1, channels: 4, samples: Samples::U8(vec![255, 255, 255, 0]) };
    write(folder, "clear.png", clear.encode_png(&Place::new("a")).unwrap());
    let [told, _] = ended(folder, &["inspect", "clear.png"], 1);
    assert!(told.contains("\nproblem: an image shows something"), "{told}");
}

#[test]
fn files_that_can_t_be_read_are_one_sentence_with_their_name() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let rows: [(&str, &[u8], &str); 9] = [
        ("a.obj", b"v 0 0 x\n", "a.obj:1: "),
        ("a.ply", b"", "a.ply: "),
        ("a.glb", b"glTF", "a.glb: "),
        ("a.png", b"\x89PNG\r\n\x1a\n", "a.png: "),
        ("a.exr", b"", "a.exr: an image is a PNG, JPEG, EXR or HDR file, and the file is empty"),
        ("a.toml", b"[[meshes]]\nfile = 3\n", "a.toml:2:8: "),
        ("b.toml", b"[learn]\ntextur = {}\n", "b.toml:2:1: unknown key `textur`"),
        ("a.json", b"{\n\"frames\": 1}", "a.json:2:11: "),
        ("a.safetensors", b"12345678", "a.safetensors: "),
    ];
    for (name, bytes, rule) in rows {
        write(folder, name, bytes);
        let [told, error] = ended(folder, &["inspect", name], 1);
        assert_eq!((told.as_str(), error.lines().count()), ("", 1), "{name}: {error}");
        let own = error.strip_prefix("bokashi: ").unwrap();
        assert!(own.starts_with(rule), "{name}: {error}");
    }
    for name in ["a.stl", "a", "."] {
        let [_, error] = ended(folder, &["inspect", name], 2);
        assert!(error.contains("needs a file whose name ends with one of .obj"), "{error}");
    }
    let [_, error] = ended(folder, &["inspect", "a.obj", "--json", "a.obj"], 2);
    assert!(error.contains("--json needs another file than FILE, got a.obj"), "{error}");
    assert_eq!(fs::read(folder.join("a.obj")).unwrap(), b"v 0 0 x\n");
}

/// A scene of photographs in two stages.
fn staged(folder: &Path) {
    photographs(folder, 5, 4);
    let text = "[cameras]\ntransforms = \"transforms.json\"\nheld_out_every = 4\n\
        [[meshes]]\nshape = \"sphere\"\nfaces = 200\nplace = { translation = [2, 1, 0] }\n\
        material = { texture_size = 8 }\n[loss]\nsilhouette = 0.5\n\
        [learn.vertices]\nsmoothing = 5.0\nnormals = 1e-2\n[learn.texture]\ntotal_variation = 1e-3\n\
        [learn.cameras]\n\
        [[stages]]\nsteps = 4\nreduce = 2\nlearn = [\"vertices\", \"texture\"]\n\
        [[stages]]\nsteps = 5\nviews_per_step = 2\n";
    write(folder, "photos/scene.toml", text);
}

fn outcome(folder: &Path, words: &str) -> Value {
    let words: Vec<_> = words.split(' ').collect();
    let [told, _] =
        ended(folder, &[&["fit", "photos/scene.toml", "--json", "-"], &*words].concat(), 0);
    serde_json::from_str(&told).expect("one JSON object")
}

#[test]
fn a_fit_of_a_scene_ends_in_the_same_bits_however_it_is_run() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    staged(folder);
    let whole = outcome(folder, "--out whole --threads 1");
    let hash = whole["parameters_hash"].as_str().unwrap();
    assert_eq!(whole["steps"], 9);
    assert_eq!(outcome(folder, "--out two --threads 2")["parameters_hash"], hash);
    // Interrupted in either stage, and between them.
    for steps in [2, 4, 6] {
        let part = outcome(folder, &format!("--out part --steps {steps}"));
        assert_eq!(part["steps"], steps);
        assert_ne!(part["parameters_hash"], hash);
        let rest = outcome(folder, "--out part --resume");
        assert_eq!((&rest["parameters_hash"], &rest["steps"]), (&hash.into(), &9.into()));
        assert_eq!(rest["changed"], json!([]));
    }
    // Where all is done, it says so.
    let resumed = ["fit", "photos/scene.toml", "--out", "part", "--resume"];
    let [told, _] = ended(folder, &resumed, 0);
    assert!(told.starts_with("9 steps, done before, held-out views "), "{told}");
    // What is changed is said.
    let text = fs::read_to_string(folder.join("photos/scene.toml")).unwrap();
    write(folder, "photos/scene.toml", text.replace("steps = 5", "steps = 6"));
    let [told, _] = ended(folder, &resumed, 0);
    let note = "note: `stages[1].steps`: 6 from now on, and 5 before\n10 steps, 1 of them now, in ";
    assert!(told.starts_with(note), "{told}");
    let text = text.replace("[[stages]]\nsteps = 4", "[stop]\npatience = 1\n[[stages]]\nsteps = 4");
    write(folder, "photos/scene.toml", &text);
    outcome(folder, "--out patient");
    let again = ["fit", "photos/scene.toml", "--out", "patient", "--resume"];
    let [told, _] = ended(folder, &again, 0);
    let note = "note: the fit had ended when it was saved: no smaller loss came in 1 steps";
    assert!(told.starts_with(note), "{told}");
    // The checkpoint is of this scene alone.
    write(folder, "photos/scene.toml", text.replace("texture_size = 8", "texture_size = 9"));
    let [_, said] = ended(folder, &resumed, 1);
    assert!(said.contains("a saved fit needs the scene's parameters"), "{said}");
}

/// What a page and the terminal say beside the numbers.
#[test]
fn a_fit_names_its_worst_views_and_says_that_its_loss_still_fell() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    staged(folder);
    let text = fs::read_to_string(folder.join("photos/scene.toml")).unwrap();
    let text = text
        .replace("steps = 5", "steps = 80")
        .replace("views_per_step = 2", "views_per_step = 4\nrates = 0.3");
    write(folder, "photos/scene.toml", text);
    // A name that HTML has another meaning for.
    fs::rename(folder.join("photos"), folder.join("a<b&c")).unwrap();
    let told = said(folder, &["fit", "a<b&c/scene.toml"]);
    assert!(told.contains("\nThe loss still fell by "), "{told}");
    let worst = told.lines().find_map(|line| line.strip_prefix("Worst views: ")).unwrap();
    let ratios: Vec<f64> = worst
        .trim_end_matches('.')
        .split("; ")
        .map(|own| own.trim_end_matches(" dB").rsplit(' ').next().unwrap().parse().unwrap())
        .collect();
    assert!(ratios.len() == 3 && ratios.is_sorted(), "{worst}");
    let is_said = "\nViews that are held out keep the cameras of the scene's file: ";
    assert!(told.contains(is_said), "{told}");
    let [inspected, _] = ended(folder, &["inspect", "a<b&c/scene.toml"], 0);
    assert!(inspected.contains("keep the cameras of the scene's file"), "{inspected}");
    let page = fs::read_to_string(folder.join("out/index.html")).unwrap();
    assert!(page.contains("<title>Bokashi: a&lt;b&amp;c/scene.toml</title>"));
    assert!(page.contains("<h1>a&lt;b&amp;c/scene.toml</h1>"));
    for words in ["The loss still fell by ", worst.split(' ').next().unwrap(), is_said.trim()] {
        assert!(page.contains(&words.replace('\'', "&#39;")) || page.contains(words), "{words}");
    }
}

#[test]
fn a_fit_that_can_t_go_on_is_saved() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    staged(folder);
    let whole = outcome(folder, "--out whole");
    // Results without a place, and an image that is broken when its turn comes.
    let how = "; the fit is saved, go on with: bokashi fit photos/scene.toml --out part --resume";
    let picture = folder.join("part/views/00-result.png");
    write(folder, "part/views/00-result.png", "");
    let mut mode = fs::metadata(&picture).unwrap().permissions();
    mode.set_readonly(true);
    fs::set_permissions(&picture, mode).unwrap();
    let [_, said] = ended(folder, &["fit", "photos/scene.toml", "--out", "part"], 1);
    assert!(said.contains("00-result.png could not be written: ") && said.contains(how), "{said}");
    fs::remove_dir_all(folder.join("part/views")).unwrap();
    // What is known before the fit ends it there.
    write(folder, "file/views", "");
    let [_, said] = ended(folder, &["fit", "photos/scene.toml", "--out", "file"], 1);
    assert!(said.contains("file/views is not a folder") && !said.contains("saved"), "{said}");
    let rest = outcome(folder, "--out part --resume");
    assert_eq!(rest["parameters_hash"], whole["parameters_hash"]);
    let image = fs::read(folder.join("photos/images/02.png")).unwrap();
    write(folder, "photos/images/02.png", &image[..image.len() - 30]);
    let [_, said] = ended(folder, &["fit", "photos/scene.toml", "--out", "part"], 1);
    assert!(said.contains("images/02.png: ") && said.contains(how), "{said}");
    write(folder, "photos/images/02.png", image);
    let rest = outcome(folder, "--out part --resume");
    assert_eq!(rest["parameters_hash"], whole["parameters_hash"]);
}

#[test]
fn a_fit_of_a_scene_leaves_what_other_programs_read() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    staged(folder);
    let found = outcome(folder, "--out photos/out");
    let keys: Vec<_> = found.as_object().unwrap().keys().map(String::as_str).collect();
    let expected = [
        "changed",
        "left_out",
        "loss_fell_at_end",
        "loss_final",
        "loss_initial",
        "ms_per_step_median",
        "parameters",
        "parameters_hash",
        "psnr_held_out",
        "seconds",
        "steps",
        "threads",
        "views",
    ];
    assert_eq!(keys, expected);
    let view = &found["views"][0];
    assert_eq!((&view["name"], &view["held_out"]), (&"00".into(), &true.into()));
    assert!(view["psnr"].as_f64().unwrap() > 3.0 && view["silhouette_iou"].as_f64().unwrap() > 0.1);
    assert_eq!(found["parameters"]["cameras"]["shape"], json!([5, 6]));

    let out = Folder::new(folder.join("photos/out")).unwrap();
    let model = read_model(&out, "mesh.glb").unwrap();
    assert_eq!(model.geometries[0].faces.len(), 192);
    assert_eq!(model.images[0].width, 8);
    assert_eq!(read_model(&out, "sphere.ply").unwrap().geometries[0].faces.len(), 192);
    let numbers: Value = serde_json::from_str(&out.read_text("numbers.json").unwrap()).unwrap();
    assert!(numbers["objects"]["sphere"]["places"][0][3][3] == 1.0);
    for what in ["result", "target", "difference"] {
        let file = format!("views/00-{what}.png");
        let size = Picture::decode_size(&out.read(&file).unwrap(), &Place::new(&file)).unwrap();
        assert_eq!(size, [32, 32], "{what}");
    }
    // Its images are found from where it lies.
    let told = said(folder, &["inspect", "photos/out/transforms.json"]);
    assert!(
        told.starts_with("photos/out/transforms.json: a file of cameras\n  views         5\n"),
        "{told}"
    );
    let page = out.read_text("index.html").unwrap();
    for section in ["Error against run time", "The learnt mesh", "00, held out"] {
        assert!(page.contains(section), "{section}");
    }
    for address in page.split("src=\"").skip(1).filter_map(|rest| rest.split_once('"')) {
        assert!(out.read(address.0).is_ok(), "{}", address.0);
    }
    assert_eq!(page.matches("<img ").count(), 15);
}

#[test]
fn a_scene_is_rendered_as_pictures_depth_normals_and_ids() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let text = "[[meshes]]\nshape = \"plane\"\nmaterial = { base_color = [0.25, 0.5, 1] }\n\
        [[views]]\nname = \"front\"\ncamera = { position = [0, 0, 5], angle = 40, size = [16, 12] }\n";
    write(folder, "scene.toml", text);
    let told = said(folder, &["render", "scene.toml", "--view", "front"]);
    assert_eq!(told, "front: 8 files\n");
    let read = |name: &str| {
        let file = folder.join("out").join(name);
        Picture::decode(&fs::read(&file).unwrap(), &Place::new(&file)).unwrap()
    };
    let middle = 6 * 16 + 8;
    let at = |picture: &Picture, channel: usize| picture.channel(channel).unwrap().data()[middle];
    let light = read("front.exr");
    assert_eq!([0, 1, 2, 3].map(|k| at(&light, k)), [0.25, 0.5, 1.0, 1.0]);
    assert!((at(&read("front.png"), 1) - 188.0 / 255.0).abs() < 1e-6);
    assert!((at(&read("front-depth.exr"), 0) - 5.0).abs() < 1e-5);
    assert_eq!(read("front-depth.exr").channel(0).unwrap().data()[0], 0.0);
    assert_eq!(at(&read("front-normals.exr"), 2), 1.0);
    assert!([1.0, 2.0].contains(&at(&read("front-ids.exr"), 0)));
    assert_eq!(at(&read("front-ids.png"), 0), 1.0 / 65_535.0);
    let [_, said] = ended(folder, &["render", "scene.toml", "--view", "back"], 2);
    assert!(said.contains("--view needs one of front, and this is back"), "{said}");
}
