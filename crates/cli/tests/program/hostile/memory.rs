//! What is small in a file and large in memory: each is refused by its size, before memory is taken. The limit
//! of the system aborts a program that takes it first.

use super::{MOST_KIB, bokashi, png_of, refused, text, write, zlib_of_zeros};

/// A PNG of so many columns and rows, gray, of zeros.
fn png(extent: u32) -> Vec<u8> {
    let row = 1 + extent as usize;
    png_of([extent, extent], &[], &zlib_of_zeros(row * extent as usize))
}

fn scene(material: &str, size: u32, learn: &str) -> String {
    format!(
        "[[meshes]]\nshape = \"plane\"\n{material}\n[[views]]\nname = \"v\"\nimage = \"v.png\"\n\
         camera = {{ size = [{size}, {size}], angle = 40, position = [0, 0, 4] }}\n{learn}\n[stop]\nsteps = 1\n"
    )
}

#[track_caller]
fn names(error: &str, place: &str, what: &str) {
    let limit = format!("of {}.0 MiB are left", MOST_KIB / 1024 / 2);
    assert!(error.starts_with(&format!("bokashi: {place}: ")), "not at {place}: {error}");
    assert!(error.contains(what) && error.contains(&limit), "no {what:?}, {limit:?}: {error}");
    assert!(error.contains("--memory"), "{error}");
}

#[test]
fn sizes_are_refused_before_memory_is_taken() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    write(folder, "v.png", png(16));
    let large = png(16_383);
    assert!(large.len() < 2_000_000);
    write(folder, "large.png", &large);
    let what = "an image of 16383 x 16383 needs 511.9 MiB";
    names(&refused(folder, &["inspect", "large.png"])[1], "large.png", what);
    write(folder, "photos/1.png", &large);
    names(&refused(folder, &["new", "new", "--images", "photos"])[1], "photos/1.png", what);
    assert!(!folder.join("new").exists());
    // Images of a mesh that fit one by one, and not together.
    let count = 5;
    let mut mtl = String::new();
    let mut obj = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n".to_owned();
    for k in 0..count {
        write(folder, &format!("{k}.png"), png(8192));
        mtl += &format!("newmtl m{k}\nmap_Kd {k}.png\n");
        obj += &format!("usemtl m{k}\nf 1/1 2/2 3/3\n");
    }
    write(folder, "m.mtl", mtl);
    write(folder, "m.obj", &obj);
    let [_, error] = refused(folder, &["inspect", "m.obj"]);
    names(&error, "3.png", "an image of 8192 x 8192 needs 128.0 MiB");
    write(folder, "0.png", png(2000));
    // One image that is in many textures.
    let mtl = (0..count).map(|k| format!("newmtl m{k}\nmap_Kd 0.png\n")).collect::<String>();
    write(folder, "many.mtl", mtl);
    write(folder, "many.obj", obj.replace("m.mtl", "many.mtl"));
    let own = scene("", 16, "[learn.vertices]");
    let own = own.replace("shape = \"plane\"", "file = \"many.obj\"");
    write(folder, "scene.toml", own);
    names(&refused(folder, &["fit", "scene.toml"])[1], "many.obj", "textures of 20000000 texels");
    // What a scene itself asks for.
    let rows = [
        (
            "material = { texture_size = 9000 }",
            16,
            "[learn.vertices]",
            "scene.toml:1:1",
            "textures of 81000000 texels",
        ),
        (
            "material = { texture_size = 3000 }",
            16,
            "[learn.texture]",
            "scene.toml",
            "a fit of 27000000 numbers",
        ),
        ("faces = 10000000", 16, "[learn.vertices]", "scene.toml:1:1", "a shape of 10000000 faces"),
        ("", 16_000, "[learn.vertices]", "v.png", "the view \"v\" of 16000 x 16000"),
        ("", 1000, "[learn.vertices]", "v.png", "the view \"v\" of 1000 x 1000"),
    ];
    for (material, size, learn, place, what) in rows {
        write(folder, "scene.toml", scene(material, size, learn));
        let [_, error] = refused(folder, &["fit", "scene.toml"]);
        names(&error, place, what);
        assert!(!folder.join("out").exists());
    }
    // Drawing takes less than comparing.
    write(folder, "scene.toml", scene("", 1000, "[learn.vertices]"));
    let output = bokashi(folder, &["render", "scene.toml"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    // A lens takes as much for each of its samples.
    let lens = |samples: u32| {
        let lens = format!("[pipeline.lens]\naperture = 2.0\nfocus = 4.0\nsamples = {samples}");
        write(folder, "scene.toml", scene("", 200, &lens));
    };
    lens(1);
    let output = bokashi(folder, &["render", "scene.toml"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    lens(8);
    let [_, error] = refused(folder, &["render", "scene.toml"]);
    names(&error, "v.png", "the view \"v\" of 200 x 200");
    // Whoever knows better says so.
    let output = bokashi(folder, &["inspect", "large.png", "--memory", "512MiB"]);
    let said = text(&output.stderr);
    assert!(!said.contains("--memory"), "{said}");
}
