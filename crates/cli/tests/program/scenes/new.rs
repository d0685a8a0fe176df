//! What `bokashi new` makes of meshes and images.

use bokashi_scene::description::Stage;

use super::*;

#[test]
fn photographs_with_cameras_and_opacity_are_ready_for_a_fit_from_their_hull() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 9, 4);
    let said = said(folder, &["new", "ball", "--images", "photos"]);
    assert!(said.contains("cameras of transforms.json"), "{said}");
    assert!(said.ends_with("  bokashi fit ball/scene.toml\n"), "{said}");
    let fit = step(folder, "ball/scene.toml");
    assert_eq!(names(&fit), ["vertices/object", "colors/object"]);
    let scene = fit.scene();
    let stages = &scene.description.stages;
    assert!(stages.iter().any(|stage| stage.remesh.is_some()));
    assert!(stages.last().is_some_and(|stage| stage.texture.is_some()));
    assert_eq!(scene.description.loss.silhouette.unwrap().0, 1.0);
    assert_eq!(scene.views.iter().filter(|view| view.held_out).count(), 2);
    assert!(scene.description.stop.held_out.is_some());
    // Where the object is, and seen whole.
    let (center, _) = scene.ball();
    assert!(center.distance(DVec3::new(2.0, 1.0, 0.0)) < 0.2, "{center}");
    let [told, _] = ended(folder, &["inspect", "ball/scene.toml"], 0);
    assert!(told.contains("at least      100 % of an object's vertices"), "{told}");
    assert!(
        told.contains("new faces     edges of ") && told.contains(", every 50 steps\n"),
        "{told}"
    );
    assert!(told.contains("new texture   128 x 128 texels\n"), "{told}");
    assert!(told.contains("steps         at most 600\n"), "{told}");
    assert!(told.lines().all(|line| line.chars().count() <= 80), "{told}");
    assert!(!told.contains("problem"), "{told}");
}

#[test]
fn cameras_that_are_known_roughly_are_learnt_after_the_first_stage() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 9, 4);
    let said = said(folder, &["new", "ball", "--images", "photos", "--rough-cameras"]);
    assert!(said.contains("its colours; cameras, too\n"), "{said}");
    let fit = step(folder, "ball/scene.toml");
    assert_eq!(names(&fit), ["vertices/object", "colors/object", "cameras"]);
    assert!(fit.scene().description.stop.held_out.is_none());
    let stages = &fit.scene().description.stages;
    let learns_cameras = |stage: &Stage| {
        stage.learn.as_ref().is_none_or(|keys| keys.iter().any(|key| key == "cameras"))
    };
    assert_eq!(stages.iter().map(learns_cameras).collect::<Vec<_>>(), [false, true, true]);
    let [_, told] = ended(folder, &["new", "other", "--rough-cameras"], 2);
    assert!(told.contains("--images"), "{told}");
}

#[test]
fn masks_that_make_no_hull_lead_to_a_sphere_and_a_note() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 4, 4);
    // All look along one direction.
    let side_by_side = |k: f64| {
        let pose = DMat4::from_translation(DVec3::new(0.1 * k, 0.0, 4.0));
        pose.transpose().to_cols_array_2d()
    };
    let frames = (0..4).map(|k| {
        let name = format!("images/{k:02}.png");
        json!({ "file_path": name, "transform_matrix": side_by_side(k.into()) })
    });
    let frames: Vec<_> = frames.collect();
    let all = json!({ "w": 32, "h": 32, "fl_x": 48, "frames": frames });
    write(folder, "photos/transforms.json", all.to_string());
    let said = said(folder, &["new", "ball", "--images", "photos"]);
    let note = "note: the fit starts from a sphere: ball/scene.toml:";
    assert!(
        said.contains(note) && said.contains("a hull needs cameras that look at one place"),
        "{said}"
    );
    assert!(said.contains("mesh     a sphere to start from\n"), "{said}");
    let fit = step(folder, "ball/scene.toml");
    assert_eq!(names(&fit), ["vertices/object", "texture/object"]);
    assert!(fit.scene().description.stages.iter().all(|stage| stage.remesh.is_none()));
}

/// A recipe that is there as a comment works without its comment signs.
#[test]
fn the_recipe_for_a_pose_that_is_far_off_can_be_taken_as_it_stands() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    photographs(folder, 9, 4);
    textured(folder);
    said(folder, &["new", "quad", "--from", "model/quad.obj", "--images", "photos"]);
    let file = folder.join("quad/scene.toml");
    let text = fs::read_to_string(&file).unwrap();
    let keys = ["[learn.pose]", "starts = ", "silhouette = "];
    let bare = |line: &str| match line.strip_prefix("# ") {
        Some(own) if keys.iter().any(|key| own.starts_with(key)) => own.to_owned(),
        _ => line.to_owned(),
    };
    let lines: Vec<_> = text.lines().map(bare).collect();
    fs::write(&file, lines.join("\n")).unwrap();
    let fit = step(folder, "quad/scene.toml");
    let description = &fit.scene().description;
    assert_eq!(description.learn.pose.as_ref().unwrap().starts.unwrap().0, 64, "{text}");
    assert_eq!(fit.starts().len(), 1, "{:?}", fit.starts());
    assert_eq!(description.loss.silhouette.unwrap().0, 1.0);
    assert!(names(&fit).iter().any(|own| own.starts_with("pose/")), "{:?}", names(&fit));
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
    // Without opacity: a hull takes longer, and has nothing to do with where a model lies.
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
            write(folder, &format!("in/{images}{name}.png"), disk(32, 32, 3));
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
fn circles_of_confusion_that_are_cut_are_noted_once() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let view = |name: &str, aperture: f64| {
        format!(
            "[[views]]\nname = {name:?}\nlens = {{ aperture = {aperture:.1} }}\n\
             camera = {{ size = [32, 24], focal = 30, position = [0, 0, 4] }}\n"
        )
    };
    // Half of an aperture at this distance.
    let scene = |apertures: [f64; 2], key: &str| {
        let views = [view("a", apertures[0]), view("b", apertures[1])].concat();
        format!(
            "[[meshes]]\nshape = \"plane\"\nplace = {{ scale = 1.0 }}\n{views}\
             [pipeline.lens]\naperture = 1.0\nfocus = 2.0\n{key}"
        )
    };
    write(folder, "cut.toml", scene([140.0, 120.0], ""));
    for words in [&["inspect", "cut.toml"][..], &["render", "cut.toml", "--out", "out"]] {
        let told = said(folder, words);
        let rule =
            " circles of confusion, most of them in view \"a\", are cut to `largest_radius` of ";
        assert_eq!(told.matches(rule).count(), 1, "{told}");
    }
    for (apertures, key) in [([120.0; 2], ""), ([140.0; 2], "largest_radius = 80\n")] {
        write(folder, "fine.toml", scene(apertures, key));
        let told = said(folder, &["inspect", "fine.toml"]);
        assert!(!told.contains("largest_radius"), "{told}");
    }
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
