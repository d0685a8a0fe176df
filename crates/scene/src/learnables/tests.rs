//! Laws of every row of the table, of what it learns in a scene that has all of it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::sync::Arc;

use bokashi_core::{Tape, Tensor};
use bokashi_fit::{Mapping, Parameter, Parameters};

use super::learnable::Learnable;
use super::table::{TABLE, learnt_keys};
use super::values::Values;
use crate::description::{Learn, LightPlace};
use crate::learning::Learnt;
use crate::renderer::Renderer;
use crate::scene::Scene;

/// A scene with everything that can be learnt. Its numbers are those of `f32`, and inside of all mappings.
const SCENE: &str = r#"
[[meshes]]
shape = "sphere"
faces = 80
material = { texture_size = 4, base_color = [0.25, 0.5, 0.75], roughness = 0.5, metallic = 0.25 }
place = { translation = [0.5, 0.25, 0], scale = 0.75 }
[[meshes]]
shape = "cube"
material = { vertex_colors = true, base_color = [0.25, 0.5, 0.625], roughness = 0.375, metallic = 0.5 }
place = { translation = [-0.75, 0, 0.25], scale = 0.5 }
[[meshes]]
shape = "plane"
material = { base_color = [0.25, 0.375, 0.5], roughness = 0.5, metallic = 0.5 }
place = { translation = [0, -1, 0.25], scale = 0.5 }
[[meshes]]
name = "blob"
shape = "sphere"
faces = 80
material = { vertex_colors = true, base_color = [0.5, 0.25, 0.375], roughness = 0.5, metallic = 0.25 }
place = { translation = [0.25, 0.75, 0.5], scale = 0.375 }
[[views]]
name = "front"
[views.camera]
size = [24, 16]
position = [0.5, 0.5, 4]
angle = 40
distortion = [0.0625, 0, 0, 0, 0]
[[views]]
name = "side"
[views.camera]
size = [24, 16]
position = [3, 1, 3]
angle = 40
distortion = [0.0625, 0, 0, 0, 0]
[[lights]]
kind = "directional"
direction = [0, 0, 1]
color = [2, 1, 2]
[[lights]]
kind = "ambient"
color = [0.25, 0.25, 0.5]
[[lights]]
kind = "point"
position = [-2, 2, 3]
color = [5, 4, 5]
[environment]
color = [0.25, 0.5, 0.25]
size = 8
[pipeline]
exposure = 0.25
blur = 0.75
lens = { aperture = 0.5, focus = 3.5 }
"#;

/// The scene with an empty table of `[learn]` for each row, and its renderer.
fn scene(folder: &Path) -> Renderer {
    scene_with(folder, "", "")
}

/// The scene with other text in the place of some of it.
fn scene_with(folder: &Path, from: &str, to: &str) -> Renderer {
    let keys: BTreeSet<_> = TABLE.iter().map(|row| row.key).collect();
    let table = |key: &&str| match *key {
        "field" => "[learn.field]\nmeshes = [\"blob\"]\ncells = 6\n".to_owned(),
        "colors" => "[learn.colors]\nmeshes = [\"cube\", \"blob\"]\n".to_owned(),
        // The cube's and the blob's are white, under their colours.
        "texture" => "[learn.texture]\nmeshes = [\"sphere\", \"plane\"]\n".to_owned(),
        key => format!("[learn.{key}]\n"),
    };
    let learn: String = keys.iter().map(table).collect();
    let file = folder.join("scene.toml");
    fs::write(&file, format!("{SCENE}{learn}").replacen(from, to, 1)).unwrap();
    Renderer::new(Arc::new(Scene::load(&file).unwrap())).unwrap()
}

/// Each row, and a scene that has what it learns: a lens has an aperture or a radius, and views have their own.
fn cases(folder: &Path) -> Vec<(Arc<Renderer>, &'static Learnable)> {
    let usual = Arc::new(scene(folder));
    let radius = Arc::new(scene_with(folder, "aperture = 0.5", "radius = 0.0625"));
    let of_views = "name = \"front\"\nlens = { aperture = 0.75, focus = 3 }";
    let own = Arc::new(scene_with(folder, "name = \"front\"", of_views));
    let per_view = "[learn.lens]\nper_view = [\"focus\"]";
    let each = Arc::new(scene_with(folder, "[learn.lens]", per_view));
    let exposed = "name = \"front\"\nexposure = 0.5";
    let exposures = Arc::new(scene_with(folder, "name = \"front\"", exposed));
    let per_view = "[learn.exposure]\nper_view = true";
    let each_exposure = Arc::new(scene_with(folder, "[learn.exposure]", per_view));
    let mut cases = Vec::new();
    for row in TABLE {
        let first = match row.name {
            "radius" => &radius,
            "exposures" => &each_exposure,
            _ => &usual,
        };
        cases.push((Arc::clone(first), row));
        if row.name == "exposure" {
            cases.push((Arc::clone(&exposures), row));
        }
        if row.key == "lens" && row.name != "radius" {
            cases.extend([&own, &each].map(|renderer| (Arc::clone(renderer), row)));
        }
    }
    cases
}

