//! Fits of scenes whose pictures are made by another route: rays against balls, 8 x 8 of them in each pixel.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use bokashi_core::Tensor;
use bokashi_scene::description::LightPlace;
use bokashi_scene::{Attribute, Camera, ColorSpace, Location, Picture, Scene, SceneFit, SceneView};
use glam::{DMat4, DQuat, DVec3};

use crate::rays::{Ball, Eye, blurred, blurred_by_disc, light, photograph, through_lens};

/// Degrees of view of all cameras.
pub(crate) const ANGLE: f64 = 38.0;

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
pub(crate) fn views(
    folder: &Path,
    balls: &[Ball],
    count: usize,
    every: usize,
    pixels: usize,
) -> String {
    views_from(folder, balls, all_over(count), every, pixels)
}

/// The same from these directions.
pub(crate) fn views_from(
    folder: &Path,
    balls: &[Ball],
    towards: impl Iterator<Item = DVec3>,
    every: usize,
    pixels: usize,
) -> String {
    let mut text = String::new();
    fs::create_dir_all(folder.join("images")).unwrap();
    for (k, towards) in towards.enumerate() {
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

pub(crate) fn fitted(scene: Scene) -> SceneFit {
    let mut fit = SceneFit::new(scene).unwrap();
    while let Some(step) = fit.step().unwrap() {
        if step.step % 50 == 0 {
            println!("{} {:.3e} {:.1} ms", step.step, step.loss, step.ms);
        }
    }
    fit
}

/// The means of PSNR and of silhouettes' IoU of held-out views.
pub(crate) fn held_out(fit: &SceneFit) -> [f64; 2] {
    let views = fit.scene().views.iter().enumerate().filter(|(_, view)| view.held_out);
    let scores: Vec<_> = views.map(|(number, _)| fit.score(number).unwrap()).collect();
    let count = scores.len() as f64;
    let psnr = scores.iter().map(|score| score.psnr.unwrap()).sum::<f64>() / count;
    let iou = scores.iter().map(|score| score.silhouette_iou.unwrap_or(0.0)).sum::<f64>() / count;
    println!("held out: {psnr:.2} dB, IoU {iou:.4}");
    [psnr, iou]
}

/// Colours of each object's ball at its vertices.
pub(crate) fn paint(scene: &mut Scene, balls: &[Ball]) {
    for (object, ball) in scene.objects.iter_mut().zip(balls) {
        let places = object.positions.data().chunks(3);
        let places = places.map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()));
        let colors = places.flat_map(|p| ball.color(object.places[0].transform_point3(p)));
        let colors: Vec<_> = colors.map(|x| x as f32).collect();
        let rows = Tensor::from_flat_fn([colors.len() / 3, 3], |k| colors[k]);
        object.colors = Some(Attribute { rows, indices: object.mesh.clone() });
        object.materials[0].base_color = [1.0; 3];
    }
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
steps = 80
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
steps = 250
views_per_step = 4
"#;
    let mut scene = load(folder.path(), &text);
    let vertices = scene.objects[0].positions.shape()[0];
    let rows = Tensor::full([vertices, 3], 0.5);
    scene.objects[0].colors = Some(Attribute { rows, indices: scene.objects[0].mesh.clone() });
    scene.objects[0].materials[0].base_color = [1.0; 3];
    let [psnr, iou] = held_out(&fitted(scene));
    assert!(iou > 0.97, "{iou}");
    assert!(psnr > 25.0, "{psnr} dB");
}

#[test]
fn a_cameras_pose_is_learnt_from_one_image() {
    let folder = tempfile::tempdir().unwrap();
    let ball = Ball::motley(DVec3::ZERO, 1.0);
    let text = views(folder.path(), std::slice::from_ref(&ball), 1, 2, 128)
        + "[[meshes]]\nshape = \"sphere\"\nfaces = 5000\n[learn.cameras]\n[stop]\nsteps = 200\n";
    let mut scene = load(folder.path(), &text);
    paint(&mut scene, &[ball]);
    let truth = scene.views[0].camera.view;
    nudged(&mut scene.views[0], DVec3::new(1.0, -2.0, 0.5), 3.0, DVec3::new(0.1, 0.05, -0.15));
    println!("start: {:?}", off(&scene.views[0].camera.view, &truth));
    let found = fitted(scene).learnt().unwrap();
    let [degrees, share] = off(&found.views[0].camera.view, &truth);
    println!("{degrees} degrees, {share} of the distance");
    assert!(degrees < 0.2, "{degrees}");
    assert!(share < 0.005, "{share}");
}

