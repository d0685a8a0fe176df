//! Ranks that were given something else are named at the start, with what it is.

use std::fs;
use std::path::Path;

use bokashi_fit::on_ranks;
use bokashi_scene::{Location, Picture, Samples, Scene, SceneFit};

const SCENE: &str = r#"
seed = 3
[[meshes]]
file = "box.obj"
[cameras]
transforms = "transforms.json"
masks = "masks"
[pipeline]
background = [0.1, 0.1, 0.1]
[learn.pose]
[stop]
steps = 4
views_per_step = 2
"#;

const CAMERAS: &str = r#"{"camera_angle_x": 0.7, "frames": [
{"file_path": "a.png", "transform_matrix": [[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},
{"file_path": "b.png", "transform_matrix": [[1,0,0,0.5],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},
{"file_path": "c.png", "transform_matrix": [[1,0,0,0],[0,1,0,0.5],[0,0,1,5],[0,0,0,1]]}]}"#;

fn gray(file: &Path, level: u8) {
    let samples = Samples::U8(vec![level; 12 * 12 * 3]);
    let picture = Picture { width: 12, height: 12, channels: 3, samples };
    fs::write(file, picture.encode_png(&Location::new(file)).unwrap()).unwrap();
}

fn write(folder: &Path) {
    fs::create_dir_all(folder.join("masks")).unwrap();
    fs::write(folder.join("scene.toml"), SCENE).unwrap();
    fs::write(folder.join("transforms.json"), CAMERAS).unwrap();
    fs::write(folder.join("box.mtl"), "newmtl m\nKd 0.5 0.6 0.7\n").unwrap();
    fs::write(
        folder.join("box.obj"),
        "mtllib box.mtl\nusemtl m\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0.2\nf 1 2 3\nf 1 3 4\n",
    )
    .unwrap();
    for (k, view) in ["a", "b", "c"].into_iter().enumerate() {
        gray(&folder.join(format!("{view}.png")), 100 + k as u8);
        gray(&folder.join(format!("masks/{view}.png")), 255);
    }
}

fn replace(file: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from));
    fs::write(file, text.replace(from, to)).unwrap();
}

#[test]
fn another_file_or_setting_on_one_rank_is_named_before_the_first_step() {
    type Change = fn(&Path);
    let changes: [(&str, Change); 11] = [
        ("`seed`", |folder| replace(&folder.join("scene.toml"), "seed = 3", "seed = 4")),
        ("`stop.views_per_step`", |folder| {
            replace(&folder.join("scene.toml"), "views_per_step = 2", "views_per_step = 3");
        }),
        ("`stop.steps`", |folder| replace(&folder.join("scene.toml"), "steps = 4", "steps = 3")),
        ("`pipeline.background`", |folder| {
            replace(&folder.join("scene.toml"), "[0.1, 0.1, 0.1]", "[0.1, 0.1, 0.2]");
        }),
        ("`learn.pose.rate`", |folder| {
            replace(&folder.join("scene.toml"), "[learn.pose]", "[learn.pose]\nrate = 0.1");
        }),
        ("box.mtl", |folder| replace(&folder.join("box.mtl"), "0.7", "0.8")),
        ("box.obj", |folder| replace(&folder.join("box.obj"), "0.2", "0.3")),
        ("transforms.json", |folder| replace(&folder.join("transforms.json"), "0.5", "0.4")),
        ("b.png", |folder| gray(&folder.join("b.png"), 7)),
        ("masks/c.png", |folder| gray(&folder.join("masks/c.png"), 0)),
        ("masks/a.png", |folder| fs::remove_file(folder.join("masks/a.png")).unwrap()),
    ];
    for (name, change) in changes {
        let directory = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| directory.path().join(name));
        [&one, &other].into_iter().for_each(|folder| write(folder));
        let begun = |odd: usize| {
            on_ranks::<f32, _>(2, |ranks| {
                let folder = if ranks.rank() == odd { &other } else { &one };
                let scene = Scene::load(folder.join("scene.toml")).unwrap();
                SceneFit::among(scene, ranks).err().map(|error| error.to_string())
            })
        };
        // The same in another folder, and with another comment, is the same.
        replace(&other.join("scene.toml"), "[stop]", "# Soon.\n[stop]");
        assert_eq!(begun(1), [const { None }; 2]);
        change(&other);
        for message in begun(1) {
            let message = message.unwrap_or_default();
            assert!(message.contains(&format!("got another {name} on rank ")), "{message}");
            assert!(message.contains("rank 1: it has "), "{message}");
        }
    }
}

/// Of several ranks each has its own images compared by one that does not need them.
#[test]
fn an_image_that_a_rank_needs_is_compared_by_another_one() {
    for odd in 0..3 {
        let directory = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| directory.path().join(name));
        [&one, &other].into_iter().for_each(|folder| write(folder));
        let file = format!("{}.png", ["a", "b", "c"][odd]);
        gray(&other.join(&file), 9);
        let message = on_ranks::<f32, _>(3, |ranks| {
            let folder = if ranks.rank() == odd { &other } else { &one };
            let scene = Scene::load(folder.join("scene.toml")).unwrap();
            SceneFit::among(scene, ranks).err().map(|error| error.to_string())
        });
        for message in message {
            let message = message.unwrap_or_default();
            let is_named = message.contains(&format!("got another {file} on rank "));
            assert!(is_named && message.contains(&format!("rank {odd}")), "{message}");
        }
    }
}
