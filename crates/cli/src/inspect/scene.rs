//! Scenes.

use std::fmt::Display;
use std::path::Path;

use bokashi_scene::description::{Description, Stage, StopEntry, ViewLens};
use bokashi_scene::{
    LearntKey, Object, Picture, Scene, SceneError, SceneFit, SurfaceMaterial, capped_note,
    learnt_keys, lens_note,
};
use glam::DVec3;
use serde_json::json;

use super::cameras::add_cameras;
use super::findings::{Findings, Section};
use super::views::inspect_views;
use crate::digits::{count, number, numbers};
use crate::scene::HELD_OUT;

/// Steps of a fit that does not say.
const STEPS: usize = 1000;

/// What is in the scene `file`.
pub(super) fn inspect(file: &Path) -> Result<Findings, SceneError> {
    let scene = Scene::load(file)?;
    let mut findings = Findings::new("a scene");
    let mut whole = Section::default();
    // JSON has them all under these names.
    whole.fact("objects", scene.objects.len(), json!([]));
    whole.fact("views", views_in_words(&scene), json!([]));
    let description = &scene.description;
    whole.plain("lights", description.lights.len());
    if let Some(texels) = &scene.environment {
        let side = texels.shape()[1];
        whole.fact("environment", format!("6 x {side} x {side} texels"), side);
    }
    add_lens_and_exposures(&mut whole, &scene);
    whole.plain("seed", description.seed);
    let (center, radius) = scene.ball();
    let text = format!("around {}, radius {}", numbers(center.to_array()), number(radius));
    let value = json!({ "center": center.to_array(), "radius": radius });
    whole.fact("extent", text, value);
    findings.whole(whole);
    for object in &scene.objects {
        findings.part("objects", inspect_object(object));
    }
    let cameras: Vec<_> = scene.views.iter().map(|view| view.camera).collect();
    add_cameras(&mut findings, &cameras);
    for note in &scene.notes {
        match super::mesh::is_problem(note) {
            true => findings.problem(note),
            false => findings.note(note),
        }
    }
    lens_note(&scene)?.into_iter().for_each(|note| findings.note(note));
    match capped_note(&scene) {
        Ok(note) => note.into_iter().for_each(|note| findings.note(note)),
        Err(error) => findings.problem(error),
    }
    for file in named_images(description) {
        // It was read when the scene was loaded.
        for remark in Picture::remarks_in(&scene.folder, file).unwrap_or_default() {
            findings.note(format!("{}: {remark}", scene.folder.join(file).display()));
        }
    }
    if scene.objects.is_empty() {
        findings.problem("a scene has a mesh, and this has none");
    }
    if scene.views.is_empty() {
        findings.problem("a scene has a view, and this has none");
    }
    inspect_views(&mut findings, &scene);
    inspect_fit(&mut findings, scene);
    Ok(findings)
}

/// How many views there are, and of which kinds.
fn views_in_words(scene: &Scene) -> String {
    let held_out = scene.views.iter().filter(|view| view.held_out).count();
    let without = scene.views.iter().filter(|view| view.image.is_none()).count();
    let mut text = scene.views.len().to_string();
    for (number, what) in [(held_out, "held out"), (without, "without an image")] {
        if number > 0 {
            text += &format!(", of these {number} {what}");
        }
    }
    text
}

/// Adds the numbers of the lens that views share, and how many views have an exposure of their own.
fn add_lens_and_exposures(section: &mut Section, scene: &Scene) {
    let exposed = scene.views.iter().filter(|view| view.exposure != 0.0).count();
    if exposed > 0 {
        let text = format!("{} with exposures of their own", count(exposed, "view"));
        section.fact("exposures", text, exposed);
    }
    if let Some(lens) = scene.description.pipeline.lens {
        let (key, opening, focus) = (lens.opening.key(), lens.opening.number(), lens.focus.0);
        let own = scene.views.iter().filter(|view| view.lens != ViewLens::default()).count();
        let mut text = format!("{key} {}, focus {}", number(opening), number(focus));
        if own > 0 {
            text += &format!("; {} with numbers of their own", count(own, "view"));
        }
        section.fact("lens", text, json!({ key: opening, "focus": focus, "views": own }));
    }
}

/// The images that a scene's file names beside its views: textures, normal maps, the environment.
fn named_images(description: &Description) -> impl Iterator<Item = &Path> {
    let materials = description.meshes.iter().map(|entry| &entry.get_ref().material);
    let maps = materials.flat_map(|material| [&material.texture, &material.normals]);
    let sky = description.environment.as_ref().map(|entry| &entry.get_ref().image);
    maps.chain(sky).filter_map(|file| file.as_deref())
}

fn inspect_object(object: &Object) -> Section {
    let mut section = Section::new(format!("object {:?}", object.name));
    section.silent("name", object.name.as_str());
    section.plain("vertices", object.mesh.vertex_count());
    section.plain("faces", object.mesh.faces().len());
    section.fact("stands", count(object.places.len(), "time"), object.places.len());
    let points = object.positions.data().chunks_exact(3);
    let points = points.map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()));
    let places = object.places.iter();
    let all = places.flat_map(|transform| points.clone().map(|p| transform.transform_point3(p)));
    let extent = all.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]);
    for (label, corner) in ["least", "largest"].into_iter().zip(extent.into_iter().flatten()) {
        section.fact(label, numbers(corner.to_array()), json!(corner.to_array()));
    }
    let materials =
        object.materials.iter().map(|material| inspect_material(&mut section, object, material));
    let materials: Vec<serde_json::Value> = materials.collect();
    section.silent("materials", json!(materials));
    if let Some(colors) = &object.colors {
        section.fact("colours", "at vertices", colors.rows.shape()[0]);
    }
    section
}

