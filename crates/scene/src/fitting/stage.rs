//! A stage of a fit: its views, its rates, and the loss of a step.

use std::sync::{Arc, PoisonError, RwLock};

use bokashi_core::{Tape, Var};
use bokashi_fit::{
    FitError, FitSettings, Optimizer, Parameters, Penalty, Pipeline, Schedule, Variables, View,
    Views, mean_error, ssim_error, views,
};

use super::fields::silhouette_error;
use crate::description::{Count, Description, LossKind, Stage};
use crate::error::{Location, SceneError};
use crate::learnables::{TEXTURE, Values, learnt_keys};
use crate::learning::{LearntRate, Regularizer};
use crate::renderer::{Drawn, OnSurfaces, Renderer};
use crate::saved_fit::Progress;
use crate::scene::Scene;
use crate::stopping::StopRules;
use crate::targets::{HUBER, Target, Targets, fit_error};

/// The number of steps, where a scene does not say.
const STEPS: usize = 1000;

/// The loss of a view.
pub(super) type Loss = Box<
    dyn for<'t> Fn(View, &'t Tape<f32>, &Variables<'t, f32>) -> Result<Var<'t, f32>, FitError>
        + Send
        + Sync,
>;

/// The renderer of a step's views. It is exchanged where a field has another surface.
pub(super) type Drawing = Arc<RwLock<Arc<Renderer>>>;

/// A drawing that begins with `renderer`.
pub(super) fn drawing_of(renderer: &Arc<Renderer>) -> Drawing {
    Arc::new(RwLock::new(Arc::clone(renderer)))
}

/// The pipeline of one stage.
pub(super) struct StagePipeline {
    /// The number of steps of each stage that is over.
    pub(super) done: Vec<u64>,
    pub(super) views: Views<f32, Loss>,
    pub(super) drawing: Drawing,
    pub(super) regularizers: Arc<[Regularizer]>,
    pub(super) rules: StopRules,
    /// The number of steps done before the last remeshing.
    pub(super) remeshed: Option<u64>,
    /// The bytes of changed surfaces in a saved fit.
    pub(super) surfaces: Arc<[u8]>,
    /// The bytes of the fit's origin in a saved fit: the scene's files and settings, and the starts of parameters.
    pub(super) origin: Arc<[u8]>,
}

impl Pipeline<f32> for StagePipeline {
    type Measure = ();

    fn prepare(&mut self, step: u64) -> Result<(), FitError> {
        self.views.prepare(step)
    }

    fn save_state(&self, state: &mut Vec<u8>) {
        let Self { remeshed, .. } = *self;
        let progress = Progress { done: self.done.clone(), rules: self.rules.state(), remeshed };
        progress.write(&self.surfaces, &self.origin, state);
    }

    fn restore_state(&mut self, _state: &[u8]) -> Result<(), FitError> {
        // It was read before there was a pipeline.
        Ok(())
    }

    fn loss<'t>(
        &mut self,
        tape: &'t Tape<f32>,
        variables: &Variables<'t, f32>,
    ) -> Result<Var<'t, f32>, FitError> {
        let current =
            |drawing: &Drawing| Arc::clone(&drawing.read().unwrap_or_else(PoisonError::into_inner));
        let with = |learnt| Values { tape, learnt: Some(learnt) };
        let mut on_surfaces = None;
        if let Some(surfaces) = current(&self.drawing).on_surfaces(&with(variables))? {
            let OnSurfaces { renderer, variables } = surfaces;
            if let Some(renderer) = renderer {
                let mut drawing = self.drawing.write().unwrap_or_else(PoisonError::into_inner);
                *drawing = Arc::new(renderer);
            }
            on_surfaces = Some(variables);
        }
        let of_views = on_surfaces.as_ref().unwrap_or(variables);
        // A single view has nobody to share with.
        let shared = match self.views.chosen().len() {
            0 | 1 => None,
            _ => current(&self.drawing).share_values(&with(of_views))?,
        };
        let mut loss = self.views.loss(tape, shared.as_ref().unwrap_or(of_views))?;
        for regularizer in self.regularizers.iter() {
            loss = loss.try_add(regularizer.loss(variables)?)?;
        }
        Ok(loss)
    }
}

