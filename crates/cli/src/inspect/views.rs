//! Views of scenes: their images and masks, and whether objects lie in front of their cameras.

use std::collections::HashMap;
use std::path::Path;

use bokashi_scene::{Location, Mask, MaskKind, Picture, Scene, SceneView, share_seen};
use rayon::prelude::*;
use serde_json::json;

use super::cameras::same_places;
use super::findings::{Findings, Section};
use crate::digits::{count, percent};

/// What was found about a view.
#[derive(Debug, Default)]
struct Inspected {
    /// What is wrong with its files.
    problems: Vec<String>,
    /// What its files say that is not done, with the file.
    remarks: Vec<(String, String)>,
    /// Whether masks are asked for, and it has none.
    lacks_mask: bool,
    /// The share of pixels that are the object, and how that is said.
    mask: Option<(f64, MaskKind)>,
    /// Of each object the share of vertices in the image.
    seen: Vec<f64>,
}

/// Adds what is said of the views of `scene`, and what is wrong with them.
pub(super) fn inspect_views(findings: &mut Findings, scene: &Scene) {
    let views = &scene.views;
    let inspected: Vec<_> = views.par_iter().map(|view| look(scene, view)).collect();
    let mut seen = Vec::new();
    for (view, inspected) in views.iter().zip(&inspected) {
        let mut section = Section::new("");
        // In JSON alone: there may be hundreds.
        section.silent("name", json!(view.name));
        section.silent("image", json!(view.image));
        section.silent("mask", json!(view.mask));
        section.silent("mask share", json!(inspected.mask.map(|(share, _)| share)));
        section.silent("mask says it by", json!(inspected.mask.map(|(_, kind)| kind.to_string())));
        section.silent("held out", json!(view.held_out));
        section.silent("seen", json!(inspected.seen));
        findings.part("views", section);
        let largest = inspected.seen.iter().copied().fold(0.0, f64::max);
        seen.push((largest, view.name.as_str()));
    }
    if let (Some((least, name)), false) =
        (seen.iter().min_by(|a, b| a.0.total_cmp(&b.0)), scene.objects.is_empty())
    {
        let mut section = Section::new("what cameras see");
        section.fact(
            "at least",
            format!("{} of an object's vertices, in {name:?}", percent(*least)),
            *least,
        );
        findings.named("seen", section);
    }
    let masks = views.iter().zip(&inspected).filter_map(|(view, inspected)| {
        inspected.mask.map(|(share, kind)| (view.name.as_str(), share, kind))
    });
    add_masks(findings, masks.collect());
    findings
        .all_of_a_kind(inspected.iter().flat_map(|inspected| inspected.problems.iter().cloned()));
    add_remarks(findings, inspected.iter().flat_map(|inspected| &inspected.remarks));
    let name = |k: usize| &views[k].name;
    let lacking = (0..views.len()).filter(|&k| inspected[k].lacks_mask);
    let rule = "masks count in the loss, and its image has no opacity and it has no mask";
    findings.all_of_a_kind(lacking.map(|k| format!("view {:?}: {rule}", name(k))));
    if !scene.objects.is_empty() {
        let is_blind = |k: &usize| inspected[*k].seen.iter().all(|&share| share == 0.0);
        let rule = "no object lies in front of its camera and inside its image";
        let blind = (0..views.len()).filter(is_blind);
        findings.all_of_a_kind(blind.map(|k| format!("view {:?}: {rule}", name(k))));
    }
    let unseen = scene.objects.iter().enumerate().filter(|(index, _)| {
        !views.is_empty()
            && inspected.iter().all(|inspected| inspected.seen.get(*index) == Some(&0.0))
    });
    let rule = "it lies in front of no camera and inside no image";
    findings.all_of_a_kind(unseen.map(|(_, entry)| format!("object {:?}: {rule}", entry.name)));
    findings.all_of_a_kind(repeated(views, "image", |view| view.image.as_deref()));
    findings.all_of_a_kind(repeated(views, "mask", |view| view.mask.as_deref()));
    let with_images: Vec<_> = views.iter().filter(|view| view.image.is_some()).collect();
    let names: Vec<_> = with_images.iter().map(|view| view.name.as_str()).collect();
    let cameras: Vec<_> = with_images.iter().map(|view| view.camera).collect();
    findings.all_of_a_kind(same_places(&names, &cameras));
}

