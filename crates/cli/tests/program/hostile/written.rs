//! What others put into folders and names, where the program writes.

use std::fs;
use std::path::Path;

use super::{TRIANGLE, bokashi, ply, png, refused, scene, text, write};

/// A folder `in` with a scene, beside a file and a folder that are nobody's but the user's.
fn folder(place: &Path) -> std::path::PathBuf {
    let folder = place.join("in");
    write(&folder, "a.png", png(&[]));
    write(&folder, "a.ply", ply(TRIANGLE, [0, 1, 2]));
    write(&folder, "scene.toml", scene());
    fs::write(place.join("victim"), "mine").unwrap();
    fs::create_dir(place.join("elsewhere")).unwrap();
    folder
}

/// The names of all that lies in a folder.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> =
        entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Runs the program, which ends with this status; returns what it says.
#[track_caller]
fn ended(folder: &Path, words: &[&str], status: i32) -> String {
    let output = bokashi(folder, words);
    let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(status), "{words:?}: {said}");
    said
}

#[cfg(unix)]
#[test]
fn nothing_outside_the_folder_of_results_is_written() {
    use std::os::unix::fs::symlink;
    let place = tempfile::tempdir().unwrap();
    let folder = folder(place.path());
    let out = folder.join("out");
    let untouched = || {
        assert_eq!(fs::read(place.path().join("victim")).unwrap(), b"mine");
        assert!(names(&place.path().join("elsewhere")).is_empty());
        assert_eq!(names(place.path()), ["elsewhere", "in", "victim"]);
    };
    let fit: &[&str] = &["fit", "scene.toml", "--out", "out"];
    let around: &[&str] = &["fit", "scene.toml", "--turntable", "--out", "out"];
    let render: &[&str] = &["render", "scene.toml", "--out", "out"];
    let rows = [
        (fit, "index.html", 2),
        (fit, "checkpoint.safetensors", 2),
        (fit, "mesh.glb", 1),
        (fit, "mesh.obj", 1),
        (fit, "mesh.mtl", 1),
        (fit, "environment-panorama.exr", 1),
        (fit, "a.ply", 1),
        (fit, "transforms.json", 1),
        (fit, "numbers.json", 1),
        (fit, "views", 1),
        (fit, "views/a-result.png", 1),
        (around, "views/turntable.png", 1),
        (around, "views/turntable-still.png", 1),
        (render, "a.png", 1),
        (render, "a-ids.exr", 1),
    ];
    for (words, name, status) in rows {
        let up = "../".repeat(1 + name.matches('/').count());
        let ends = if name == "views" { ["elsewhere", "made"] } else { ["victim", "made"] };
        for end in ends {
            fs::create_dir_all(out.join(name).parent().unwrap()).unwrap();
            symlink(format!("{up}../{end}"), out.join(name)).unwrap();
            let said = ended(&folder, words, status);
            let rule = format!("links in out stay in it, and out/{name}");
            assert!(said.contains(&rule), "{name}: {said}");
            untouched();
            // Nothing was done: the link is all that is there.
            let first = name.split('/').next().unwrap();
            assert_eq!(names(&out), [first], "{name}");
            fs::remove_dir_all(&out).unwrap();
        }
    }
    // The usual folder of results is named by nobody; one that is named may be a link.
    symlink("../elsewhere", &out).unwrap();
    for words in [&["fit", "scene.toml"][..], &["render", "scene.toml"], &["--steps", "1"]] {
        let said = ended(&folder, words, 2);
        assert!(said.contains("a folder of results that is a link is named"), "{said}");
        untouched();
    }
    ended(&folder, fit, 0);
    assert!(names(&place.path().join("elsewhere")).contains(&"index.html".to_owned()));
}

#[cfg(unix)]
#[test]
fn a_new_scene_stays_in_its_folder_and_one_that_fails_leaves_nothing() {
    use std::os::unix::fs::symlink;
    let place = tempfile::tempdir().unwrap();
    let folder = folder(place.path());
    write(&folder, "photos/1.png", png(&[]));
    fs::create_dir(folder.join("new")).unwrap();
    let words = ["new", "new", "--images", "photos", "--from", "a.ply"];
    for (name, to) in [
        ("images", "../../elsewhere"),
        ("mesh", "../../elsewhere"),
        ("scene.schema.json", "../../victim"),
    ] {
        symlink(to, folder.join("new").join(name)).unwrap();
        let said = ended(&folder, &words, 2);
        assert!(said.contains("links in new stay in it"), "{name}: {said}");
        assert_eq!(names(&folder.join("new")), [name]);
        assert!(names(&place.path().join("elsewhere")).is_empty());
        assert_eq!(fs::read(place.path().join("victim")).unwrap(), b"mine");
        fs::remove_file(folder.join("new").join(name)).unwrap();
    }
    // A name that no view may have: it is known when the scene is loaded.
    write(&folder, "photos/2\\3.png", png(&[]));
    ended(&folder, &words, 1);
    assert!(names(&folder.join("new")).is_empty());
    ended(&folder, &["new", "a/b", "--images", "photos"], 1);
    assert!(!folder.join("a").exists());
    write(&folder, "new/images/mine", "mine");
    ended(&folder, &words, 1);
    assert_eq!(names(&folder.join("new")), ["images"]);
    assert_eq!(names(&folder.join("new/images")), ["mine"]);
}