/// The stages of a description; one stage with all steps, where it has none.
pub(super) fn stages(description: &Description) -> Vec<Stage> {
    match description.stages.as_slice() {
        [] => vec![Stage {
            steps: description.stop.steps.unwrap_or(Count(STEPS)),
            learn: None,
            reduce: None,
            views_per_step: description.stop.views_per_step,
            rates: None,
            remesh: None,
            texture: None,
        }],
        stages => stages.to_vec(),
    }
}

/// The indices of the views that are learnt from: those with an image that are not held out.
pub(super) fn views_to_learn_from(scene: &Scene) -> Result<Arc<[usize]>, SceneError> {
    let views: Arc<[usize]> = scene.views_with_image(false).collect();
    if views.is_empty() {
        let rule = "a fit has a view with an image that is not held out";
        let message = format!("{rule}, and none of {} views is one", scene.views.len());
        return Err(SceneError::content(Location::new(&scene.path), message));
    }
    Ok(views)
}

/// Checks that a rule of held-out views has views to measure.
fn check_held_out(scene: &Scene) -> Result<(), SceneError> {
    if scene.description.stop.held_out.is_none() || scene.views_with_image(true).next().is_some() {
        return Ok(());
    }
    let rule = "`stop.held_out` measures views with an image that are held out";
    let message = format!("{rule}, and none of {} views is one", scene.views.len());
    Err(SceneError::content(Location::new(&scene.path), message))
}

/// Checks that stages name learnables of the scene, and that a rule of held-out views has views to measure.
pub(super) fn check_stages(scene: &Scene, rates: &[LearntRate]) -> Result<(), SceneError> {
    check_held_out(scene)?;
    let mut known: Vec<_> = rates.iter().map(|rate| rate.key).collect();
    // What is learnt of a mesh after its field has no rate before.
    let later = learnt_keys(&scene.description.learn).into_iter().map(|keys| keys.key);
    known.extend(later.filter(|key| !known.contains(key)).collect::<Vec<_>>());
    known.dedup();
    if scene.objects.iter().any(|object| scene.awaits_texture(object)) {
        known.push(TEXTURE.key);
    }
    let named = scene.description.stages.iter().filter_map(|stage| stage.learn.as_ref()).flatten();
    match named.into_iter().find(|name| !known.contains(&name.as_str())) {
        None => Ok(()),
        Some(name) => {
            let rule = format!("a stage learns some of {}", known.join(", "));
            Err(SceneError::content(
                Location::new(&scene.path),
                format!("{rule}, and not {name:?}"),
            ))
        }
    }
}

/// Sets the rates of the parameters for a stage. A rate of 0 freezes what the stage does not learn.
pub(super) fn set_rates(
    parameters: &mut Parameters<f32>,
    rates: &[LearntRate],
    stage: &Stage,
) -> Result<(), FitError> {
    let factor = stage.rates.map_or(1.0, |factor| factor.0);
    for LearntRate { name, key, rate } in rates {
        let is_learnt =
            stage.learn.as_ref().is_none_or(|keys| keys.iter().any(|learnt| learnt == key));
        parameters.set_rate(name, if is_learnt { rate * factor } else { 0.0 })?;
    }
    Ok(())
}

pub(super) fn settings(stage: &Stage) -> FitSettings {
    let steps = stage.steps.0 as u64;
    FitSettings {
        steps,
        schedule: Schedule::Cosine { steps, floor: 0.01 },
        // With 0.999, gradients of the first steps would keep steps small to the end of a short stage.
        optimizer: Optimizer::Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-8 },
        ..FitSettings::default()
    }
}

/// The number of views, of `count`, that a step of a stage draws.
pub(super) fn views_per_step(stage: &Stage, count: usize) -> usize {
    stage.views_per_step.map_or(1, |count| count.0).min(count)
}