/// A row's parameters at their starts, as values.
fn starts(row: &Learnable, scene: &Scene) -> Vec<Parameter<f32>> {
    let entry = (row.entry)(&scene.description.learn).expect("the scene learns every row");
    let parameters = row.parameters(scene, &entry).unwrap();
    parameters.into_iter().map(|(parameter, _)| parameter).collect()
}

/// The scene with what `value` makes of the starts of a row.
fn put(
    renderer: &Renderer,
    row: &Learnable,
    value: impl Fn(&Parameter<f32>) -> Tensor<f32>,
) -> (Scene, BTreeMap<String, Tensor<f32>>) {
    let mut scene = renderer.scene().clone();
    let starts = starts(row, &scene);
    assert!(!starts.is_empty(), "{} is in the scene", row.key);
    let values: BTreeMap<_, _> =
        starts.iter().map(|start| (start.name().to_owned(), value(start))).collect();
    row.put(&mut scene, renderer.frame(), |name| values.get(name).cloned()).unwrap();
    (scene, values)
}

/// A value that the mapping of `start` reaches, not far from it, and other for each entry.
fn moved(start: &Parameter<f32>) -> Tensor<f32> {
    let value = start.raw();
    let share = |k: usize| 0.03 + 0.02 * (k % 5) as f32;
    let moved = |k: usize| match start.mapped_by() {
        Mapping::Identity => value.data()[k] + share(k),
        _ => value.data()[k] * (1.0 + share(k)),
    };
    Tensor::from_flat_fn(value.shape(), moved)
}

/// The numbers of a scene that rows can change.
fn numbers(scene: &Scene) -> Vec<f64> {
    let mut all = Vec::new();
    let mut add = |tensor: &Tensor<f32>| all.extend(tensor.data().iter().map(|&x| f64::from(x)));
    for object in &scene.objects {
        add(&object.positions);
        object.colors.iter().for_each(|colors| add(&colors.rows));
        for material in &object.materials {
            add(&Tensor::from(material.base_color));
            add(&Tensor::from([material.roughness, material.metallic]));
            let maps = [&material.texture, &material.roughness_metallic];
            maps.into_iter().flat_map(|map| &map.texels).for_each(&mut add);
        }
    }
    scene.environment.iter().for_each(&mut add);
    for object in &scene.objects {
        all.extend(object.places.iter().flat_map(|place| place.to_cols_array()));
    }
    for view in &scene.views {
        all.extend(view.camera.view.to_cols_array());
        all.extend(view.camera.intrinsics);
        all.extend(view.camera.distortion.coefficients());
    }
    let pipeline = &scene.description.pipeline;
    for light in &scene.description.lights {
        all.extend(light.color());
        all.extend(light.place().into_iter().flat_map(|place| match place {
            LightPlace::Direction(place) | LightPlace::Position(place) => place.to_array(),
        }));
    }
    let lens = pipeline.lens.unwrap();
    all.extend([pipeline.exposure.unwrap().0, pipeline.blur.unwrap().0]);
    all.extend([lens.opening.number(), lens.focus.0]);
    all.extend(scene.views.iter().map(|view| view.exposure));
    for view in &scene.views {
        all.push(view.lens.opening.unwrap_or(lens.opening).number());
        all.push(view.lens.focus.unwrap_or(lens.focus).0);
    }
    all
}

/// The light of the first view, where `learnt` is learnt.
fn image(renderer: &Renderer, learnt: Option<&Parameters<f32>>) -> Tensor<f32> {
    let tape = Tape::new();
    let variables = learnt.map(|parameters| parameters.record(&tape));
    let values = Values { tape: &tape, learnt: variables.as_ref() };
    let drawn = renderer.draw(&values, 0, 1, false).unwrap();
    renderer.image(&values, &drawn, 1).unwrap().value()
}

/// A direction as a fit starts from it.
fn unit(direction: &Tensor<f32>) -> Tensor<f32> {
    let [x, y, z] = [0, 1, 2].map(|k| f64::from(direction.data()[k]));
    Tensor::from(glam::DVec3::new(x, y, z).normalize().as_vec3().to_array())
}