/// Adds which share of pixels masks say are the object, and how they say it.
fn add_masks(findings: &mut Findings, masks: Vec<(&str, f64, MaskKind)>) {
    let by_share = |a: &&(&str, f64, MaskKind), b: &&(&str, f64, MaskKind)| a.1.total_cmp(&b.1);
    let (Some(least), Some(most)) = (masks.iter().min_by(by_share), masks.iter().max_by(by_share))
    else {
        return;
    };
    let mut section = Section::new("what masks show");
    for (label, (name, share, _)) in [("at least", least), ("at most", most)] {
        let text = format!("{} of pixels are the object, in {name:?}", percent(*share));
        section.fact(label, text, *share);
    }
    let mut ways: Vec<(String, usize)> = Vec::new();
    for (_, _, kind) in &masks {
        let kind = kind.to_string();
        match ways.iter_mut().find(|(other, _)| *other == kind) {
            Some((_, count)) => *count += 1,
            None => ways.push((kind, 1)),
        }
    }
    let text = ways.iter().map(|(kind, count)| format!("{kind} ({count})"));
    let value: serde_json::Map<_, _> =
        ways.iter().map(|(kind, count)| (kind.clone(), json!(count))).collect();
    section.fact("they say by", text.collect::<Vec<_>>().join(", "), value);
    findings.named("masks", section);
}

/// Adds what files say that is not done: each remark once, with the first file and how many others.
fn add_remarks<'f>(findings: &mut Findings, remarks: impl Iterator<Item = &'f (String, String)>) {
    let mut all: Vec<(&str, &str, usize)> = Vec::new();
    for (file, remark) in remarks {
        match all.iter_mut().find(|(_, other, _)| other == remark) {
            Some((_, _, others)) => *others += 1,
            None => all.push((file, remark, 0)),
        }
    }
    for (file, remark, others) in all {
        findings.note(match others {
            0 => format!("{file}: {remark}"),
            _ => format!("{file} and {} more: {remark}", count(others, "file")),
        });
    }
}

/// Views that have the image or the mask of an earlier one.
fn repeated<'v>(
    views: &'v [SceneView],
    what: &str,
    file: impl Fn(&'v SceneView) -> Option<&'v Path>,
) -> Vec<String> {
    let mut first: HashMap<&Path, &str> = HashMap::new();
    let mut messages = Vec::new();
    for view in views {
        let Some(file) = file(view) else { continue };
        match first.get(file) {
            Some(other) => {
                let rule = format!("it has the {what} of {other:?}, {}", file.display());
                messages.push(format!("view {:?}: {rule}", view.name));
            }
            None => drop(first.insert(file, &view.name)),
        }
    }
    messages
}

fn look(scene: &Scene, view: &SceneView) -> Inspected {
    let mut inspected = Inspected {
        seen: scene.objects.iter().map(|object| share_seen(object, &view.camera)).collect(),
        ..Inspected::default()
    };
    let size = [view.camera.size.width, view.camera.size.height];
    let mut read = |file: &Path| match Picture::read_sized(&scene.folder, file, size) {
        Ok(picture) => Some(picture),
        Err(error) => {
            inspected.problems.push(error.to_string());
            None
        }
    };
    let image = view.image.as_deref().and_then(&mut read);
    let picture = view.mask.as_deref().and_then(&mut read);
    for file in [&view.image, &view.mask].into_iter().flatten() {
        // What can't be read was said.
        let remarks = Picture::remarks_in(&scene.folder, file).unwrap_or_default();
        let file = scene.folder.join(file).display().to_string();
        inspected.remarks.extend(remarks.into_iter().map(|remark| (file.clone(), remark)));
    }
    let mask = match (&image, &picture, &view.mask) {
        (_, Some(picture), Some(file)) => {
            let location = Location::new(scene.folder.join(file));
            Some((Mask::from_picture(picture, &location), location))
        }
        (Some(image), None, None) => Mask::from_opacity(image).map(|mask| {
            (
                Ok(mask),
                Location::new(scene.folder.join(view.image.as_deref().unwrap_or(Path::new("")))),
            )
        }),
        _ => None,
    };
    let counts = scene.description.loss.silhouette.is_some_and(|weight| weight.0 > 0.0);
    match mask {
        Some((Ok(mask), location)) => {
            inspected.mask = Some((mask.mean(), mask.kind));
            // Opacity may say nothing where nobody asks it.
            if let Some(fault) = mask.fault().filter(|_| counts || view.mask.is_some()) {
                inspected.problems.push(format!("{location}: {fault}"));
            }
        }
        Some((Err(error), _)) => inspected.problems.push(error.to_string()),
        None => {}
    }
    let has_opacity = image.as_ref().is_some_and(|image| image.channels % 2 == 0);
    inspected.lacks_mask = counts && image.is_some() && view.mask.is_none() && !has_opacity;
    inspected
}
