//! Fits and pictures of scenes, by `bokashi fit` and `bokashi render`.

use super::*;

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
    for (out, start) in [("whole", 0), ("part", 6)] {
        let page = fs::read_to_string(folder.join(out).join("index.html")).unwrap();
        assert!(page.contains(&format!("from step {start} on")), "{out}");
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
    let is_said = " aligned with the images before scores were made: ";
    assert!(told.contains(is_said), "{told}");
    let [inspected, _] = ended(folder, &["inspect", "a<b&c/scene.toml"], 0);
    assert!(inspected.contains("is fitted to the images of held-out views"), "{inspected}");
    let page = fs::read_to_string(folder.join("out/index.html")).unwrap();
    // Of 84 steps a frame before the first, and one after every sixth.
    let film = fs::read(folder.join("out/views/film.png")).unwrap();
    let control = film.windows(8).find(|bytes| bytes.starts_with(b"acTL")).unwrap();
    assert!(control[4..] == 15_u32.to_be_bytes() && page.contains("src=\"views/film.png\""));
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
    let found = outcome(folder, "--out photos/out --turntable");
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
    // All of them stand in the world.
    let points = |file: &str| {
        let model = read_model(&out, file).unwrap();
        assert_eq!((model.geometries[0].faces.len(), model.images[0].width), (192, 8), "{file}");
        let point = |vertex: &u32| {
            let position = model.geometries[0].positions[*vertex as usize].map(f64::from);
            model.placed[0].transform.transform_point3(position.into())
        };
        model.geometries[0].faces.as_flattened().iter().map(point).collect::<Vec<_>>()
    };
    let expected = points("mesh.glb");
    for file in ["mesh.obj", "sphere.ply"] {
        let off =
            points(file).iter().zip(&expected).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(off < 1e-6, "{file}: {off}");
    }
    let numbers: Value = serde_json::from_str(&out.read_text("numbers.json").unwrap()).unwrap();
    assert!(numbers["objects"]["sphere"]["places"][0][3][3] == 1.0);
    for what in ["result", "target", "difference"] {
        let file = format!("views/00-{what}.png");
        let size = Picture::decode_size(&out.read(&file).unwrap(), &Location::new(&file)).unwrap();
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
    // Three of each view, the film, and the turntable.
    assert_eq!(page.matches("<img ").count(), 17);
    for (file, frames) in [("views/turntable.png", Some(36)), ("views/turntable-still.png", None)] {
        let bytes = out.read(file).unwrap();
        assert_eq!(frames_of(&bytes), frames, "{file}");
        assert_eq!(Picture::decode_size(&bytes, &Location::new(file)).unwrap(), [32, 32]);
    }
    // It shows what was learnt, to six bits.
    let still = Picture::decode(
        &out.read("views/turntable-still.png").unwrap(),
        &Location::new("turntable-still.png"),
    );
    let still = still.unwrap();
    let off = |scene: &Scene| {
        let turned = scene.turntable(36).unwrap();
        let picture = turned.pictures(1).unwrap().next().unwrap().unwrap();
        let shown = (0..3).map(|channel| still.channel(channel).unwrap()).collect::<Vec<_>>();
        let off = |k: usize| picture.data()[k] - shown[k % 3].data()[k / 3];
        (0..picture.size()).map(|k| off(k).abs()).fold(0.0, f32::max)
    };
    let scene = Scene::load(folder.join("photos/scene.toml")).unwrap();
    assert!(off(&scene) > 0.1, "{}", off(&scene));
    let saved = folder.join("photos/out/checkpoint.safetensors");
    let mut fit = SceneFit::resume(scene, saved).unwrap();
    // Cameras that are aligned after the fit was saved are in the circle, too.
    fit.align().unwrap();
    let learnt = fit.learnt().unwrap();
    assert!(off(&learnt) < 0.02, "{}", off(&learnt));
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
        Picture::decode(&fs::read(&file).unwrap(), &Location::new(&file)).unwrap()
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

/// How many frames an animated PNG has; `None` for one that stands still.
fn frames_of(png: &[u8]) -> Option<u32> {
    let at = png.windows(4).position(|kind| kind == b"acTL")?;
    Some(u32::from_be_bytes(png[at + 4..at + 8].try_into().unwrap()))
}

#[test]
fn a_scene_is_rendered_from_all_around() {
    let place = tempfile::tempdir().unwrap();
    let folder = place.path();
    let mesh = "[[meshes]]\nshape = \"cube\"\n";
    let view = |name: &str| {
        format!(
            "[[views]]\nname = \"{name}\"\n\
             camera = {{ position = [0, 2, 5], angle = 40, size = [600, 300] }}\n"
        )
    };
    write(folder, "scene.toml", format!("{mesh}{}", view("front")));
    let told = said(folder, &["render", "scene.toml", "--turntable"]);
    assert_eq!(told, "front: 8 files\nturntable.png\n");
    let bytes = fs::read(folder.join("out/turntable.png")).unwrap();
    assert_eq!(frames_of(&bytes), Some(36));
    // Half as large as the view.
    let size = Picture::decode_size(&bytes, &Location::new("turntable.png")).unwrap();
    assert_eq!(size, [300, 150]);
    said(folder, &["render", "scene.toml", "--turntable", "--threads", "1", "--out", "one"]);
    assert!(fs::read(folder.join("one/turntable.png")).unwrap() == bytes);
    // A view of that name is no other file; without a view there is no camera.
    write(folder, "scene.toml", format!("{mesh}{}", view("turntable")));
    let [_, told] = ended(folder, &["render", "scene.toml", "--turntable", "--out", "b"], 1);
    assert!(told.contains("turntable.png could not be written: two results"), "{told}");
    assert!(!folder.join("b").exists());
    write(folder, "scene.toml", mesh);
    let [_, told] = ended(folder, &["render", "scene.toml", "--turntable", "--out", "b"], 2);
    assert!(told.contains("--turntable needs a view: its camera is"), "{told}");
    assert!(!folder.join("b").exists());
}
