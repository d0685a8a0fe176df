//! A resumed fit is the fit that was never interrupted, or what was changed is named and takes effect.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use bokashi_scene::{Location, Picture, Samples, Scene, SceneFit, description};
use serde_json::Value;

use crate::fixtures::bits;

/// A scene that learns as much as a small one can, with each key of what is learnt, how, and how long.
const SCENE: &str = r#"seed = 1
[[meshes]]
shape = "cube"
material = { vertex_colors = true, base_color = [0.5, 0.4, 0.3] }
[[lights]]
kind = "directional"
direction = [1, 2, 1]
color = [3, 3, 3]
[pipeline]
silhouettes = "exact"
surface = "metallic-roughness"
cull = "none"
texture_filter = "trilinear"
background = [0, 0, 0]
near = 0.01
far = 100.0
tone = "srgb"
exposure = 0.1
blur = 0.5
blur_kernel = "sampled"
lens = { aperture = 4.0, focus = 4.0, surfaces = 2, largest_radius = 20, iris = { blades = 6 }, samples = 1, slopes = false }
[learn.vertices]
rate = 0.01
smoothing = 5.0
rigid = 0.1
laplacian = 0.1
edge_length = 0.1
normals = 0.1
meshes = ["cube"]
[learn.colors]
rate = 0.05
meshes = ["cube"]
[learn.roughness]
rate = 0.05
[learn.metallic]
rate = 0.05
[learn.pose]
rate = 0.01
meshes = ["cube"]
[learn.cameras]
rate = 0.003
[learn.intrinsics]
rate = 0.002
[learn.distortion]
rate = 0.002
[learn.lights]
rate = 0.03
[learn.light_places]
rate = 0.02
[learn.exposure]
rate = 0.02
[learn.blur]
rate = 0.03
[learn.lens]
rate = 0.02
per_view = ["focus"]
[loss]
kind = "squared"
silhouette = 0.5
ssim = 0.1
[[stages]]
steps = 3
reduce = 1
views_per_step = 2
rates = 0.9
[[stages]]
steps = 4
views_per_step = 2
learn = ["vertices", "pose", "colors", "blur"]
"#;

/// Photographs of a disk of two colours in front of nothing, and a scene that learns from them.
fn scene(folder: &Path, text: &str) -> Scene {
    let mut views = String::new();
    for view in 0..4 {
        let sample = |k: usize| {
            let [x, y] = [k / 4 % 32, k / 128].map(|at| at as f64 - 15.5);
            match x.hypot(y) < 8.0 + 2.0 * f64::from(view) {
                true => [200 - 20 * view as u8, 60 + 4 * (k / 4 % 32) as u8, 90, 255][k % 4],
                false => 0,
            }
        };
        let samples = Samples::U8((0..32 * 32 * 4).map(sample).collect());
        let picture = Picture { width: 32, height: 32, channels: 4, samples };
        let file = format!("{view}.png");
        fs::write(folder.join(&file), picture.encode_png(&Location::new(&file)).unwrap()).unwrap();
        let angle = f64::from(view);
        let (x, z) = (5.0 * angle.sin(), 5.0 * angle.cos());
        views += &format!(
            "[[views]]\nimage = {file:?}\ncamera = {{ position = [{x}, 1, {z}], angle = 40.0 }}\n"
        );
    }
    fs::write(folder.join("scene.toml"), text.to_owned() + &views).unwrap();
    Scene::load(folder.join("scene.toml")).unwrap()
}

fn advance(fit: &mut SceneFit, steps: u64) {
    for _ in 0..steps {
        fit.step().unwrap();
    }
}

/// All bits of what was learnt, and the step and rule by which it ended.
fn end(mut fit: SceneFit) -> (u64, Option<String>, Vec<u32>) {
    fit.run(|_| ()).unwrap();
    (fit.steps_done(), fit.ended(), bits(&fit))
}