/// A reconstruction as COLMAP writes it: each camera's pose turned and moved at random.
fn colmap(folder: &Path, cameras: &[(String, Camera)]) {
    let model = folder.join("sparse/0");
    fs::create_dir_all(&model).unwrap();
    let (mut lenses, mut images) = (String::new(), String::new());
    for (k, (name, camera)) in cameras.iter().enumerate() {
        let [width, height] = [camera.size.width, camera.size.height];
        let [fx, fy, cx, cy] = camera.intrinsics;
        // COLMAP has the corner of the image at (0, 0).
        let [cx, cy] = [cx + 0.5, cy + 0.5];
        writeln!(lenses, "{} PINHOLE {width} {height} {fx} {fy} {cx} {cy}", k + 1).unwrap();
        let q = DQuat::from_mat4(&camera.view);
        let [x, y, z] = camera.view.w_axis.truncate().to_array();
        let [a, b, c, d] = [q.w, q.x, q.y, q.z];
        writeln!(images, "{0} {a} {b} {c} {d} {x} {y} {z} {0} {name}\n", k + 1).unwrap();
    }
    fs::write(model.join("cameras.txt"), lenses).unwrap();
    fs::write(model.join("images.txt"), images).unwrap();
    fs::write(model.join("points3D.txt"), "").unwrap();
}

#[test]
fn cameras_of_a_colmap_model_are_learnt_from_a_degree_off() {
    let folder = tempfile::tempdir().unwrap();
    // A ball alone can turn behind its texture; three of them can't.
    let balls = [
        Ball::motley(DVec3::new(-0.5, 0.1, 0.0), 0.5),
        Ball::motley(DVec3::new(0.55, -0.15, 0.1), 0.45),
        Ball::motley(DVec3::new(0.1, 0.5, 0.6), 0.3),
    ];
    let text = views(folder.path(), &balls, 8, 100, 128);
    let truth = load(folder.path(), &text).views;
    let mut noisy = truth.clone();
    for (k, view) in noisy.iter_mut().enumerate() {
        let number = k as f64;
        let axis =
            DVec3::new((2.0 * number).sin(), (3.0 * number + 1.0).cos(), (5.0 * number).cos());
        // A degree about the eye moves the picture by five pixels; the shift moves it again.
        nudged(
            view,
            axis,
            1.0,
            0.02 * DVec3::new(number.cos(), number.sin(), (4.0 * number).sin()),
        );
    }
    let named = noisy.iter().map(|view| (format!("{}.png", view.name), view.camera));
    colmap(folder.path(), &named.collect::<Vec<_>>());
    let mut scene = load(
        folder.path(),
        r#"
[cameras]
colmap = "sparse/0"
[[meshes]]
shape = "sphere"
faces = 6000
place = { translation = [-0.5, 0.1, 0], scale = 0.5 }
name = "large"
[[meshes]]
shape = "sphere"
faces = 6000
place = { translation = [0.55, -0.15, 0.1], scale = 0.45 }
name = "middle"
[[meshes]]
shape = "sphere"
faces = 3000
place = { translation = [0.1, 0.5, 0.6], scale = 0.3 }
name = "small"
[pipeline]
cull = "back"
[learn.cameras]
[[stages]]
steps = 120
reduce = 2
views_per_step = 8
[[stages]]
steps = 60
views_per_step = 8
rates = 0.3
"#,
    );
    paint(&mut scene, &balls);
    let found = fitted(scene).learnt().unwrap();
    for (view, truth) in found.views.iter().zip(&truth) {
        assert_eq!(view.name, truth.name);
        let [degrees, share] = off(&view.camera.view, &truth.camera.view);
        println!("{}: {degrees:.4} degrees, {share:.5} of the distance", view.name);
        assert!(degrees < 0.05, "{}: {degrees}", view.name);
    }
}

/// Two balls, one behind the other, known but for what `learn` names, and one photograph of them.
pub(crate) fn two_balls(folder: &Path, photo: &Tensor<f32>, pipeline: &str) -> Scene {
    // Light before black.
    let seen = Tensor::from_flat_fn([photo.shape()[0], photo.shape()[1], 3], |k| photo.data()[k]);
    let picture = Picture::from_color(&seen, ColorSpace::Srgb).unwrap();
    fs::write(folder.join("photo.png"), picture.encode_png(&Location::new("photo.png")).unwrap())
        .unwrap();
    let text = format!(
        r#"
[[views]]
image = "photo.png"
camera = {{ position = [0, 0.3, 4], angle = {ANGLE:?} }}
[[meshes]]
shape = "sphere"
faces = 8000
place = {{ translation = [-0.4, 0, 1.2], scale = 0.45 }}
name = "near"
[[meshes]]
shape = "sphere"
faces = 8000
place = {{ translation = [0.6, 0.1, -1.5], scale = 0.9 }}
name = "far"
{pipeline}
"#
    );
    load(folder, &text)
}