fn furthest(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn the_start_of_each_row_gives_the_scene_back() {
    let folder = tempfile::tempdir().unwrap();
    for (renderer, row) in cases(folder.path()) {
        let expected = numbers(renderer.scene());
        let (found, values) = put(&renderer, row, |start| start.raw().clone());
        let names: Vec<_> = values.keys().collect();
        assert_eq!(numbers(&found).len(), expected.len(), "{names:?}");
        for (found, expected) in numbers(&found).into_iter().zip(&expected) {
            // A motion by nothing goes there and back.
            assert!((found - expected).abs() <= 1e-15 * expected.abs().max(4.0), "{names:?}");
        }
    }
}

#[test]
fn what_each_row_learns_is_drawn_from_the_scene_as_it_is_drawn_from_the_tape() {
    let folder = tempfile::tempdir().unwrap();
    for (renderer, row) in cases(folder.path()) {
        let before = image(&renderer, None);
        let (with_it, values) = put(&renderer, row, moved);
        let learnt = values.iter().fold(Parameters::new(), |all, (name, value)| {
            all.with(Parameter::new(name, value.clone())).unwrap()
        });
        let found = image(&Renderer::new(Arc::new(with_it)).unwrap(), None);
        let on_tape = image(&renderer, Some(&learnt));
        let names: Vec<_> = values.keys().collect();
        let off = furthest(found.data(), on_tape.data());
        let change = furthest(before.data(), on_tape.data());
        println!("{names:?} changes {change:.1e}, off {off:.1e}");
        assert!(change > 1e-4 && off < 1e-5 + 1e-3 * change, "{names:?}: {change:e}, {off:e}");
        // Whoever keeps fragments is told of what moves them.
        let moves = {
            let fragments = |learnt: Option<&Parameters<f32>>| {
                let tape = Tape::new();
                let variables = learnt.map(|parameters| parameters.record(&tape));
                let values = Values { tape: &tape, learnt: variables.as_ref() };
                let drawn = renderer.draw(&values, 0, 1, false).unwrap();
                drawn.fragments().weight.map(|weight| weight.value().data().to_vec())
            };
            fragments(Some(&learnt)) != fragments(None)
        };
        assert!(!moves || row.moves != super::Moves::Nothing, "{names:?} moves fragments");
    }
}

#[test]
fn what_each_row_learns_is_in_the_files_that_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let written = |scene: &Scene| -> BTreeMap<_, _> {
        let out = folder.path().join("out");
        let mut scene = scene.clone();
        // Cameras are those of images.
        for view in &mut scene.views {
            view.image = Some(format!("{}.png", view.name).into());
        }
        let files = scene.save_results(&out).unwrap();
        files.into_iter().map(|file| (file.clone(), fs::read(file).unwrap())).collect()
    };
    for (renderer, row) in cases(folder.path()) {
        let before = written(renderer.scene());
        assert_eq!(before, written(renderer.scene()));
        let (found, values) = put(&renderer, row, moved);
        assert_ne!(written(&found), before, "{:?}", values.keys());
        // As it was learnt, to the bit: who goes on starts there.
        for start in starts(row, &found) {
            let value = &values[start.name()];
            let expected = match (row.key, start.name()) {
                ("pose" | "cameras" | "intrinsics", _) => Tensor::zeros(value.shape()),
                (_, "light_place/0") => unit(value),
                _ => value.clone(),
            };
            assert_eq!(start.raw(), &expected, "{}", start.name());
        }
    }
}

#[test]
fn every_table_of_learn_has_a_row_and_every_parameter_a_name_of_its_own() {
    let keys = serde_json::to_value(Learn::default()).unwrap();
    let keys: BTreeSet<_> = keys.as_object().unwrap().keys().cloned().collect();
    assert_eq!(keys, TABLE.iter().map(|row| row.key.to_owned()).collect());
    let folder = tempfile::tempdir().unwrap();
    let renderer = scene(folder.path());
    let names = TABLE.iter().flat_map(|row| row.parameter_names(renderer.scene()));
    let mut all = BTreeSet::new();
    names.for_each(|name| assert!(all.insert(name.clone()), "{name} twice"));
}

/// The table of docs/scene.md, against rows and against what a fit takes where its scene says nothing.
#[test]
fn usual_rates_and_their_units_are_those_of_the_page() {
    let page = include_str!("../../../../docs/scene.md");
    let lines = page.lines().skip_while(|line| !line.contains("| usual rate |")).skip(2);
    let mut listed = BTreeMap::new();
    for line in lines.take_while(|line| line.starts_with('|')) {
        let cells: Vec<_> = line.split('|').map(str::trim).collect();
        let rate: f64 = cells[3].split([';', ' ']).next().unwrap().parse().unwrap();
        let keys = cells[1].split('`').skip(1).step_by(2);
        listed.extend(keys.map(|key| (key.to_owned(), (rate, cells[4].to_owned()))));
    }
    let folder = tempfile::tempdir().unwrap();
    let renderer = scene(folder.path());
    let keys = learnt_keys(&renderer.scene().description.learn).into_iter();
    let keys = keys.map(|keys| (keys.key.to_owned(), (keys.usual_rate, keys.unit.to_owned())));
    assert_eq!(listed, keys.collect());
    let radius = renderer.scene().ball().1;
    for rate in Learnt::from_scene(renderer.scene()).unwrap().rates {
        let unit = match rate.name.as_str() {
            // From -1 to 1 along each axis.
            "vertices/cube" => 3.0_f64.sqrt(),
            "vertices/plane" => 2.0_f64.sqrt(),
            "vertices/sphere" => continue,
            // The light of a point.
            "light_place/2" => radius,
            _ => 1.0,
        };
        let expected = unit * listed[rate.key].0;
        assert!((rate.rate / expected - 1.0).abs() < 1e-12, "{}: {}", rate.name, rate.rate);
    }
}
