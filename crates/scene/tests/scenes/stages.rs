//! Stages of a fit, and what it leaves.

use std::path::Path;

use bokashi_scene::{Scene, SceneFit};

use super::fixtures::{furthest, load, png, value};

#[test]
fn what_was_learnt_is_drawn_as_the_fit_drew_it() {
    let folder = tempfile::tempdir().unwrap();
    png(folder.path());
    let head = r#"
[[meshes]]
shape = "sphere"
faces = 200
material = { texture_size = 8, roughness = 0.5, metallic = 0.3 }
place = { translation = [0.4, 0.1, -0.3], rotation = [0, 0.6, 0, 0.8], scale = 0.9 }
instances = [{ translation = [1, 0, 0], scale = 0.4 }]
[[views]]
image = "a.png"
camera = { position = [0.5, 0.4, 4], target = [0.2, 0, 0], angle = 40, distortion = [0.01, 0, 0, 0, 0] }
[[lights]]
kind = "directional"
direction = [1, 2, 3]
color = [3, 2, 3]
[[lights]]
kind = "point"
position = [-2, 2, 3]
color = [9, 10, 9]
[pipeline]
exposure = 0.1
blur = 0.7
background = [0.1, 0.2, 0.3]
[stop]
steps = 6
"#;
    let keys = [
        "vertices",
        "texture",
        "roughness",
        "metallic",
        "pose",
        "cameras",
        "intrinsics",
        "distortion",
        "lights",
        "light_places",
        "exposure",
        "blur",
    ];
    for key in keys {
        let scene = load(folder.path(), &format!("{head}[learn.{key}]\nrate = 0.1\n"));
        let mut fit = SceneFit::new(scene).unwrap();
        let first = fit.compare(0).unwrap().image;
        while fit.step().unwrap().is_some() {}
        let last = fit.compare(0).unwrap().image;
        let again = SceneFit::new(fit.learnt().unwrap()).unwrap().compare(0).unwrap().image;
        let [moved, off] = [furthest(&first, &last), furthest(&again, &last)];
        println!("{key}: moved {moved}, off {off}");
        assert!(moved > 5e-3 && off < 1e-4, "{key}: moved {moved}, off {off}");
    }
}

/// A ball before three cameras whose images are one.
fn three_views(folder: &Path, rest: &str) -> Scene {
    png(folder);
    let views = [1.0, 2.0, 3.0].map(|x| {
        format!(
            "[[views]]\nname = \"{x}\"\nimage = \"a.png\"\n\
             camera = {{ position = [{x}, 0, 4], angle = 40 }}\n"
        )
    });
    let mesh = "[[meshes]]\nshape = \"sphere\"\nfaces = 80\n";
    load(folder, &format!("{rest}{mesh}{}[pipeline]\nexposure = 0.0\n", views.concat()))
}

#[test]
fn a_stage_learns_what_it_names_and_begins_anew() {
    let folder = tempfile::tempdir().unwrap();
    let stages = "[learn.exposure]\n[learn.texture]\n\
        [[stages]]\nsteps = 3\nviews_per_step = 3\nlearn = [\"exposure\"]\n";
    let second = "[[stages]]\nsteps = 3\nviews_per_step = 3\nlearn = [\"texture\"]\n";
    let third = "[[stages]]\nsteps = 3\nviews_per_step = 3\nlearn = [\"exposure\"]\n";
    let scene = three_views(folder.path(), &format!("{stages}{second}{third}"));
    let mut fit = SceneFit::new(scene).unwrap();
    let both = |fit: &SceneFit| [value(fit, "exposure"), value(fit, "texture/sphere")];
    let mut all = vec![both(&fit)];
    let mut learnt = Vec::new();
    while fit.step().unwrap().is_some() {
        if fit.steps_done().is_multiple_of(3) {
            all.push(both(&fit));
            learnt.push(fit.learnt().unwrap());
        }
    }
    let changed = |stage: usize, which: usize| all[stage][which] != all[stage + 1][which];
    assert_eq!([changed(0, 0), changed(0, 1)], [true, false]);
    assert_eq!([changed(1, 0), changed(1, 1)], [false, true]);
    // Its third stage is a fit of its own of what the second has left.
    let mut scene = learnt.swap_remove(1);
    scene.description.stages.drain(..2);
    let mut alone = SceneFit::new(scene).unwrap();
    while alone.step().unwrap().is_some() {}
    let [found, expected] = [value(&alone, "exposure")[0], all[3][0][0]];
    assert!((found - expected).abs() < 1e-5, "{found} and {expected}");
}

#[test]
fn the_views_of_steps_follow_from_the_seed() {
    let folder = tempfile::tempdir().unwrap();
    let losses = |seed: u64| {
        let rest = format!("seed = {seed}\n[learn.exposure]\nrate = 1e-6\n[stop]\nsteps = 8\n");
        let mut fit = SceneFit::new(three_views(folder.path(), &rest)).unwrap();
        let mut losses = Vec::new();
        while let Some(step) = fit.step().unwrap() {
            losses.push(step.loss);
        }
        losses
    };
    let all: Vec<_> = (1..4).map(losses).collect();
    assert_eq!(all[0], losses(1));
    assert!(all[0] != all[1] || all[0] != all[2], "{all:?}");
}