#[test]
fn a_fit_interrupted_at_any_step_ends_at_the_same_step_with_the_same_bits() {
    let directory = tempfile::tempdir().unwrap();
    let saved = directory.path().join("saved");
    // One view at a time: losses go up and down, and patience has something to wait for.
    let text = SCENE.replace("views_per_step = 2", "views_per_step = 1");
    let text = text.replace("steps = 4", "steps = 9");
    let mut fit = SceneFit::new(scene(directory.path(), &text)).unwrap();
    let losses: Vec<_> = std::iter::from_fn(|| fit.step().unwrap()).map(|step| step.loss).collect();
    let mut ends = BTreeSet::new();
    for stop in [
        String::new(),
        "[stop]\npatience = 1\n".to_owned(),
        "[stop]\npatience = 2\n".to_owned(),
        format!("[stop]\nloss_below = {}\n", losses[5] * (1.0 + 1e-6)),
        format!("[stop]\nloss_below = {}\n", losses[8] * (1.0 + 1e-6)),
        "[stop]\nseconds = 1e6\n".to_owned(),
    ] {
        let load = || scene(directory.path(), &(text.clone() + &stop));
        let whole = end(SceneFit::new(load()).unwrap());
        ends.insert(whole.0);
        for step in 0..=whole.0 {
            let mut fit = SceneFit::new(load()).unwrap();
            advance(&mut fit, step);
            fit.save(&saved).unwrap();
            let again = SceneFit::resume(load(), &saved).unwrap();
            assert_eq!(again.changed(), [""; 0]);
            assert_eq!(again.ended(), fit.ended());
            assert_eq!(end(again), whole, "{stop:?} interrupted after {step} steps");
        }
    }
    // The rules had something to say.
    assert!(ends.len() >= 4, "{ends:?} of {losses:?}");
}

/// Where a stop rule waits for a smaller loss, what it waited before the interruption counts.
#[test]
fn seconds_of_earlier_runs_count() {
    let directory = tempfile::tempdir().unwrap();
    let saved = directory.path().join("saved");
    let text = |seconds: &str| format!("{SCENE}[stop]\nseconds = {seconds}\n");
    let mut fit = SceneFit::new(scene(directory.path(), &text("1e-9"))).unwrap();
    fit.run(|_| ()).unwrap();
    assert_eq!(fit.steps_done(), 1);
    fit.save(&saved).unwrap();
    let mut same = SceneFit::resume(scene(directory.path(), &text("1e-9")), &saved).unwrap();
    same.run(|_| ()).unwrap();
    assert_eq!(same.steps_done(), 1);
    let mut longer = SceneFit::resume(scene(directory.path(), &text("1e6")), &saved).unwrap();
    assert_eq!(
        longer.changed(),
        ["`stop.seconds`: 1000000.0 from now on, and 1e-9 before"].map(String::from)
    );
    longer.run(|_| ()).unwrap();
    assert_eq!(longer.steps_done(), 7);
}

/// Every key of these tables, as `table.key`, from the schema that editors get.
fn keys() -> BTreeSet<String> {
    let schema: Value = serde_json::from_str(&description::schema()).unwrap();
    let properties = |node: &Value| -> Vec<(String, Value)> {
        let properties = node["properties"].as_object().unwrap();
        properties.iter().map(|(name, value)| (name.clone(), value.clone())).collect()
    };
    let target = |node: &Value| -> Value {
        let choices = [&node["$ref"], &node["items"]["$ref"], &node["anyOf"][0]["$ref"]];
        let name = choices.into_iter().find_map(Value::as_str);
        name.map_or(Value::Null, |name| schema["$defs"][name.rsplit('/').next().unwrap()].clone())
    };
    let whole: Vec<_> = properties(&schema);
    let table_schema =
        |table: &str| target(&whole.iter().find(|(name, _)| name == table).unwrap().1);
    let mut all = BTreeSet::new();
    for table in ["pipeline", "learn", "loss", "stages", "stop"] {
        for (name, value) in properties(&table_schema(table)) {
            let inner = target(&value);
            let key = format!("{table}.{name}");
            match inner["properties"].is_object() {
                true => {
                    all.extend(properties(&inner).iter().map(|(name, _)| format!("{key}.{name}")))
                }
                false => drop(all.insert(key)),
            }
        }
    }
    all
}

