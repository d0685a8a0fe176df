//! Scenes of one's own as the users of `new`, `inspect`, `fit` and `render` meet them.

use std::fs;
use std::path::Path;

use bokashi_scene::{Folder, Location, Picture, Samples, Scene, SceneFit, read_model};
use glam::{DMat4, DVec3};
use serde_json::{Value, json};

mod fits;
mod inspect;
mod new;
mod photographs;

use crate::PROGRAM;
use crate::run::{run, text, write};

/// What it says; it succeeds without a word on standard error.
fn said(folder: &Path, words: &[&str]) -> String {
    let output = run(PROGRAM, folder, words);
    assert_eq!(text(&output.stderr), "", "{words:?}: {}", text(&output.stdout));
    assert_eq!(output.status.code(), Some(0), "{words:?}");
    text(&output.stdout)
}

/// What it says on standard output and error; it ends with `status`.
fn ended(folder: &Path, words: &[&str], status: i32) -> [String; 2] {
    let output = run(PROGRAM, folder, words);
    let all = [text(&output.stdout), text(&output.stderr)];
    assert_eq!(output.status.code(), Some(status), "{words:?}: {all:?}");
    assert!(!all[1].contains("panicked"), "{words:?}: {all:?}");
    all
}

/// A disk of radius 10 in the middle, as a PNG of these channels.
fn disk(width: usize, height: usize, channels: usize) -> Vec<u8> {
    let is_inside = |k: usize| {
        let [x, y] = [k % width, k / width].map(|at| at as f64 + 0.5);
        (x - 0.5 * width as f64).hypot(y - 0.5 * height as f64) < 10.0
    };
    let sample = |k: usize| if is_inside(k / channels) { 40 + (k % 5 * 50) as u8 } else { 0 };
    let samples = Samples::U8((0..width * height * channels).map(sample).collect());
    Picture { width, height, channels, samples }.encode_png(&Location::new("disk")).unwrap()
}

/// The poses of cameras around a place, as OpenGL has them.
fn around(target: DVec3, count: usize) -> impl Iterator<Item = [[f64; 4]; 4]> {
    let turns = (0..count).map(move |k| k as f64 / count as f64 * std::f64::consts::TAU);
    turns.map(move |angle| {
        let eye = target + 4.0 * DVec3::new(angle.sin(), 0.3, angle.cos());
        let back = (eye - target).normalize();
        let right = DVec3::Y.cross(back).normalize();
        let up = back.cross(right);
        let [right, up, back] = [right, up, back].map(|axis| axis.extend(0.0));
        DMat4::from_cols(right, up, back, eye.extend(1.0)).transpose().to_cols_array_2d()
    })
}

const TEXTURED: &str = "mtllib quad.mtl\nusemtl skin\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\n\
    vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n";

fn textured(folder: &Path) {
    write(folder, "model/quad.obj", TEXTURED);
    write(folder, "model/quad.mtl", "newmtl skin\nmap_Kd -s 1 1 1 maps/my skin.png\n");
    write(folder, "model/maps/my skin.png", disk(16, 8, 3));
}

/// Photographs with a `transforms.json`; each image has so many channels.
fn photographs(folder: &Path, count: usize, channels: usize) {
    let poses = around(DVec3::new(2.0, 1.0, 0.0), count).enumerate();
    let frames = poses.map(|(k, pose)| {
        let name = format!("images/{k:02}.png");
        write(folder, &format!("photos/{name}"), disk(32, 32, channels));
        json!({ "file_path": name, "transform_matrix": pose })
    });
    let frames: Vec<_> = frames.collect();
    let all = json!({ "w": 32, "h": 32, "fl_x": 48, "frames": frames });
    write(folder, "photos/transforms.json", all.to_string());
}

/// Does a step of the scene that was made.
fn step(folder: &Path, scene: &str) -> SceneFit {
    let scene = Scene::load(folder.join(scene)).unwrap();
    let mut fit = SceneFit::new(scene).unwrap();
    assert!(fit.step().unwrap().unwrap().loss.is_finite());
    fit
}

fn names(fit: &SceneFit) -> Vec<String> {
    fit.parameters().iter().map(|own| own.name().to_owned()).collect()
}