#[test]
fn names_that_can_t_be_those_of_files_are_found_before_the_fit() {
    let place = tempfile::tempdir().unwrap();
    let folder = folder(place.path());
    let long = "n".repeat(300);
    let named =
        |name: &str| scene().replace("[[meshes]]\n", &format!("[[meshes]]\nname = {name:?}\n"));
    for name in [long.as_str(), "..", "a/b", "a\0b"] {
        write(&folder, "scene.toml", named(name));
        refused(&folder, &["fit", "scene.toml"]);
        assert!(!folder.join("out").exists(), "{name:?}");
    }
    let view = scene().replace("image = ", &format!("name = {long:?}\nimage = "));
    write(&folder, "scene.toml", view);
    for word in ["fit", "render"] {
        let [_, error] = refused(&folder, &[word, "scene.toml"]);
        assert!(error.contains("bytes is too long for a file"), "{error}");
        assert!(!folder.join("out").exists());
    }
    // A view whose picture is the depth of another.
    let both = format!("{}[[views]]\nname = \"a-depth\"\ncamera = {{ focal = 3, size = [3, 2], position = [0.3, 0.2, 4] }}\n", scene().replace("[learn", "[[views]]\nname = \"b\"\ncamera = { focal = 3, size = [3, 2], position = [0.3, 0.2, 4] }\n[learn"));
    write(&folder, "scene.toml", both);
    let [_, error] = refused(&folder, &["render", "scene.toml"]);
    assert!(
        error.contains("a-depth.png could not be written: two results have this name"),
        "{error}"
    );
}

#[cfg(unix)]
#[test]
fn names_are_shown_and_steer_no_terminal() {
    let place = tempfile::tempdir().unwrap();
    let folder = folder(place.path());
    let evil = "e\u{1b}[31m\u{9b}2J\u{202e}";
    let named = scene()
        .replace("[[meshes]]\n", "[[meshes]]\nname = \"e\\u001b[31m\\u009b2J\\u202e\"\n")
        .replace("image = ", "name = \"e\\u001b[31m\\u009b2J\\u202e\"\nimage = ");
    write(&folder, "scene.toml", &named);
    write(&folder, &format!("{evil}.toml"), &named);
    write(&folder, &format!("{evil}.ply"), ply(TRIANGLE, [0, 1, 2]));
    write(&folder, &format!("{evil}.png"), "no png");
    write(&folder, "a.mtl", format!("newmtl {evil}\nKd {evil}\n"));
    write(
        &folder,
        "a.obj",
        format!("mtllib a.mtl\nusemtl {evil}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    );
    write(
        &folder,
        "b.obj",
        format!("mtllib {evil}\nusemtl {evil}x\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
    );
    write(&folder, "c.obj", format!("v {evil} 0 0\n"));
    write(&folder, "wrong.toml", format!("{evil} = 3\n"));
    let toml = format!("{evil}.toml");
    let [ply, png] = ["ply", "png"].map(|kind| format!("{evil}.{kind}"));
    for words in [
        &["inspect", "scene.toml"][..],
        &["inspect", "scene.toml", "--json", "-"],
        &["inspect", &toml],
        &["inspect", &ply],
        &["inspect", &png],
        &["inspect", "a.obj"],
        &["inspect", "a.obj", "--json", "-"],
        &["inspect", "b.obj"],
        &["inspect", "c.obj"],
        &["inspect", "wrong.toml"],
        &["inspect", evil],
        &["fit", &toml],
        &["fit", &toml, "--json", "-"],
        &["fit", "scene.toml", evil],
        &["fit", "scene.toml", "--steps", evil],
        &["render", "scene.toml"],
        &["render", "scene.toml", "--view", evil],
        &["new", evil, "--from", &ply],
        &[evil],
    ] {
        let output = bokashi(&folder, words);
        let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
        let steers = |c: &char| c.is_control() && !matches!(c, '\n' | '\t') || *c == '\u{202e}';
        assert_eq!(said.chars().find(steers), None, "{words:?}: {said:?}");
    }
    let said = ended(&folder, &["inspect", "scene.toml"], 0);
    assert!(said.contains("\\u{1b}[31m"), "{said}");
}
