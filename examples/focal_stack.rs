//! What does a lens photograph? The pictures of `scenes/stack`, a focal stack: each is the mean of what many points of
//! the lens see, and each point is a camera a little aside.
//!
//! Arguments: a seed, which turns the points, how many there are, and the folder to draw to: by default one beside other
//! temporary files. The stack's own pictures are drawn by `0 400 examples/scenes/stack/images`.

use std::error::Error;
use std::f64::consts::PI;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use bokashi::prelude::{Tape, Tensor};
use bokashi_scene::glam::{DMat4, DVec3};
use bokashi_scene::{Camera, Renderer, Scene, Values};

/// A camera at the point `[p_x, p_y]` of the unit disc, on a lens whose circle of confusion at infinity has a radius of
/// `aperture` pixels. What is as far away as the focus stays where it is in the image.
fn at_point(camera: Camera, [x, y]: [f64; 2], [aperture, focus]: [f64; 2]) -> Camera {
    let [fx, fy, cx, cy] = camera.intrinsics;
    let aside = DVec3::new(x * aperture * focus / fx, y * aperture * focus / fy, 0.0);
    let view = DMat4::from_translation(-aside) * camera.view;
    Camera { view, intrinsics: [fx, fy, cx + x * aperture, cy + y * aperture], ..camera }
}

/// The light that a view's lens sees: the mean over `count` points.
fn photograph(
    scene: &Scene,
    view: usize,
    [seed, count]: [usize; 2],
) -> Result<Tensor<f32>, Box<dyn Error>> {
    let mut scene = scene.clone();
    let (camera, lens) = (scene.views[view].camera, scene.views[view].lens);
    let lens = [lens.opening.ok_or("an aperture")?.number(), lens.focus.ok_or("a focus")?.0];
    // A point sees as a pinhole does.
    scene.description.pipeline.lens = None;
    let mut sum: Option<Tensor<f32>> = None;
    for k in 0..count {
        // Points on a spiral share the disc evenly.
        let radius = ((k as f64 + 0.5) / count as f64).sqrt();
        let (sin, cos) = (seed as f64 + k as f64 * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
        scene.views[view].camera = at_point(camera, [radius * cos, radius * sin], lens);
        let renderer = Renderer::new(Arc::new(scene.clone()))?;
        let tape = Tape::new();
        let values = Values { tape: &tape, learnt: None };
        let light = renderer.draw(&values, view, 1, false)?.light()?.image()?.value();
        sum = Some(match sum {
            None => light,
            Some(sum) => Tensor::from_flat_fn(sum.shape(), |k| sum.data()[k] + light.data()[k]),
        });
    }
    Ok(sum.ok_or("a point")?.map(|x| x / count as f32))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let mut number = |usual| arguments.next().map_or(Ok(usual), |word| word.parse());
    let numbers = [number(0)?, number(400)?];
    let usual = std::env::temp_dir().join("focal-stack");
    let folder = arguments.next().map_or(usual, PathBuf::from);
    let mut scene = Scene::load("examples/scenes/stack/truth.toml")?;
    fs::create_dir_all(&folder)?;
    // `png_of` encodes light.
    scene.description.pipeline.tone = bokashi_scene::description::Tone::Linear;
    for view in 0..scene.views.len() {
        let light = photograph(&scene, view, numbers)?;
        let file = folder.join(format!("{}.png", scene.views[view].name));
        fs::write(&file, scene.png_of(&light)?)?;
        println!("{}", file.display());
    }
    Ok(())
}