/// Adds what an object, or one of its materials, is made of.
fn inspect_material(
    section: &mut Section,
    object: &Object,
    material: &SurfaceMaterial,
) -> serde_json::Value {
    let labelled = |label: &str| match object.materials.len() {
        1 => label.to_owned(),
        _ => format!("{label} of {:?}", material.name),
    };
    let mut value = json!({ "name": material.name, "faces": material.faces.len() });
    if material.texture.texels.is_none() {
        let color = material.base_color;
        section.fact(labelled("base colour"), numbers(color.map(f64::from)), json!(color));
        value["base_color"] = json!(color);
    }
    let maps = [
        ("texture", &material.texture),
        ("rough map", &material.roughness_metallic),
        ("normal map", &material.normal_map),
    ];
    for (label, map) in maps {
        if let Some(texels) = &map.texels {
            let [height, width] = [texels.shape()[0], texels.shape()[1]];
            section.fact(
                labelled(label),
                format!("{width} x {height} texels"),
                json!([width, height]),
            );
            value[label] = json!([width, height]);
        } else if map.is_missing {
            section.fact(labelled(label), "its image was left out", json!(null));
            value[label] = json!(null);
        }
    }
    value
}

/// Adds what a fit would learn, and its stages.
fn inspect_fit(findings: &mut Findings, scene: Scene) {
    let description = &scene.description;
    let keys = learnt_keys(&description.learn);
    if keys.is_empty() {
        findings.note("`learn` names nothing: the scene can be rendered, and not fitted");
        return;
    }
    let mut section = Section::new("what is learnt");
    for LearntKey { key, rate, usual_rate, unit } in keys {
        let text = match rate {
            Some(rate) => format!("rate {}", number(rate)),
            None => format!("at the usual rate, {}", number(usual_rate)),
        };
        section.fact(key, format!("{text} (unit: {unit})"), json!(rate));
    }
    findings.named("learnt", section);
    let lens = description.learn.lens.as_ref();
    let exposure = description.learn.exposure.as_ref();
    let is_of_views = description.learn.cameras.is_some()
        || exposure.is_some_and(|exposure| exposure.per_view)
        || lens.is_some_and(|lens| !lens.per_view.is_empty());
    if is_of_views && scene.views_with_image(true).next().is_some() {
        findings.note(HELD_OUT);
    }
    let stages = description.stages.as_slice();
    if stages.is_empty() {
        let steps = description.stop.steps.map_or(STEPS, |steps| steps.0);
        let mut section = Section::new("the only stage");
        section.fact("steps", steps_of_stage(steps, &description.stop), steps);
        let views = description.stop.views_per_step.map_or(1, |views| views.0);
        section.plain("views a step", views);
        findings.part("stages", section);
    }
    let stop = &description.stop;
    for (key, is_there) in
        [("steps", stop.steps.is_some()), ("views_per_step", stop.views_per_step.is_some())]
    {
        if is_there && !stages.is_empty() {
            findings.note(format!("`stop.{key}` is left out: each of the stages says its own"));
        }
    }
    for (k, stage) in stages.iter().enumerate() {
        findings.part("stages", inspect_stage(k, stage, stop));
    }
    match SceneFit::new(scene) {
        Ok(fit) => {
            let mut section = Section::new("parameters of a fit");
            for parameter in fit.parameters().iter() {
                let shape = parameter.raw().shape();
                section.fact(parameter.name(), shape, json!(shape.to_vec()));
            }
            findings.named("parameters", section);
        }
        Err(error) => findings.problem(error),
    }
}

/// How many steps a stage has, in words: rules may end it early, or the fit.
fn steps_of_stage(steps: impl Display, stop: &StopEntry) -> String {
    let of_stage = stop.patience.is_some() || stop.held_out.is_some();
    let of_fit = stop.seconds.is_some() || stop.loss_below.is_some();
    if of_stage || of_fit { format!("at most {steps}") } else { steps.to_string() }
}

fn inspect_stage(k: usize, stage: &Stage, stop: &StopEntry) -> Section {
    let mut section = Section::new(format!("stage {}", k + 1));
    section.fact("steps", steps_of_stage(stage.steps.0, stop), stage.steps.0);
    if let Some(learn) = &stage.learn {
        section.fact("learns", learn.join(", "), json!(learn));
    }
    if let Some(reduce) = stage.reduce {
        section.fact("images", format!("{} times smaller", reduce.0), reduce.0);
    }
    section.plain("views a step", stage.views_per_step.map_or(1, |views| views.0));
    if let Some(rates) = stage.rates {
        section.fact("rates", format!("times {}", number(rates.0)), rates.0);
    }
    if let Some(texture) = stage.texture {
        let size = texture.size.0;
        section.fact("new texture", format!("{size} x {size} texels"), size);
    }
    if let Some(remesh) = &stage.remesh {
        let length = remesh.length.0;
        let every =
            remesh.every.map_or(String::new(), |every| format!(", every {} steps", every.0));
        section.fact("new faces", format!("edges of {}{every}", number(length)), length);
    }
    section
}
