//! What `bokashi inspect` says of files, and what is wrong with them.

use super::*;

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
fn maps_without_their_images_are_told() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    textured(folder);
    let material = "newmtl skin\nmap_Kd gone.png\nmap_Pr maps/my skin.png\nnorm away.png\n";
    write(folder, "model/quad.mtl", material);
    let view = "camera = { position = [0, 0, 5], target = [0, 0, 0], angle = 40, size = [8, 8] }\n";
    let scene = format!("[[meshes]]\nfile = \"model/quad.obj\"\n[[views]]\nname = \"a\"\n{view}");
    write(folder, "scene.toml", scene);
    for (file, color, other) in
        [("model/quad.obj", "colour map", "metal map "), ("scene.toml", "texture   ", "rough map ")]
    {
        let [told, _] = ended(folder, &["inspect", file], 1);
        for label in [color, "normal map"] {
            assert!(told.contains(&format!("  {label}    its image was left out\n")), "{told}");
        }
        assert!(told.contains(&format!("  {other}    16 x 8 texels")), "{told}");
    }
    let output = run(PROGRAM, folder, &["inspect", "scene.toml", "--json", "-"]);
    let json: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let material = &json["objects"][0]["materials"][0];
    assert_eq!(material.get("normal map"), Some(&Value::Null), "{json}");
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
            .encode_png(&Location::new("a"))
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
    let output = run(PROGRAM, folder, &["inspect", "scene.toml", "--json", "-"]);
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
    let fit = step(folder, "a/scene.toml");
    fit.save(folder.join("fit.safetensors")).unwrap();
    let told = said(folder, &["inspect", "fit.safetensors"]);
    assert!(told.contains("  steps done    1\n"), "{told}");
    let vertices = fit.scene().objects[0].mesh.vertex_count();
    let shape = format!("parameter \"vertices/object\"\n  shape         [{vertices},3]\n");
    assert!(told.contains(&shape), "{told}");
    let clear =
        Picture { width: 1, height: 1, channels: 4, samples: Samples::U8(vec![255, 255, 255, 0]) };
    write(folder, "clear.png", clear.encode_png(&Location::new("a")).unwrap());
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