/// The balls of `two_balls`, and its camera.
pub(crate) fn balls_and_eye() -> ([Ball; 2], Eye) {
    let balls = [
        Ball::motley(DVec3::new(-0.4, 0.0, 1.2), 0.45),
        Ball::motley(DVec3::new(0.6, 0.1, -1.5), 0.9),
    ];
    (balls, Eye { position: DVec3::new(0.0, 0.3, 4.0), angle: ANGLE, pixels: 96 })
}

/// Light before black, `[pixels, pixels, 3]`.
fn before_black(balls: &[Ball], eye: &Eye) -> Tensor<f32> {
    let light = light(balls, eye);
    let color = |k: usize| light.data()[k / 3 * 4 + k % 3] * light.data()[k / 3 * 4 + 3];
    Tensor::from_flat_fn([eye.pixels, eye.pixels, 3], color)
}

#[test]
fn the_sigma_of_a_blurred_photograph_is_learnt() {
    let folder = tempfile::tempdir().unwrap();
    let (balls, eye) = balls_and_eye();
    let light = before_black(&balls, &eye);
    let of_gaussian = (blurred(&light, &vec![2.5; eye.pixels * eye.pixels]), 2.5);
    for (kernel, (photo, expected)) in
        [("sampled", of_gaussian), ("disc", blurred_by_disc(&light, 5.0))]
    {
        let pipeline = format!(
            "[pipeline]\nblur = 1.0\nblur_kernel = \"{kernel}\"\n[learn.blur]\n[stop]\nsteps = 300\n"
        );
        let mut scene = two_balls(folder.path(), &photo, &pipeline);
        paint(&mut scene, &balls);
        let found = fitted(scene).learnt().unwrap();
        let sigma = found.description.pipeline.blur.unwrap().0;
        println!("{kernel}: sigma {sigma}");
        assert!((sigma - expected).abs() < 0.02, "{kernel}: {sigma}, not {expected}");
    }
}

#[test]
fn focus_and_opening_of_a_photograph_are_learnt() {
    let folder = tempfile::tempdir().unwrap();
    let (balls, eye) = balls_and_eye();
    let (radius, focus) = (0.14, 3.4);
    let aperture = eye.focal_length() * radius / focus;
    let photo = through_lens(&balls, &eye, radius, focus);
    for (key, truth) in [("aperture", aperture), ("radius", radius)] {
        let pipeline = format!(
            "[pipeline]\ncull = \"back\"\nlens = {{ {key} = {:?}, focus = {:?} }}\n[learn.lens]\n\
             [stop]\nsteps = 120\n",
            0.75 * truth,
            1.25 * focus
        );
        let mut scene = two_balls(folder.path(), &photo, &pipeline);
        paint(&mut scene, &balls);
        let found = fitted(scene).learnt().unwrap().description.pipeline.lens.unwrap();
        let off = [found.opening.number() / truth, found.focus.0 / focus].map(|share| share - 1.0);
        println!("{key}, focus off by {off:?}");
        assert_eq!(found.opening.key(), key);
        assert!(off[0].abs() < 0.02 && off[1].abs() < 0.02, "{key}: {off:?}");
    }
}

#[test]
fn the_direction_of_light_is_learnt_from_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let direction = DVec3::new(0.5, 0.7, 0.3).normalize();
    let photos = views(folder.path(), &[Ball::motley(DVec3::ZERO, 1.0).lit(direction)], 8, 9, 64);
    let rest = r#"
[[meshes]]
shape = "sphere"
faces = 5000
[[lights]]
kind = "directional"
direction = [-0.1, 0.3, 0.8]
color = [3.141593, 3.141593, 3.141593]
[pipeline]
surface = "lambert"
[learn.light_places]
[stop]
steps = 200
views_per_step = 2
"#;
    let mut scene = load(folder.path(), &(photos + rest));
    paint(&mut scene, &[Ball::motley(DVec3::ZERO, 1.0)]);
    let fit = fitted(scene);
    let learnt = fit.learnt().unwrap();
    let Some(LightPlace::Direction(found)) = learnt.description.lights[0].place() else { panic!() };
    let off = found.angle_between(direction).to_degrees();
    println!("{off:.4} degrees");
    assert!(off < 0.2, "{off} degrees from the truth");
}

/// Three photographs of a hand, with a mesh of another one. The fitter of DEODR 0.2.3 ends at 23.0, 23.1 and
/// 22.5 dB in the same time, once a slip is mended: it compares a row of its picture with all of a photograph.
#[test]
fn a_hand_is_learnt_from_three_photographs() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/scenes/hand/scene.toml");
    let fit = fitted(Scene::load(file).unwrap());
    let found = [0, 1, 2].map(|view| fit.score(view).unwrap().psnr.unwrap());
    println!("{found:.2?} dB");
    for (found, least) in found.into_iter().zip([27.0, 27.0, 26.0]) {
        assert!(found > least, "{found} dB");
    }
}