/// What becomes of a change between save and resume.
#[derive(Clone, Copy)]
enum Then {
    /// It is named, and takes effect.
    Takes,
    /// It is refused, with these words.
    Refused(&'static str),
    /// It is named, and nothing that is learnt here can tell.
    Named,
}

/// A key, text of the scene, what stands in its place, and what becomes of that.
fn changes() -> Vec<(&'static str, &'static str, &'static str, Then)> {
    use Then::{Named, Refused, Takes};
    let start = "the start that it learnt from";
    let both = Refused("either the `field` or the `vertices`");
    vec![
        ("pipeline.silhouettes", "\"exact\"", "\"aliased\"", Takes),
        ("pipeline.surface", "surface = \"metallic-roughness\"", "surface = \"lambert\"", Takes),
        // The far side of a closed mesh is a hidden surface.
        ("pipeline.cull", "cull = \"none\"", "cull = \"back\"", Takes),
        ("pipeline.texture_filter", "\"trilinear\"", "\"nearest\"", Named),
        ("pipeline.background", "background = [0, 0, 0]", "background = [0.2, 0, 0]", Takes),
        ("pipeline.near", "near = 0.01", "near = 4.2", Takes),
        ("pipeline.far", "far = 100.0", "far = 5.0", Takes),
        ("pipeline.tone", "tone = \"srgb\"", "tone = \"linear\"", Takes),
        ("pipeline.exposure", "exposure = 0.1", "exposure = 0.3", Refused(start)),
        ("pipeline.blur", "blur = 0.5", "blur = 0.7", Refused(start)),
        ("pipeline.blur_kernel", "\"sampled\"", "\"disc\"", Takes),
        ("pipeline.lens.aperture", "aperture = 4.0", "aperture = 4.5", Refused(start)),
        ("pipeline.lens.focus", "focus = 4.0", "focus = 4.5", Refused(start)),
        (
            "pipeline.lens.radius",
            "aperture = 4.0",
            "radius = 0.4",
            Refused("the scene's parameters"),
        ),
        ("pipeline.lens.surfaces", "surfaces = 2", "surfaces = 0", Takes),
        ("pipeline.lens.iris", "iris = { blades = 6 }", "iris = { blades = 5 }", Takes),
        ("pipeline.lens.samples", "samples = 1", "samples = 2", Takes),
        ("pipeline.lens.slopes", "slopes = false", "slopes = true", Takes),
        ("pipeline.lens.largest_radius", "largest_radius = 20", "largest_radius = 21", Named),
        // What they change is held elsewhere.
        ("learn.field.rate", "[learn.vertices]", "[learn.field]\nrate = 1\n[learn.vertices]", both),
        (
            "learn.field.meshes",
            "[learn.vertices]",
            "[learn.field]\nmeshes = [\"cube\"]\n[learn.vertices]",
            both,
        ),
        (
            "learn.field.cells",
            "[learn.vertices]",
            "[learn.field]\ncells = 9\n[learn.vertices]",
            both,
        ),
        (
            "learn.field.smoothing",
            "[learn.vertices]",
            "[learn.field]\nsmoothing = 1\n[learn.vertices]",
            both,
        ),
        ("learn.vertices.rate", "rate = 0.01\nsmoothing", "rate = 0.02\nsmoothing", Takes),
        ("learn.vertices.smoothing", "smoothing = 5.0", "smoothing = 9.0", Refused("lambda")),
        ("learn.vertices.rigid", "rigid = 0.1", "rigid = 0.2", Takes),
        ("learn.vertices.laplacian", "laplacian = 0.1", "laplacian = 0.2", Takes),
        ("learn.vertices.edge_length", "edge_length = 0.1", "edge_length = 0.2", Takes),
        ("learn.vertices.normals", "normals = 0.1", "normals = 0.2", Takes),
        // The same meshes, all of them.
        ("learn.vertices.meshes", "normals = 0.1\nmeshes = [\"cube\"]", "normals = 0.1", Named),
        ("learn.colors.rate", "rate = 0.05\nmeshes", "rate = 0.09\nmeshes", Takes),
        ("learn.colors.meshes", "rate = 0.05\nmeshes = [\"cube\"]", "rate = 0.05", Named),
        (
            "learn.roughness.rate",
            "[learn.roughness]\nrate = 0.05",
            "[learn.roughness]\nrate = 0.1",
            Takes,
        ),
        (
            "learn.metallic.rate",
            "[learn.metallic]\nrate = 0.05",
            "[learn.metallic]\nrate = 0.1",
            Takes,
        ),
        ("learn.pose.rate", "[learn.pose]\nrate = 0.01", "[learn.pose]\nrate = 0.02", Takes),
        ("learn.pose.meshes", "rate = 0.01\nmeshes = [\"cube\"]", "rate = 0.01", Named),
        // They were tried when the fit began.
        (
            "learn.pose.starts",
            "[learn.pose]\n",
            "[learn.pose]\nstarts = 2\n",
            Refused("the starts that were tried: `learn.pose.starts`"),
        ),
        ("learn.cameras.rate", "rate = 0.003", "rate = 0.004", Takes),
        (
            "learn.intrinsics.rate",
            "[learn.intrinsics]\nrate = 0.002",
            "[learn.intrinsics]\nrate = 0.004",
            Takes,
        ),
        (
            "learn.distortion.rate",
            "[learn.distortion]\nrate = 0.002",
            "[learn.distortion]\nrate = 0.004",
            Takes,
        ),
        ("learn.lights.rate", "[learn.lights]\nrate = 0.03", "[learn.lights]\nrate = 0.04", Takes),
        (
            "learn.light_places.rate",
            "[learn.light_places]\nrate = 0.02",
            "[learn.light_places]\nrate = 0.03",
            Takes,
        ),
        (
            "learn.exposure.rate",
            "[learn.exposure]\nrate = 0.02",
            "[learn.exposure]\nrate = 0.03",
            Takes,
        ),
        (
            "learn.exposure.per_view",
            "[learn.exposure]\n",
            "[learn.exposure]\nper_view = true\n",
            Refused("the scene's parameters"),
        ),
        ("learn.blur.rate", "[learn.blur]\nrate = 0.03", "[learn.blur]\nrate = 0.04", Takes),
        ("learn.lens.rate", "[learn.lens]\nrate = 0.02", "[learn.lens]\nrate = 0.03", Takes),
        ("learn.lens.per_view", "per_view = [\"focus\"]\n", "", Refused("the scene's parameters")),
        ("loss.kind", "\"squared\"", "\"huber\"", Takes),
        ("loss.silhouette", "silhouette = 0.5", "silhouette = 0.6", Takes),
        ("loss.ssim", "ssim = 0.1", "ssim = 0.2", Takes),
        ("stages.steps", "steps = 3", "steps = 5", Takes),
        ("stages.reduce", "reduce = 1", "reduce = 2", Takes),
        (
            "stages.views_per_step",
            "steps = 3\nreduce = 1\nviews_per_step = 2",
            "steps = 3\nviews_per_step = 3",
            Takes,
        ),
        ("stages.rates", "rates = 0.9", "rates = 0.4", Takes),
        (
            "stages.remesh.length",
            "rates = 0.9",
            "remesh = { length = 0.2 }",
            Refused("`remesh` goes without"),
        ),
        (
            "stages.remesh.every",
            "rates = 0.9",
            "remesh = { length = 0.2, every = 2 }",
            Refused("`remesh` goes without"),
        ),
        (
            "stages.texture.size",
            "rates = 0.9",
            "texture = { size = 64 }",
            Refused("needs `learn.colors` and `learn.texture`"),
        ),
        ("stages.learn", "rates = 0.9", "learn = [\"vertices\"]", Takes),
        ("stop.loss_below", "[loss]", "[stop]\nloss_below = 1e3\n[loss]", Takes),
        ("stop.patience", "[loss]", "[stop]\npatience = 1\n[loss]", Named),
        // It is refused without views that are held out.
        (
            "stop.held_out.every",
            "[loss]",
            "[stop]\nheld_out = { every = 1, patience = 1 }\n[loss]",
            Refused("`stop.held_out` measures views"),
        ),
        (
            "stop.held_out.patience",
            "[loss]",
            "[stop]\nheld_out = { every = 1, patience = 2 }\n[loss]",
            Refused("`stop.held_out` measures views"),
        ),
        (
            "stop.held_out.gain",
            "[loss]",
            "[stop]\nheld_out = { every = 1, patience = 1, gain = 1 }\n[loss]",
            Refused("`stop.held_out` measures views"),
        ),
        ("stop.seconds", "[loss]", "[stop]\nseconds = 1e-9\n[loss]", Takes),
        // With stages it says nothing.
        ("stop.steps", "[loss]", "[stop]\nsteps = 2\n[loss]", Named),
        ("stop.views_per_step", "[loss]", "[stop]\nviews_per_step = 2\n[loss]", Named),
        ("seed", "seed = 1", "seed = 2", Takes),
    ]
}

#[test]
fn what_is_changed_before_a_fit_goes_on_is_named_and_takes_effect_or_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let (early, late) = (directory.path().join("early"), directory.path().join("late"));
    let mut fit = SceneFit::new(scene(directory.path(), SCENE)).unwrap();
    fit.save(&early).unwrap();
    advance(&mut fit, 2);
    fit.save(&late).unwrap();
    let unchanged = end(fit);
    let mut known = BTreeSet::new();
    for (key, from, to, then) in changes() {
        known.insert(key.to_owned());
        assert!(SCENE.contains(from), "{key}");
        let text = SCENE.replacen(from, to, 1);
        let load = || scene(directory.path(), &text);
        let resumed = SceneFit::resume(load(), &late);
        if let Then::Refused(words) = then {
            let message = resumed.err().map(|error| error.to_string()).unwrap_or_default();
            assert!(message.contains(words), "{key}: {message}");
            continue;
        }
        let resumed = resumed.unwrap_or_else(|error| panic!("{key}: {error}"));
        let key_at = key.replace("stages.", "stages[0].");
        let is_named =
            resumed.changed().iter().any(|message| message.starts_with(&format!("`{key_at}")));
        assert!(is_named, "{key}: {:?}", resumed.changed());
        let found = end(resumed);
        let is_other = found != unchanged;
        assert_eq!(is_other, matches!(then, Then::Takes), "{key}");
        // What is saved before the first step is a fit of what is changed, from its start.
        let first = end(SceneFit::resume(load(), &early).unwrap());
        assert_eq!(first, end(SceneFit::new(load()).unwrap()), "{key}");
    }
    let keys = keys();
    assert!(keys.len() > 40, "{keys:?}");
    // Maps and light from all sides are not in the scene; they are learnt as roughness and lights are.
    let absent = ["learn.texture.", "learn.environment."];
    let others = ["meshes", "total_variation"];
    let is_elsewhere = |key: &&String| {
        absent.iter().any(|value| key.starts_with(value))
            || (key.starts_with("learn.roughness.") || key.starts_with("learn.metallic."))
                && others.iter().any(|other| key.ends_with(other))
    };
    let missing: Vec<_> = keys.difference(&known).filter(|key| !is_elsewhere(key)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}

#[test]
fn a_fit_made_longer_continues_the_longer_schedule() {
    let directory = tempfile::tempdir().unwrap();
    let saved = directory.path().join("saved");
    let text = |steps: usize| {
        format!(
            "[[meshes]]\nshape = \"cube\"\n[learn.pose]\n[stop]\nsteps = {steps}\nviews_per_step = 4\n"
        )
    };
    let factor = |step: f64, steps: f64| {
        0.01 + 0.99 * 0.5 * (1.0 + (std::f64::consts::PI * step / steps).cos())
    };
    // In the middle of the new schedule, and its last step.
    for (done, steps) in [(4, 8), (4, 5), (20, 21)] {
        let mut fit = SceneFit::new(scene(directory.path(), &text(done))).unwrap();
        fit.run(|_| ()).unwrap();
        fit.save(&saved).unwrap();
        let step_of = |steps: usize| {
            let mut fit = SceneFit::resume(scene(directory.path(), &text(steps)), &saved).unwrap();
            let message = format!("`stop.steps`: {steps} from now on, and {done} before");
            assert_eq!(fit.changed(), [message]);
            let pose = |fit: &SceneFit| fit.parameters().value("pose/cube").unwrap();
            let before = pose(&fit);
            fit.step().unwrap().unwrap();
            let after = pose(&fit);
            let moves = after.data().iter().zip(before.data());
            moves.map(|(a, b)| f64::from((a - b).abs())).fold(0.0, f64::max)
        };
        // Steps of Adam are in proportion to the rate.
        let ratio = step_of(steps) / step_of(100_000);
        let [done, steps] = [done, steps].map(|value| value as f64);
        let expected = factor(done, steps) / factor(done, 1e5);
        assert!((ratio / expected - 1.0).abs() < 0.01, "{ratio} at step {done} of {steps}");
    }
}

#[test]
fn stages_that_are_done_stay_as_they_were_and_files_are_named() {
    let directory = tempfile::tempdir().unwrap();
    let saved = directory.path().join("saved");
    let mut fit = SceneFit::new(scene(directory.path(), SCENE)).unwrap();
    advance(&mut fit, 5);
    fit.save(&saved).unwrap();
    let resume = |from: &str, to: &str| {
        let scene = scene(directory.path(), &SCENE.replacen(from, to, 1));
        SceneFit::resume(scene, &saved)
    };
    let error = resume("steps = 3", "steps = 4").err().unwrap().to_string();
    assert!(
        error.contains("the stages that are done as they were: `stages[0].steps`, 3"),
        "{error}"
    );
    let longer = resume("steps = 4", "steps = 9").unwrap();
    assert_eq!((longer.steps_done(), longer.steps()), (5, 12));
    // Another mesh that is learnt, and another image.
    let cube = "shape = \"cube\"";
    let error = resume(cube, &format!("{cube}\nfaces = 48")).err().unwrap().to_string();
    assert!(error.contains("with the preconditioner of"), "{error}");
    let loaded = scene(directory.path(), SCENE);
    let bytes = fs::read(directory.path().join("2.png")).unwrap();
    fs::write(directory.path().join("0.png"), bytes).unwrap();
    let fit = SceneFit::resume(loaded, &saved).unwrap();
    assert_eq!(fit.changed().len(), 1);
    assert!(fit.changed()[0].starts_with("0.png: "), "{:?}", fit.changed());
}
