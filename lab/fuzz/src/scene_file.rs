//! Arbitrary descriptions of scenes.

use std::path::Path;

use bokashi_scene::description::Description;
use bokashi_scene::{Scene, SceneFit};

use super::files::{beside, in_short, small_image};

const OBJ: &[u8] = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
const TRANSFORMS: &[u8] = br#"{"fl_x": 3, "w": 3, "h": 2, "frames": [{"file_path": "a.png",
    "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2]]}]}"#;
/// What a byte 1 stands for, by the byte after it. No text of TOML has a byte 1.
const NUMBERS: [&str; 32] = [
    "0", "-0.0", "1", "-1", "2", "3", "4", "5", "7", "8", "16", "0.5", "-0.25", "0.001", "1e-7",
    "1e-20", "1e-38", "1e-45", "5e-324", "1e-300", "1e7", "1e9", "1e20", "3.4e38", "-3.4e38",
    "1e39", "1e154", "1e300", "1.7e308", "-1.7e308", "nan", "inf",
];

/// Loads the scene that `bytes` describe, beside a mesh, an image and a file of cameras, and begins to fit it
/// where that is short work. A byte 1 and the byte after it are a number. Returns the number of the scene's
/// objects and views.
pub fn scene_file(bytes: &[u8]) -> usize {
    let Ok(text) = String::from_utf8(with_numbers(bytes)) else { return 0 };
    let description = match Description::parse(&text, Path::new("scene.toml")) {
        Ok(description) => description,
        Err(error) => return in_short(&error.into()),
    };
    if !is_short_work(&description) {
        return 0;
    }
    let files = [
        ("scene.toml", text.as_bytes()),
        ("a.obj", OBJ),
        ("a.png", &*small_image()),
        ("t.json", TRANSFORMS),
    ];
    beside(files, |folder| {
        let scene = match Scene::load(folder.join("scene.toml")) {
            Ok(scene) => scene,
            Err(error) => return in_short(&error),
        };
        for view in &scene.views {
            let camera = &view.camera;
            let mut numbers = camera.intrinsics.iter().chain(camera.distortion.coefficients());
            assert!(numbers.all(|number| number.is_finite()), "{camera:?}");
            assert!(camera.view.is_finite(), "{camera:?}");
        }
        for object in &scene.objects {
            assert!(object.positions.is_finite() && !object.places.is_empty());
        }
        let reached = scene.objects.len() + scene.views.len();
        match SceneFit::new(scene).map(|mut fit| fit.step()) {
            Ok(Ok(_)) => {}
            Ok(Err(error)) | Err(error) => drop(in_short(&error)),
        }
        reached
    })
}

fn with_numbers(bytes: &[u8]) -> Vec<u8> {
    let mut parts = bytes.split(|&byte| byte == 1);
    let mut text = parts.next().unwrap_or_default().to_vec();
    for part in parts {
        let (number, rest) = part.split_first().unwrap_or((&0, &[]));
        text.extend_from_slice(NUMBERS[usize::from(*number) % NUMBERS.len()].as_bytes());
        text.extend_from_slice(rest);
    }
    text
}

/// Whether a fit of the scene begins within milliseconds.
fn is_short_work(description: &Description) -> bool {
    let meshes = description.meshes.iter().all(|mesh| {
        let mesh = mesh.get_ref();
        let faces = mesh.faces.is_none_or(|faces| faces.0 <= 100);
        let texels = mesh.material.texture_size.is_none_or(|size| size.0 <= 16);
        faces && texels && mesh.instances.len() <= 3
    });
    let views = description.views.iter().all(|view| {
        let size = view.get_ref().camera.size;
        size.is_none_or(|size| size.iter().all(|extent| extent.0 <= 16))
    });
    let environment = description.environment.iter();
    let sides = environment.filter_map(|own| own.get_ref().size);
    let views_per_step = description.stages.iter().filter_map(|stage| stage.views_per_step);
    let views_per_step = views_per_step.chain(description.stop.views_per_step);
    meshes
        && views
        && sides.into_iter().all(|side| side.0 <= 16)
        && views_per_step.into_iter().all(|count| count.0 <= 4)
        && description.meshes.len() <= 4
        && description.views.len() <= 4
}
