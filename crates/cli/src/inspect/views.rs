//! Views of scenes: their images and masks, and whether objects lie in front of their cameras.

use std::collections::HashMap;
use std::path::Path;

use bokashi_scene::{Picture, Place, Scene, SceneError, SceneView, share_seen};
use rayon::prelude::*;
use serde_json::json;

use super::cameras::same_places;
use super::findings::{Findings, Section};
use crate::digits::percent;

/// What was found about a view.
#[derive(Debug, Default)]
struct Found {
    /// What is wrong with its files.
    problems: Vec<String>,
    /// Whether masks are asked for, and it has none.
    lacks_mask: bool,
    /// Of each object the share of vertices in the image.
    seen: Vec<f64>,
}

/// Adds what is said of the views of `scene`, and what is wrong with them.
pub(super) fn inspect_views(findings: &mut Findings, scene: &Scene) {
    let views = &scene.views;
    let found: Vec<_> = views.par_iter().map(|view| look(scene, view)).collect();
    let mut seen = Vec::new();
    for (view, found) in views.iter().zip(&found) {
        let mut section = Section::new("");
        // In JSON alone: there may be hundreds.
        section.silent("name", json!(view.name));
        section.silent("image", json!(view.image));
        section.silent("mask", json!(view.mask));
        section.silent("held out", json!(view.held_out));
        section.silent("seen", json!(found.seen));
        findings.part("views", section);
        let own = found.seen.iter().copied().fold(0.0, f64::max);
        seen.push((own, view.name.as_str()));
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
    findings.all_of_a_kind(found.iter().flat_map(|found| found.problems.iter().cloned()));
    let name = |k: usize| &views[k].name;
    let lacking = (0..views.len()).filter(|&k| found[k].lacks_mask);
    let rule = "masks count in the loss, and its image has no opacity and it has no mask";
    findings.all_of_a_kind(lacking.map(|k| format!("view {:?}: {rule}", name(k))));
    if !scene.objects.is_empty() {
        let is_blind = |k: &usize| found[*k].seen.iter().all(|&share| share == 0.0);
        let rule = "no object lies in front of its camera and inside its image";
        let blind = (0..views.len()).filter(is_blind);
        findings.all_of_a_kind(blind.map(|k| format!("view {:?}: {rule}", name(k))));
    }
    let unseen = scene.objects.iter().enumerate().filter(|(at, _)| {
        !views.is_empty() && found.iter().all(|found| found.seen.get(*at) == Some(&0.0))
    });
    let rule = "it lies in front of no camera and inside no image";
    findings.all_of_a_kind(unseen.map(|(_, own)| format!("object {:?}: {rule}", own.name)));
    findings.all_of_a_kind(repeated(views));
    let with_images: Vec<_> = views.iter().filter(|view| view.image.is_some()).collect();
    let names: Vec<_> = with_images.iter().map(|view| view.name.as_str()).collect();
    let cameras: Vec<_> = with_images.iter().map(|view| view.camera).collect();
    findings.all_of_a_kind(same_places(&names, &cameras));
}

/// Views that have the image of an earlier one.
fn repeated(views: &[SceneView]) -> Vec<String> {
    let mut first: HashMap<&Path, &str> = HashMap::new();
    let mut said = Vec::new();
    for view in views {
        let Some(image) = view.image.as_deref() else { continue };
        match first.get(image) {
            Some(other) => {
                let rule = format!("it has the image of {other:?}, {}", image.display());
                said.push(format!("view {:?}: {rule}", view.name));
            }
            None => drop(first.insert(image, &view.name)),
        }
    }
    said
}

fn look(scene: &Scene, view: &SceneView) -> Found {
    let mut found = Found {
        seen: scene.objects.iter().map(|object| share_seen(object, &view.camera)).collect(),
        ..Found::default()
    };
    let size = [view.camera.size.width, view.camera.size.height];
    let mut decoded = |file: &Path| match decode(scene, file, size) {
        Ok(picture) => Some(picture),
        Err(error) => {
            found.problems.push(error.to_string());
            None
        }
    };
    let image = view.image.as_deref().and_then(&mut decoded);
    let mask = view.mask.as_deref().and_then(&mut decoded);
    if let (Some(mask), Some(file)) = (&mask, &view.mask) {
        let shown = mask.channel(0).is_some_and(|mask| mask.data().iter().any(|&x| x > 0.0));
        if !shown {
            let place = scene.folder.join(file);
            found
                .problems
                .push(format!("{}: a mask shows an object, and this is black", place.display()));
        }
    }
    let counts = scene.description.loss.silhouette.is_some_and(|weight| weight.0 > 0.0);
    let has_opacity = image.as_ref().is_some_and(|image| image.channels % 2 == 0);
    found.lacks_mask = counts && image.is_some() && view.mask.is_none() && !has_opacity;
    found
}

/// The image of a file, which has this size.
fn decode(scene: &Scene, file: &Path, [width, height]: [usize; 2]) -> Result<Picture, SceneError> {
    let place = Place::of(scene.folder.join(file));
    let picture = Picture::decode(&scene.folder.read(file)?, &place)?;
    if [picture.width, picture.height] == [width, height] {
        return Ok(picture);
    }
    let rule = format!("an image has the size of its camera, {width} x {height}");
    let message = format!("{rule}, and this is {} x {}", picture.width, picture.height);
    Err(SceneError::Content { place, message })
}
