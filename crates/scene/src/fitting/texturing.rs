//! Meshes that get a texture in the middle of a fit.
//!
//! The colours at their vertices become texels, which are learnt from then on. Vertices and faces stay.

use bokashi_core::Tensor;
use bokashi_mesh::{AtlasOptions, TexelMap, atlas};

use crate::description::{Remesh, Stage, StageTexture};
use crate::error::{Location, SceneError};
use crate::learnables::{COLORS, TEXTURE, VERTICES};
use crate::learning::LearntRate;
use crate::memory::OF_LEARNT_NUMBER;
use crate::object::{Attribute, Gutters, Object};
use crate::scene::Scene;

/// The index of the stage at whose start meshes get a texture, and that texture.
fn stage_of_texture(stages: &[Stage]) -> Option<(usize, StageTexture)> {
    stages.iter().enumerate().find_map(|(number, stage)| Some((number, stage.texture?)))
}

/// Checks that meshes can get a texture, if one of `stages` asks for it. `rates` are those at the start of the fit.
///
/// # Errors
/// [`SceneError::Content`] otherwise; [`SceneError::Memory`] for a texture that there is no room for.
pub(super) fn check_texturing(
    scene: &Scene,
    stages: &[Stage],
    rates: &[LearntRate],
) -> Result<(), SceneError> {
    let Some((number, StageTexture { size })) = stage_of_texture(stages) else { return Ok(()) };
    let wrong = |message: String| Err(SceneError::content(Location::new(&scene.path), message));
    let learn = &scene.description.learn;
    let (key, is_there) = match &learn.colors {
        None => ("colors", false),
        Some(_) => ("texture", learn.texture.is_some()),
    };
    if !is_there {
        let rule = "`texture` of a stage needs `learn.colors` and `learn.texture`";
        return wrong(format!("{rule}, and there is no `learn.{key}`"));
    }
    check_order(scene, stages, number)?;
    let all: Vec<_> = scene.objects.iter().filter(|object| scene.gives_texture(object)).collect();
    if all.is_empty() {
        let rule = "`texture` of a stage is of meshes of both `learn.colors` and `learn.texture`";
        return wrong(format!("{rule}, and they name none in common"));
    }
    for object in &all {
        let reason = if object.colors.is_none() { Some("has none") } else { object.fixed() };
        if let Some(reason) = reason {
            let rule = "a mesh that gets a texture has one material, no textures, and one colour at each vertex";
            return wrong(format!("{rule}, and {:?} {reason}", object.name));
        }
    }
    check_names(scene, stages, number, rates)?;
    let side = size.0 as u64;
    let bytes = 3 * OF_LEARNT_NUMBER * side * side * all.len() as u64;
    let what = || format!("{} learnt textures of {side} x {side} texels", all.len());
    scene.folder.memory().check(bytes, &Location::new(&scene.path), what)
}

/// Checks that only one stage gives a texture, and that no stage remeshes later.
fn check_order(scene: &Scene, stages: &[Stage], number: usize) -> Result<(), SceneError> {
    let wrong =
        |message: &str| Err(SceneError::content(Location::new(&scene.path), message.to_owned()));
    if stages[number + 1..].iter().any(|stage| stage.texture.is_some()) {
        return wrong("one stage has a `texture`, and here are several");
    }
    let again = |remesh: &Remesh| remesh.every.is_some();
    let remeshes_later = stages[number].remesh.as_ref().is_some_and(again)
        || stages[number + 1..].iter().any(|stage| stage.remesh.is_some());
    if remeshes_later {
        return wrong(
            "meshes are remeshed before they get a texture, and `remesh` comes after `texture`",
        );
    }
    Ok(())
}

/// Checks that stages before the texture do not learn it, and that later ones learn no colours that became texels.
fn check_names(
    scene: &Scene,
    stages: &[Stage],
    number: usize,
    rates: &[LearntRate],
) -> Result<(), SceneError> {
    let has_others = |key: &str| {
        let is_other = |rate: &&LearntRate| {
            let given = scene.objects.iter().filter(|object| scene.gives_texture(object));
            let mut names = given.map(|object| COLORS.parameter_name(&object.name));
            rate.key == key && names.all(|name| name != rate.name)
        };
        rates.iter().any(|rate| is_other(&rate))
    };
    let rules = [
        (TEXTURE.key, 0..number, "there is none before"),
        (COLORS.key, number..stages.len(), "they are in the texture from there on"),
    ];
    for (key, without, reason) in rules {
        let named = |stage: &usize| {
            stages[*stage].learn.as_ref().is_some_and(|keys| keys.iter().any(|own| own == key))
        };
        if let Some(stage) = without.into_iter().find(named).filter(|_| !has_others(key)) {
            let message = format!(
                "meshes get a texture in stage {}, and stage {} learns {key:?}: {reason}",
                number + 1,
                stage + 1
            );
            return Err(SceneError::content(Location::new(&scene.path), message));
        }
    }
    Ok(())
}

/// Gives a texture to all objects that await one. `value` returns the value of a parameter, if it is learnt.
///
/// # Errors
/// [`SceneError::Mesh`] for a texture without room for all charts.
pub(super) fn textured(
    scene: &Scene,
    to: StageTexture,
    value: impl Fn(&str) -> Option<Tensor<f32>>,
) -> Result<Scene, SceneError> {
    let mut scene = scene.clone();
    for index in 0..scene.objects.len() {
        if scene.awaits_texture(&scene.objects[index]) {
            give_texture(&mut scene.objects[index], to.size.0, &value)?;
        }
    }
    Ok(scene)
}

fn give_texture(
    object: &mut Object,
    size: usize,
    value: &impl Fn(&str) -> Option<Tensor<f32>>,
) -> Result<(), SceneError> {
    let rows = object.colors_of_vertices();
    let (Some(colors), Some(rows)) = (&object.colors, rows) else { return Ok(()) };
    let positions = value(&VERTICES.parameter_name(&object.name));
    let positions = positions.as_ref().unwrap_or(&object.positions);
    let colors = value(&COLORS.parameter_name(&object.name)).unwrap_or(colors.rows.clone());
    // The renderer multiplies colours at vertices by the base colour of the material; texels replace both.
    let factor = object.materials.first().map_or([1.0; 3], |material| material.base_color);
    let colors = Tensor::from_fn([rows.len(), 3], |[vertex, channel]| {
        colors[[rows[vertex] as usize, channel]] * factor[channel]
    });
    let found = atlas(positions, &object.mesh, &AtlasOptions::new(size))?;
    let map = TexelMap::new(&found.coordinates, &found.corners, size)?;
    let texels = map.bake(&colors, &object.mesh)?;
    let gutters = Gutters { sources: map.sources().clone(), levels: found.levels };
    let coordinates = Attribute { rows: found.coordinates, indices: found.corners };
    object.set_texture(coordinates, texels, gutters);
    Ok(())
}
