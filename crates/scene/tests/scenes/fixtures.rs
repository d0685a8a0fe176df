//! What the tests of scenes share: files of a folder, and pictures of scenes.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use bokashi_core::{Tape, Tensor, parallel};
use bokashi_fit::on_ranks;
use bokashi_scene::{Location, Picture, Renderer, Samples, Scene, SceneFit, Values};

/// Columns and rows of all images here.
pub(crate) const SIZE: [usize; 2] = [24, 16];

pub(crate) fn load(folder: &Path, text: &str) -> Scene {
    let file = folder.join("scene.toml");
    fs::write(&file, text).unwrap();
    Scene::load(&file).unwrap()
}

/// An image of light and opacity that differ from pixel to pixel; as a file of floats the light is multiplied by
/// the opacity.
pub(crate) fn picture(is_float: bool) -> Picture {
    let [width, height] = SIZE;
    let sample = |k: usize| (7 * k + k / 96 * 5) % 256;
    let count = 4 * width * height;
    let opacity = |k: usize| sample(k / 4 * 4 + 3) as f32 / 255.0;
    let samples = match is_float {
        false => Samples::U8((0..count).map(|k| sample(k) as u8).collect()),
        true => Samples::F32(
            (0..count)
                .map(|k| match k % 4 {
                    3 => opacity(k),
                    _ => sample(k) as f32 / 255.0 * opacity(k),
                })
                .collect(),
        ),
    };
    Picture { width, height, channels: 4, samples }
}

pub(crate) fn png(folder: &Path) {
    let location = Location::new("a.png");
    fs::write(folder.join("a.png"), picture(false).encode_png(&location).unwrap()).unwrap();
}

pub(crate) fn furthest(a: &Tensor<f32>, b: &Tensor<f32>) -> f32 {
    assert_eq!(a.shape(), b.shape());
    a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

pub(crate) fn value(fit: &SceneFit, name: &str) -> Vec<f32> {
    fit.parameters().value(name).unwrap().data().to_vec()
}

/// The light of a scene's first view.
pub(crate) fn drawn(scene: Scene) -> Tensor<f32> {
    let renderer = Renderer::new(Arc::new(scene)).unwrap();
    let tape = Tape::new();
    let values = Values { tape: &tape, learnt: None };
    let view = renderer.draw(&values, 0, 1, false).unwrap();
    renderer.image(&values, &view, 1).unwrap().value()
}

/// The bits of all that is learnt.
pub(crate) fn bits(fit: &SceneFit) -> Vec<u32> {
    let raw = fit.parameters().iter().flat_map(|parameter| parameter.raw().data().to_vec());
    raw.map(f32::to_bits).collect()
}

/// The bits of a fit at its end.
pub(crate) fn end(mut fit: SceneFit) -> Vec<u32> {
    fit.run(|_| ()).unwrap();
    bits(&fit)
}

/// Checks that a fit of a scene has the same bits whenever it is saved and resumed, and shared by however many ranks
/// and threads. `before_each` sees it before each step and at its end; the file "saved" then has it.
pub(crate) fn check_interruptions(
    folder: &Path,
    text: &str,
    mut before_each: impl FnMut(&SceneFit),
) -> SceneFit {
    let scene = load(folder, text);
    let mut fit = SceneFit::new(scene.clone()).unwrap();
    let saved = folder.join("saved");
    let read = || Scene::load(folder.join("scene.toml")).unwrap();
    let anew = || end(SceneFit::new(read()).unwrap());
    let whole = parallel::alone(anew);
    loop {
        before_each(&fit);
        fit.save(&saved).unwrap();
        // Once from the files again, as another process does; to read them takes longer than a step.
        let scene = if fit.steps_done() == 1 { read() } else { scene.clone() };
        let again = SceneFit::resume(scene, &saved).unwrap();
        assert_eq!(again.changed(), [""; 0]);
        assert!(bits(&again) == bits(&fit));
        let [seen, expected] = [&again, &fit].map(|fit| fit.compare(0).unwrap().image);
        assert!(seen.data() == expected.data());
        assert!(end(again) == whole, "interrupted after {} steps", fit.steps_done());
        if fit.step().unwrap().is_none() {
            break;
        }
    }
    assert!(bits(&fit) == whole);
    for size in [2, 3] {
        let all = on_ranks(size, |ranks| end(SceneFit::among(scene.clone(), ranks).unwrap()));
        assert!(all.iter().all(|found| *found == whole), "{size} ranks");
    }
    for threads in [2, 3] {
        assert!(parallel::with_threads(threads, anew) == whole, "{threads} threads");
    }
    fit
}