/// The pipeline over the views of a stage.
pub(super) fn views_of(
    drawing: &Drawing,
    targets: &Arc<Targets>,
    learnt_from: &Arc<[usize]>,
    stage: &Stage,
    seed: u64,
) -> Views<f32, Loss> {
    let (drawing, targets, all) =
        (Arc::clone(drawing), Arc::clone(targets), Arc::clone(learnt_from));
    let reduce = stage.reduce.map_or(1, |reduce| reduce.0);
    let (count, per_step) = (all.len(), views_per_step(stage, all.len()));
    let loss: Loss = Box::new(move |view, tape, variables| {
        let values = Values { tape, learnt: Some(variables) };
        let renderer = Arc::clone(&drawing.read().unwrap_or_else(PoisonError::into_inner));
        loss_of_view(&renderer, &targets, &values, all[view.index], reduce)
    });
    views(count, loss).per_step(per_step).seed(seed)
}

/// Whether an error is that of a number that is not finite.
pub(super) fn is_not_finite(error: &FitError) -> bool {
    match error {
        FitError::NotFinite { .. } => true,
        FitError::View { error, .. } => is_not_finite(error),
        _ => false,
    }
}

/// The loss of a view against its image.
pub(super) fn loss_of_view<'t>(
    renderer: &Renderer,
    targets: &Targets,
    values: &Values<'t, '_>,
    view: usize,
    reduce: usize,
) -> Result<Var<'t, f32>, FitError> {
    let target = targets.get(view, reduce).map_err(fit_error)?;
    loss_of_target(renderer, &target, targets.has_mask(view), values, view, reduce)
}

/// The loss of a view against its image `target`. With `has_mask` the loss has a term of the silhouettes.
pub(super) fn loss_of_target<'t>(
    renderer: &Renderer,
    target: &Target,
    has_mask: bool,
    values: &Values<'t, '_>,
    view: usize,
    reduce: usize,
) -> Result<Var<'t, f32>, FitError> {
    let drawn = renderer.draw_again(values, view, reduce, has_mask)?;
    let loss = error_of_view(renderer, target, values, (&drawn, reduce))?;
    if !has_mask {
        return Ok(loss);
    }
    let weight = renderer.scene().description.loss.silhouette.map_or(0.0, |weight| weight.0);
    let of_fields = silhouette_error(renderer, values, (view, reduce), &drawn, &target.image)?;
    Ok(match of_fields {
        Some(error) => loss.try_add(error * weight as f32)?,
        None => loss,
    })
}

/// The loss of a drawn view against its image, without that of fields.
fn error_of_view<'t>(
    renderer: &Renderer,
    target: &Target,
    values: &Values<'t, '_>,
    (drawn, reduce): (&Drawn<'t>, usize),
) -> Result<Var<'t, f32>, FitError> {
    if let Some(loss) = &target.loss {
        return Ok(drawn.light()?.map(|light| renderer.toned(light))?.loss(loss)?);
    }
    let image = renderer.image(values, drawn, reduce)?;
    let target = values.tape.constant(&target.image);
    let description = &renderer.scene().description.loss;
    let penalty = match description.kind {
        LossKind::Squared => Penalty::Squared,
        LossKind::Absolute => Penalty::Absolute,
        LossKind::Huber => Penalty::Huber { delta: HUBER },
    };
    let colors = |all: Var<'t, f32>| all.slice(2, 0..3);
    let (actual, expected) = (colors(image)?, colors(target)?);
    let mut loss = mean_error(actual, expected, penalty)?;
    if let Some(share) = description.ssim.filter(|share| share.0 > 0.0) {
        let structure = ssim_error(actual, expected, 1.0)?;
        loss = (loss * (1.0 - share.0) as f32).try_add(structure * share.0 as f32)?;
    }
    if image.shape()[2] == 4 {
        let mask = |all: Var<'t, f32>| all.slice(2, 3..4);
        let weight = description.silhouette.map_or(0.0, |weight| weight.0) as f32;
        let error = mean_error(mask(image)?, mask(target)?, penalty)?;
        loss = loss.try_add(error * weight)?;
    }
    Ok(loss)
}
