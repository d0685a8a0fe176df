//! Exposures of views: balls in photographs by rays, some of which are brighter than others.

use std::fs;
use std::path::Path;

use bokashi_core::Tensor;
use bokashi_scene::{ColorSpace, Location, Picture, Scene, SceneFit};
use glam::DVec3;

use crate::fixtures::{drawn, load};
use crate::poses::{balls, object};
use crate::rays::{Eye, light};

/// Degrees of view.
const ANGLE: f64 = 38.0;
/// By how many stops each photograph is brighter; the last one is held out.
const STOPS: [f64; 6] = [-0.5, 0.0, 0.25, -0.25, 0.0, 0.4];
/// Of these, those that are learnt from.
const LEARNT: usize = 5;

fn mean(stops: impl IntoIterator<Item = f64>) -> f64 {
    stops.into_iter().take(LEARNT).sum::<f64>() / LEARNT as f64
}

/// Writes the photographs and the object, whose colours are dull; returns the scene.
fn scene(folder: &Path, tone: &str, rest: &str) -> Scene {
    let mut text = format!(
        "[[meshes]]\nfile = \"object.obj\"\nvertex_color_space = \"linear\"\n\
         [pipeline]\ntone = \"{tone}\"\nbackground = [0.1, 0.2, 0.1]\ncull = \"back\"\n{rest}"
    );
    fs::write(folder.join("object.obj"), object(&balls(), [10, 16])).unwrap();
    for (k, stops) in STOPS.iter().enumerate() {
        let angle = 1.2 * k as f64;
        let position = 4.0 * DVec3::new(angle.sin(), 0.3 * (2.0 * angle).cos(), angle.cos());
        let light = light(&balls(), &Eye { position, angle: ANGLE, pixels: 32 });
        let lit = Tensor::from_flat_fn(light.shape(), |k| match k % 4 {
            3 => light.data()[k],
            _ => light.data()[k] * stops.exp2() as f32,
        });
        let location = Location::new("photograph.png");
        let picture = Picture::from_color(&lit, ColorSpace::Srgb).unwrap();
        fs::write(folder.join(format!("{k}.png")), picture.encode_png(&location).unwrap()).unwrap();
        let position = position.to_array();
        text += &format!(
            "[[views]]\nimage = \"{k}.png\"\nheld_out = {}\n\
             camera = {{ position = {position:?}, angle = {ANGLE:?} }}\n",
            k >= LEARNT
        );
    }
    load(folder, &text)
}

#[test]
fn exposures_of_views_are_found_about_a_mean_that_stays() {
    for (tone, start) in [("srgb", 0.3), ("linear", 0.0)] {
        let folder = tempfile::tempdir().unwrap();
        let rest = "[learn.exposure]\nper_view = true\n[learn.colors]\n\
                    [stop]\nsteps = 150\nviews_per_step = 5\n";
        let mut scene = scene(folder.path(), tone, rest);
        scene.views[1].exposure = start;
        let mut fit = SceneFit::new(scene).unwrap();
        assert!(fit.parameters().get("exposure").is_err());
        fit.run(|_| ()).unwrap();
        let learnt = fit.learnt().unwrap();
        let found: Vec<_> = learnt.views.iter().map(|view| view.exposure).collect();
        println!("{tone}: {found:.3?}");
        assert!((mean(found.clone()) - start / LEARNT as f64).abs() < 1e-6, "{found:?}");
        for (view, (found, expected)) in found.iter().zip(STOPS).enumerate() {
            let expected = expected - mean(STOPS) + start / LEARNT as f64;
            // Colours take the rest: the one that is held out is found by what these have become.
            assert!((found - expected).abs() < 0.03, "{tone} {view}: {found} for {expected}");
        }
        let score = fit.score(LEARNT).unwrap();
        assert!(score.psnr > score.psnr_before.map(|psnr| psnr + 3.0), "{score:?}");
        learnt.save_results(folder.path().join("out")).unwrap();
        let numbers = fs::read_to_string(folder.path().join("out/numbers.json")).unwrap();
        let numbers: serde_json::Value = serde_json::from_str(&numbers).unwrap();
        assert_eq!(numbers["exposures"]["0"].as_f64(), Some(found[0]));
        // Who goes on starts there, and sees the same.
        let again = SceneFit::new(learnt).unwrap();
        for view in 0..STOPS.len() {
            let [first, second] = [&fit, &again].map(|fit| fit.score(view).unwrap().psnr.unwrap());
            assert!((first - second).abs() < 1e-2, "{view}: {first} {second}");
        }
    }
}

#[test]
fn an_exposure_of_a_view_is_added_to_that_of_all() {
    let folder = tempfile::tempdir().unwrap();
    for tone in ["srgb", "linear"] {
        let image = |all: &str, own: &str| {
            let text = format!(
                "[[meshes]]\nshape = \"cube\"\nmaterial = {{ base_color = [0.2, 0.5, 0.1] }}\n\
                 [pipeline]\ntone = \"{tone}\"\nbackground = [0.1, 0.2, 0.1]\n{all}\n\
                 [[views]]\nname = \"a\"\n{own}\n\
                 camera = {{ size = [24, 16], position = [2, 3, 4], angle = 40 }}\n"
            );
            drawn(load(folder.path(), &text))
        };
        let expected = image("exposure = 0.75", "");
        assert_eq!(image("exposure = 0.25", "exposure = 0.5"), expected);
        assert_eq!(image("", "exposure = 0.75"), expected);
        assert_eq!(image("exposure = -0.25", "exposure = 1"), expected);
        assert_ne!(image("", "exposure = 0"), expected);
        assert_eq!(image("", "exposure = 0"), image("", ""));
    }
}

#[test]
fn one_view_alone_has_no_exposure_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let mut one = scene(folder.path(), "srgb", "[learn.exposure]\nper_view = true\n");
    one.views.iter_mut().skip(1).for_each(|view| view.held_out = true);
    let message = SceneFit::new(one).err().unwrap().to_string();
    assert!(message.contains("two views that are learnt from, and there is 1"), "{message}");
}
