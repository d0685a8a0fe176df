//! Views that are held out are aligned before they are scored: balls in photographs by rays, from cameras that stand
//! elsewhere.

use std::fs;
use std::path::Path;

use bokashi_core::parallel::with_threads;
use bokashi_fit::on_ranks;
use bokashi_scene::{Scene, SceneFit, ViewScore};
use glam::{DQuat, DVec3};

use crate::poses::{balls, object};
use crate::rays::{Eye, photograph};

/// Degrees of view.
const ANGLE: f64 = 38.0;
/// The views that are held out.
const HELD_OUT: [usize; 2] = [1, 4];

/// Where the cameras stand.
fn eyes(pixels: usize) -> Vec<Eye> {
    let eye = |k: usize| {
        let angle = 1.1 * k as f64;
        let position = 4.0 * DVec3::new(angle.sin(), 0.3 * (2.0 * angle).cos(), angle.cos());
        Eye { position, angle: ANGLE, pixels }
    };
    (0..6).map(eye).collect()
}

/// A folder with the photographs, the object, and a scene whose cameras are off by two degrees and in what they look at.
pub(crate) fn scene(folder: &Path, pixels: usize, rest: &str) -> Scene {
    let mut text = "[[meshes]]\nfile = \"object.obj\"\nvertex_color_space = \"linear\"\n\
                    [loss]\nsilhouette = 1.0\n"
        .to_owned();
    // Small images need few faces.
    let rows = pixels / 4;
    fs::write(folder.join("object.obj"), object(&balls(), [rows, rows * 5 / 3])).unwrap();
    for (k, eye) in eyes(pixels).iter().enumerate() {
        fs::write(folder.join(format!("{k}.png")), photograph(&balls(), eye)).unwrap();
        let axis = DVec3::new((3.0 * k as f64).sin(), 1.0, 0.5).normalize();
        let turned = DQuat::from_axis_angle(axis, 2_f64.to_radians()) * eye.position;
        let [position, target] = [1.01 * turned, 0.04 * axis].map(|place| place.to_array());
        let held_out = HELD_OUT.contains(&k);
        text += &format!(
            "[[views]]\nimage = \"{k}.png\"\nheld_out = {held_out}\n\
             camera = {{ position = {position:?}, target = {target:?}, angle = {ANGLE:?} }}\n"
        );
    }
    fs::write(folder.join("scene.toml"), text + rest).unwrap();
    Scene::load(folder.join("scene.toml")).unwrap()
}

/// How far the eye and the gaze of a view are off, in degrees.
fn off(scene: &Scene, view: usize) -> [f64; 2] {
    let pose = scene.views[view].camera.view.inverse();
    let [eye, gaze] = [pose.transform_point3(DVec3::ZERO), pose.transform_vector3(DVec3::Z)];
    let expected = eyes(1)[view].position;
    [eye.angle_between(expected), gaze.angle_between(-expected)].map(f64::to_degrees)
}

pub(crate) fn bits(fit: &SceneFit) -> Vec<u32> {
    let raw = fit.parameters().iter().flat_map(|parameter| parameter.raw().data().to_vec());
    raw.map(f32::to_bits).collect()
}

/// The cameras that were aligned, to the bit, and how well views are matched.
fn aligned(fit: &SceneFit) -> (Vec<u64>, Vec<Option<u64>>) {
    let learnt = fit.learnt().unwrap();
    let cameras = HELD_OUT.iter().flat_map(|&view| learnt.views[view].camera.view.to_cols_array());
    let scores = HELD_OUT.iter().map(|&view| fit.score(view).unwrap());
    let numbers = |score: ViewScore| [score.psnr, score.silhouette_iou, score.psnr_before];
    let numbers = scores.flat_map(numbers).map(|number| number.map(f64::to_bits));
    (cameras.map(f64::to_bits).collect(), numbers.collect())
}

