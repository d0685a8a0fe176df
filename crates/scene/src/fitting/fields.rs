//! Fields whose surfaces are meshes: checks of stages, a loss of masks for points inside and outside, and the meshes
//! that are left when fields are no longer learnt.
//!
//! # The loss of masks
//! The gradient of a mask moves silhouettes. A pixel that a surface covers wholly has none, so no hole would open. A
//! pixel in which nothing is drawn has none either, so no handle would grow. So points of the field add to the loss of
//! a view:
//!
//! - `-f a^2 / N`, where a point is inside and the view sees it before its background;
//! - `f a^2 / N`, where a point is outside and its pixel is in the mask, and nothing is drawn there.
//!
//! `f` is the field in cells, an edge of the point's cell is `a` pixels long, and there are N pixels. So the sum is
//! about the mean over pixels of the length along the ray that is wrongly inside, or wrongly outside. Only the field
//! has a gradient. The images of points are constants, with the focal lengths of the file.

use bokashi_core::{Tensor, Var};
use bokashi_fit::{FitError, Parameters};

use super::remeshing::learnt_objects;
use crate::description::Stage;
use crate::error::{Location, SceneError};
use crate::learnables::{COLORS, FIELD, Frame, Values};
use crate::renderer::{Drawn, Renderer, SeenPoint, field_name};
use crate::scene::Scene;

/// Whether a stage learns the fields of a scene.
pub(super) fn learns_fields(scene: &Scene, stage: &Stage) -> bool {
    let is_named = |keys: &Vec<String>| keys.iter().any(|key| key == FIELD.key);
    scene.description.learn.field.is_some() && stage.learn.as_ref().is_none_or(is_named)
}

/// Checks that stages that learn fields come first, and have no `remesh` and no `texture`. They learn no vertices of
/// meshes with a field.
///
/// # Errors
/// [`SceneError::Content`] otherwise.
pub(super) fn check_fields(scene: &Scene, stages: &[Stage]) -> Result<(), SceneError> {
    if scene.description.learn.field.is_none() {
        return Ok(());
    }
    let wrong = |message: String| Err(SceneError::content(Location::new(&scene.path), message));
    let vertices = learnt_objects(scene)?;
    let mut after = None;
    for (number, stage) in (1..).zip(stages) {
        if !learns_fields(scene, stage) {
            after = after.or(Some(number));
            continue;
        }
        if let Some(before) = after {
            let rule =
                "stages that learn a `field` come before all others, as its mesh is left behind";
            return wrong(format!("{rule}, and stage {number} does after stage {before}"));
        }
        if stage.remesh.is_some() {
            let rule = "a stage with `remesh` learns no `field`, which has a new mesh in each step";
            return wrong(format!("{rule}, and stage {number} does"));
        }
        if stage.texture.is_some() {
            let rule =
                "a stage with `texture` learns no `field`, which has a new mesh in each step";
            return wrong(format!("{rule}, and stage {number} does"));
        }
        let is_named = |keys: &Vec<String>| keys.iter().any(|key| key == "vertices");
        let with_vertices = stage.learn.as_ref().is_none_or(is_named);
        let has_field = |(index, _): &&(usize, String)| scene.objects[*index].field.is_some();
        if let Some((_, name)) = vertices.iter().find(has_field).filter(|_| with_vertices) {
            let rule = "a stage learns either the `field` or the `vertices` of a mesh: `learn` of a stage says which";
            return wrong(format!("{rule}, and stage {number} learns both of {name:?}"));
        }
    }
    match after {
        Some(1) => {
            let rule = "a `field` is learnt in the first stage";
            wrong(format!("{rule}, and that learns other things"))
        }
        _ => Ok(()),
    }
}

/// Whether a parameter has values at the points of a field.
pub(super) fn is_of_field(scene: &Scene, name: &str) -> bool {
    let mut fields = scene.objects.iter().filter(|object| object.field.is_some());
    fields
        .any(|object| [&FIELD, &COLORS].iter().any(|row| row.parameter_name(&object.name) == name))
}

/// Checks that a saved fit can go on in a stage: with fields if the stage learns them, and otherwise with meshes.
///
/// # Errors
/// [`FitError::Saved`] where the stage was changed from one kind to the other.
pub(super) fn check_stage_under_way(scene: &Scene, stage: &Stage) -> Result<(), FitError> {
    let has_fields = scene.objects.iter().any(|object| object.field.is_some());
    if scene.description.learn.field.is_none() || has_fields == learns_fields(scene, stage) {
        return Ok(());
    }
    let [rule, value] = match has_fields {
        true => ["learns the `field`, as it did", "one that does not"],
        false => ["learns no `field`, as it did", "one that does"],
    };
    Err(FitError::saved(format!("a stage under way that {rule}"), value.to_owned()))
}

/// The scene whose meshes are the last surfaces of their fields, without the fields.
///
/// # Errors
/// Those of a field that has no surface.
pub(super) fn settled(
    scene: &Scene,
    frame: &Frame,
    parameters: &Parameters<f32>,
) -> Result<Scene, SceneError> {
    let mut scene = scene.clone();
    let before = scene.clone();
    FIELD.put(&mut scene, frame, |name| parameters.value(name).ok())?;
    COLORS.put(&mut scene, frame, |name| {
        parameters.value(name).ok().filter(|_| is_of_field(&before, name))
    })?;
    scene.objects.iter_mut().for_each(|object| object.field = None);
    Ok(scene)
}

/// The loss of masks for points of fields in a view; `None` where no point adds to it. `image: [H, W, 4]` has the
/// view's mask in its last channel.
pub(super) fn silhouette_error<'t>(
    renderer: &Renderer,
    values: &Values<'t, '_>,
    (view, reduce): (usize, usize),
    drawn: &Drawn<'t>,
    image: &Tensor<f32>,
) -> Result<Option<Var<'t, f32>>, FitError> {
    let Some(variables) = values.learnt else { return Ok(None) };
    let masks = || image.data().as_chunks::<4>().0.iter().map(|pixel| pixel[3]);
    let mut is_missing: Vec<bool> = masks().map(|mask| mask == 1.0 && drawn.is_sharp()).collect();
    if drawn.is_sharp() {
        drawn.fragments().coverage.pixels().for_each(|pixel| is_missing[pixel] = false);
    }
    let is_background: Vec<bool> = masks().map(|mask| mask == 0.0).collect();
    let share = 1.0 / is_missing.len() as f32;
    let mut all: Option<Var<'t, f32>> = None;
    for (index, object) in renderer.scene().objects.iter().enumerate() {
        let Ok(field) = variables.get(&field_name(&object.name)) else { continue };
        let numbers = field.value();
        let mut weights = vec![0.0; numbers.size()];
        for SeenPoint { point, pixel, extent } in
            renderer.seen_points(values, view, reduce, index)?
        {
            let is_inside = numbers.data()[point] < 0.0;
            if is_inside && is_background[pixel] {
                weights[point] -= share * extent * extent;
            } else if !is_inside && is_missing[pixel] {
                weights[point] += share * extent * extent;
            }
        }
        if weights.iter().any(|weight| *weight != 0.0) {
            let error = field.dot(values.tape.constant(&Tensor::from(&weights[..])))?;
            all = Some(all.map_or(Ok(error), |sum| sum.try_add(error))?);
        }
    }
    Ok(all)
}
