//! Fits of scenes whose pictures are made by another route: rays against balls, 8 x 8 of them in each pixel.

mod rays;

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use bokashi_core::Tensor;
use bokashi_scene::{Attribute, Scene, SceneFit, SceneView};
use glam::{DMat4, DQuat, DVec3};

use crate::rays::{Ball, Eye, photograph};

/// Degrees of view of all cameras.
const ANGLE: f64 = 38.0;

/// Directions all over the sphere, Fibonacci's.
fn all_over(count: usize) -> impl Iterator<Item = DVec3> {
    (0..count).map(move |k| {
        let z = 1.0 - (2 * k + 1) as f64 / count as f64;
        let angle = k as f64 * std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * angle.cos(), z, radius * angle.sin())
    })
}

/// Photographs of `balls` from all around in `folder`, and their entries in a scene's file. One of `every` is
/// held out.
fn views(folder: &Path, balls: &[Ball], count: usize, every: usize, pixels: usize) -> String {
    let mut text = String::new();
    fs::create_dir_all(folder.join("images")).unwrap();
    for (k, towards) in all_over(count).enumerate() {
        let eye = Eye { position: 4.0 * towards, angle: ANGLE, pixels };
        let file = format!("images/{k}.png");
        fs::write(folder.join(&file), photograph(balls, &eye)).unwrap();
        let [x, y, z] = eye.position.to_array();
        writeln!(text, "[[views]]\nimage = {file:?}").unwrap();
        writeln!(text, "camera = {{ position = [{x}, {y}, {z}], angle = {ANGLE:?} }}").unwrap();
        writeln!(text, "held_out = {}\n", k % every == every - 1).unwrap();
    }
    text
}

fn load(folder: &Path, text: &str) -> Scene {
    let file = folder.join("scene.toml");
    fs::write(&file, text).unwrap();
    Scene::load(&file).unwrap()
}

fn fitted(scene: Scene) -> SceneFit {
    let mut fit = SceneFit::new(scene).unwrap();
    while let Some(step) = fit.step().unwrap() {
        if step.step % 50 == 0 {
            println!("{} {:.3e} {:.1} ms", step.step, step.loss, step.ms);
        }
    }
    fit
}

/// The means of PSNR and of silhouettes' IoU of held-out views.
fn held_out(fit: &SceneFit) -> [f64; 2] {
    let views = fit.scene().views.iter().enumerate().filter(|(_, view)| view.held_out);
    let scores: Vec<_> = views.map(|(at, _)| fit.score(at).unwrap()).collect();
    let count = scores.len() as f64;
    let psnr = scores.iter().map(|score| score.psnr.unwrap()).sum::<f64>() / count;
    let iou = scores.iter().map(|score| score.silhouette_iou.unwrap_or(0.0)).sum::<f64>() / count;
    println!("held out: {psnr:.2} dB, IoU {iou:.4}");
    [psnr, iou]
}

/// Colours of `ball` at the vertices of the scene's only object.
fn paint(scene: &mut Scene, ball: &Ball) {
    let object = &mut scene.objects[0];
    let places = object.positions.data().chunks(3);
    let colors = places.flat_map(|p| ball.color(DVec3::new(p[0].into(), p[1].into(), p[2].into())));
    let colors: Vec<_> = colors.map(|x| x as f32).collect();
    let rows = Tensor::from_flat_fn([colors.len() / 3, 3], |k| colors[k]);
    object.colors = Some(Attribute { rows, indices: object.mesh.clone() });
    object.look.base_color = [1.0; 3];
}

/// A turn of so many degrees about an axis, and a move, of a camera that stands before the origin.
fn nudged(view: &mut SceneView, axis: DVec3, degrees: f64, shift: DVec3) {
    let turn = DQuat::from_axis_angle(axis.normalize(), degrees.to_radians());
    view.camera.view = DMat4::from_rotation_translation(turn, shift) * view.camera.view;
}

/// How far a camera is from the truth: degrees, and the share of its distance from the origin.
fn off(found: &DMat4, truth: &DMat4) -> [f64; 2] {
    let turns = [found, truth].map(|view| DQuat::from_mat4(view).normalize());
    let places = [found, truth].map(|view| view.inverse().transform_point3(DVec3::ZERO));
    // The angle between quaternions loses half of the digits near 0.
    let between = turns[0] * turns[1].inverse();
    let degrees = (2.0 * between.xyz().length().min(1.0).asin()).to_degrees();
    [degrees, places[0].distance(places[1]) / places[1].length()]
}

#[test]
fn the_texture_of_a_ball_is_learnt_from_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let text = views(folder.path(), &[Ball::motley(DVec3::ZERO, 1.0)], 16, 4, 128)
        + r#"
[[meshes]]
shape = "sphere"
faces = 5000
material = { texture_size = 256 }
[learn.texture]
total_variation = 1e-3
[stop]
steps = 200
views_per_step = 4
"#;
    let [psnr, iou] = held_out(&fitted(load(folder.path(), &text)));
    assert!(psnr > 30.0, "{psnr} dB");
    assert!(iou > 0.97, "{iou}");
}

#[test]
fn vertices_are_learnt_from_silhouettes_and_colors() {
    let folder = tempfile::tempdir().unwrap();
    let balls = [
        Ball::motley(DVec3::new(-0.35, 0.1, 0.0), 0.75),
        Ball::motley(DVec3::new(0.55, -0.15, 0.1), 0.5),
    ];
    let text = views(folder.path(), &balls, 25, 5, 96)
        + r#"
[[meshes]]
shape = "sphere"
faces = 2000
[loss]
silhouette = 1.0
[learn.vertices]
smoothing = 10.0
normals = 1e-3
[learn.colors]
[stop]
steps = 400
views_per_step = 4
"#;
    let mut scene = load(folder.path(), &text);
    let vertices = scene.objects[0].positions.shape()[0];
    let rows = Tensor::full([vertices, 3], 0.5);
    scene.objects[0].colors = Some(Attribute { rows, indices: scene.objects[0].mesh.clone() });
    scene.objects[0].look.base_color = [1.0; 3];
    let [psnr, iou] = held_out(&fitted(scene));
    assert!(iou > 0.97, "{iou}");
    assert!(psnr > 25.0, "{psnr} dB");
}

#[test]
fn a_cameras_pose_is_learnt_from_one_image() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball::motley(DVec3::ZERO, 1.0);
    let text = views(folder.path(), std::slice::from_ref(&ball), 1, 2, 128)
        + "[[meshes]]\nshape = \"sphere\"\nfaces = 20000\n[learn.cameras]\n[stop]\nsteps = 300\n";
    let mut scene = load(folder.path(), &text);
    paint(&mut scene, &ball);
    let truth = scene.views[0].camera.view;
    nudged(&mut scene.views[0], DVec3::new(1.0, -2.0, 0.5), 3.0, DVec3::new(0.1, 0.05, -0.15));
    println!("start: {:?}", off(&scene.views[0].camera.view, &truth));
    let found = fitted(scene).learnt().unwrap();
    let [degrees, share] = off(&found.views[0].camera.view, &truth);
    println!("{degrees} degrees, {share} of the distance");
    assert!(degrees < 0.2, "{degrees}");
    assert!(share < 0.005, "{share}");
}