#[test]
fn cameras_of_held_out_views_are_found_and_nothing_else_moves() {
    let folder = tempfile::tempdir().unwrap();
    let rest = "[learn.cameras]\n[stop]\nsteps = 20\nviews_per_step = 4\n";
    let mut fit = SceneFit::new(scene(folder.path(), 72, rest)).unwrap();
    while fit.step().unwrap().is_some() {}
    let (before, learnt) = (bits(&fit), fit.learnt().unwrap());
    let scores: Vec<_> = HELD_OUT.iter().map(|&view| fit.score(view).unwrap()).collect();
    assert!(scores.iter().all(|score| score.psnr_before.is_none()));
    fit.align().unwrap();
    assert_eq!(fit.aligned_views().collect::<Vec<_>>(), HELD_OUT);
    assert_eq!(bits(&fit), before);
    let found = fit.learnt().unwrap();
    for view in 0..6 {
        if !HELD_OUT.contains(&view) {
            assert_eq!(found.views[view].camera.view, learnt.views[view].camera.view);
            assert_eq!(fit.score(view).unwrap().psnr_before, None);
        }
    }
    for (&view, was) in HELD_OUT.iter().zip(scores) {
        let (before, after, score) =
            (off(&learnt, view), off(&found, view), fit.score(view).unwrap());
        println!("view {view}: {before:.3?} degrees off, then {after:.3?}; {score:?}");
        assert!(before.iter().any(|&degrees| degrees > 1.0), "{before:?}");
        // A turn about the object hardly shows where a ball hides the others.
        let is_nearer = |(after, before): (&f64, &f64)| after < &(0.5 * before);
        assert!(after.iter().zip(&before).all(is_nearer), "{after:?}");
        assert_eq!(score.psnr_before, was.psnr);
        assert!(score.psnr > was.psnr.map(|psnr| psnr + 5.0), "{was:?} {score:?}");
        assert!(score.silhouette_iou > was.silhouette_iou, "{was:?} {score:?}");
    }
    // Again it begins where the scene has them.
    let once = aligned(&fit);
    fit.align().unwrap();
    assert_eq!(aligned(&fit), once);
    // Files have them: paths of images there start at another folder.
    found.save_results(folder.path().join("out")).unwrap();
    let cameras = fs::read_to_string(folder.path().join("out/transforms.json")).unwrap();
    fs::write(folder.path().join("transforms.json"), cameras.replace("../", "")).unwrap();
    let text = "[cameras]\ntransforms = \"transforms.json\"\n";
    fs::write(folder.path().join("again.toml"), text).unwrap();
    let again = Scene::load(folder.path().join("again.toml")).unwrap();
    for view in HELD_OUT {
        let pairs = off(&again, view).into_iter().zip(off(&found, view));
        assert!(pairs.map(|(written, own)| (written - own).abs()).all(|error| error < 1e-3));
    }
}

#[test]
fn alignment_has_the_same_bits_on_all_threads_and_ranks_and_after_an_interruption() {
    let folder = tempfile::tempdir().unwrap();
    let rest = "[learn.cameras]\n[learn.pose]\n[learn.exposure]\nper_view = true\n\
                [stop]\nsteps = 6\nviews_per_step = 2\n";
    let load = || scene(folder.path(), 24, rest);
    let run = |mut fit: SceneFit| {
        fit.run(|_| ()).unwrap();
        (bits(&fit), aligned(&fit))
    };
    let whole = with_threads(1, || run(SceneFit::new(load()).unwrap()));
    assert!(whole.1.1.iter().all(Option::is_some), "{whole:?}");
    for threads in [2, 3] {
        assert!(with_threads(threads, || run(SceneFit::new(load()).unwrap())) == whole);
    }
    let loaded = load();
    for size in [2, 3] {
        for found in on_ranks(size, |ranks| run(SceneFit::among(loaded.clone(), ranks).unwrap())) {
            assert!(found == whole, "{size} ranks");
        }
    }
    let saved = folder.path().join("saved");
    let mut fit = SceneFit::new(load()).unwrap();
    for step in [0, 3] {
        // Aligned, saved, and gone on: steps know nothing of it.
        fit.align().unwrap();
        assert_eq!(fit.aligned_views().count(), if step == 0 { 0 } else { 2 });
        fit.save(&saved).unwrap();
        assert!(run(SceneFit::resume(load(), &saved).unwrap()) == whole, "after {step} steps");
        for _ in 0..3 {
            fit.step().unwrap();
        }
        assert_eq!(fit.aligned_views().count(), 0);
    }
    assert!(run(fit) == whole);
}

#[test]
fn only_what_was_learnt_of_other_views_is_aligned() {
    let folder = tempfile::tempdir().unwrap();
    let aligned = |rest: &str| {
        let mut fit = SceneFit::new(scene(folder.path(), 24, rest)).unwrap();
        let cameras = |scene: &Scene| HELD_OUT.map(|view| scene.views[view].camera.view);
        let before = cameras(fit.scene());
        fit.run(|_| ()).unwrap();
        let views: Vec<_> = fit.aligned_views().collect();
        let moved = cameras(&fit.learnt().unwrap()) != before;
        assert!(fit.score(HELD_OUT[0]).unwrap().psnr_before.is_none() == views.is_empty());
        (views.len(), moved)
    };
    assert_eq!(aligned("[learn.pose]\n[stop]\nsteps = 2\n"), (0, false));
    let stages = "[learn.pose]\n[learn.cameras]\n[[stages]]\nsteps = 1\nlearn = [\"pose\"]\n";
    // A motion by nothing moves a camera by a rounding error.
    assert_eq!(aligned(stages).0, 0);
    let more = format!("{stages}[[stages]]\nsteps = 1\nlearn = [\"cameras\"]\n");
    assert_eq!(aligned(&more), (2, true));
    // What a lens of a view has of its own.
    let lens = "[learn.lens]\nper_view = [\"focus\"]\n[stop]\nsteps = 2\n\
                [pipeline.lens]\naperture = 1.0\nfocus = 4.0\n";
    assert_eq!(aligned(lens), (2, false));
}
