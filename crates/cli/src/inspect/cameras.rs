//! Files of cameras, and cameras of scenes.

use std::collections::HashMap;
use std::path::Path;

use bokashi_scene::{Camera, CameraFile, Distortion, Picture, SceneError, gaze, read_transforms};
use glam::{DMat3, DVec3};
use serde_json::json;

use super::findings::{Findings, Section};
use super::folder::scene_folder_of;
use crate::digits::{count, number, numbers};

/// Distances that differ by less are one place, as a share of the cameras' distances from the origin.
const SAME_PLACE: f64 = 1e-9;
/// What is less is rounding, as a share of what cameras see.
const ROUNDING: f64 = 1e-9;

/// What is in the `transforms.json` called `file`.
pub(super) fn inspect(file: &Path) -> Result<Findings, SceneError> {
    let (folder, name) = scene_folder_of(file)?;
    let CameraFile { views, notes } = read_transforms(&folder, name)?;
    let mut findings = Findings::new("a file of cameras");
    let mut whole = Section::default();
    whole.plain("views", views.len());
    let masks = views.iter().filter_map(|view| view.mask.as_deref()).collect::<Vec<_>>();
    if !masks.is_empty() {
        whole.plain("masks", masks.len());
    }
    findings.whole(whole);
    notes.iter().for_each(|note| findings.note(note));
    if views.is_empty() {
        findings.problem("a file of cameras has frames, and this has none");
    }
    let cameras: Vec<_> = views.iter().map(|view| view.camera).collect();
    add_cameras(&mut findings, &cameras);
    let mut wrong = Vec::new();
    for view in &views {
        match Picture::read_size(&folder, &view.image) {
            Ok([width, height]) => {
                let size = view.camera.size;
                if [width, height] != [size.width, size.height] {
                    let rule = format!("w and h are {} x {}", size.width, size.height);
                    wrong.push(format!(
                        "{:?}: {rule}, and its image is {width} x {height}",
                        view.name
                    ));
                }
            }
            Err(error) => wrong.push(error.to_string()),
        }
    }
    for mask in masks {
        if let Err(error) = folder.find(mask) {
            wrong.push(error.to_string());
        }
    }
    findings.all_of_a_kind(wrong);
    let names: Vec<_> = views.iter().map(|view| view.name.as_str()).collect();
    findings.all_of_a_kind(same_places(&names, &cameras));
    Ok(findings)
}

/// Adds what is said of cameras: their sizes and focal lengths, where they stand, and what they look at.
pub(super) fn add_cameras(findings: &mut Findings, cameras: &[Camera]) {
    let mut lenses: Vec<(Camera, usize)> = Vec::new();
    let mut seen = HashMap::new();
    for camera in cameras {
        // Kinds of lenses have different numbers of coefficients.
        let numbers = camera.intrinsics.iter().chain(camera.distortion.coefficients());
        let bits: Vec<u64> = numbers.map(|number| (number + 0.0).to_bits()).collect();
        let next = lenses.len();
        let index = *seen.entry((camera.size.width, camera.size.height, bits)).or_insert(next);
        if index == next {
            lenses.push((*camera, 0));
        }
        lenses[index].1 += 1;
    }
    for (camera, total) in lenses {
        let mut section = Section::new(count(total, "camera"));
        let (size, [fx, fy, cx, cy]) = (camera.size, camera.intrinsics);
        section.silent("count", total);
        let sides = [size.width, size.height];
        section.fact("size", format!("{} x {} pixels", size.width, size.height), json!(sides));
        let text = match fx == fy {
            true => number(fx),
            false => format!("{} across, {} down", number(fx), number(fy)),
        };
        section.fact("focal", text, json!([fx, fy]));
        if let Some(half) = camera.angle_at(0, 0.5 * size.width as f64) {
            let angle = 2.0 * half.to_degrees();
            section.fact("angle", format!("{} degrees across", number(angle)), angle);
        }
        section.fact("center", numbers([cx, cy]), json!([cx, cy]));
        if !camera.distortion.is_none() {
            let coefficients = camera.distortion.coefficients();
            let label = match camera.distortion {
                Distortion::Fisheye(_) => "fisheye",
                _ => "distortion",
            };
            section.fact(label, numbers(coefficients.iter().copied()), json!(coefficients));
        }
        findings.part("cameras", section);
    }
    // A single one looks along a line.
    if cameras.len() > 1 {
        findings.whole(standpoints(cameras));
    }
}

/// Where several cameras stand, and what all of them see.
fn standpoints(cameras: &[Camera]) -> Section {
    let mut section = Section::new("where cameras stand");
    let eyes: Vec<DVec3> = cameras.iter().map(eye).collect();
    let least = eyes.iter().copied().fold(DVec3::INFINITY, DVec3::min);
    let most = eyes.iter().copied().fold(DVec3::NEG_INFINITY, DVec3::max);
    section.fact("least eye", numbers(least.to_array()), json!(least.to_array()));
    section.fact("largest eye", numbers(most.to_array()), json!(most.to_array()));
    match gaze(cameras) {
        Some((center, radius)) => {
            // What is 0 but for rounding is 0.
            let rounded =
                center.to_array().map(|x| if x.abs() < ROUNDING * radius { 0.0 } else { x });
            section.fact("look at", numbers(rounded), json!(rounded));
            let text = format!("a ball of radius {} there", number(radius));
            section.fact("all see", text, radius);
        }
        None => {
            section.fact("look at", "no place in common", json!(null));
        }
    }
    section
}

fn eye(camera: &Camera) -> DVec3 {
    camera.opencv_pose().w_axis.truncate()
}

/// Views whose cameras stand in one place and look in one direction: as a rule nobody filled them in.
pub(super) fn same_places(names: &[&str], cameras: &[Camera]) -> Option<String> {
    let scale = cameras.iter().map(|camera| eye(camera).length()).fold(0.0, f64::max);
    let unit = if scale > 0.0 { SAME_PLACE * scale } else { 1.0 };
    // Where a camera stands and how it is turned, in whole units of what counts as one place.
    let key = |camera: &Camera| {
        let position = eye(camera).to_array().map(|x| x / unit);
        let turn = DMat3::from_mat4(camera.view).to_cols_array().map(|x| x / SAME_PLACE);
        (position.map(|x| x.round() as i64), turn.map(|x| x.round() as i64))
    };
    let keys: Vec<_> = cameras.iter().map(key).collect();
    let mut counts = HashMap::new();
    keys.iter().for_each(|key| *counts.entry(key).or_insert(0_usize) += 1);
    let twins: Vec<_> = (0..keys.len()).filter(|&index| counts[&keys[index]] > 1).collect();
    let (first, second) = (twins.first()?, twins.get(1)?);
    let rule = "cameras of different images stand in different places";
    let (first, second) = (names[*first], names[*second]);
    let twins_in_words = match twins.len() {
        2 => format!("{first:?} and {second:?} stand in one"),
        all => format!("{first:?}, {second:?} and {} more stand in one", all - 2),
    };
    Some(format!("{rule}, and {twins_in_words}"))
}
