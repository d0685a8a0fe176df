//! The focal stack of `examples/scenes/stack`, whose pictures are means over points of a lens.

use std::path::Path;

use bokashi_scene::Scene;

use crate::fits::fitted;

#[test]
fn lenses_and_a_shape_are_learnt_from_a_focal_stack() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/stack");
    let load = |file: &str| Scene::load(folder.join(file)).unwrap();
    let (start, truth) = (load("scene.toml"), load("truth.toml"));
    // How far apertures, focuses and depths are off at most, and depths in the mean.
    let off = |scene: &Scene| {
        let mut off = [0.0_f64; 4];
        for (found, truth) in scene.views.iter().zip(&truth.views) {
            let numbers = |lens: bokashi_scene::description::ViewLens| {
                [lens.opening.unwrap().number(), lens.focus.unwrap().0]
            };
            let [found, truth] = [found.lens, truth.lens].map(numbers);
            for k in 0..2 {
                off[k] = off[k].max((found[k] / truth[k] - 1.0).abs());
            }
        }
        let heights = |scene: &Scene| {
            let (place, positions) = (scene.objects[1].places[0], &scene.objects[1].positions);
            let heights = positions.data().chunks(3).map(|p| f64::from(p[2]) * place.z_axis.z);
            heights.collect::<Vec<_>>()
        };
        let (found, truth) = (heights(scene), heights(&truth));
        let apart = found.iter().zip(&truth).map(|(a, b)| (a - b).abs());
        off[2] = apart.clone().fold(0.0, f64::max);
        off[3] = (apart.map(|x| x * x).sum::<f64>() / truth.len() as f64).sqrt();
        off
    };
    let (before, after) = (off(&start), off(&fitted(start).learnt().unwrap()));
    println!("apertures, focuses, depths off by {before:.4?} and then {after:.4?}");
    assert!(before[0] > 0.24 && before[1] > 0.24, "{before:?}");
    assert!(after[0] < 0.06 && after[1] < 0.02, "{after:?}");
    assert!(after[3] < 0.4 * before[3], "{after:?}");
}
