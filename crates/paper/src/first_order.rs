//! Fits of the cube by gradients alone, and what is kept of them.

use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_core::{Scalar, Tensor};
use bokashi_fit::{Fit, FitError, History, Parameter, Parameters, Step, StepState};

use super::outcome::{Outcome, Progress, Record, Snapshot, snapshot_steps};
use super::pipeline::{COLORS, CubeMeasure, CubePipeline, VERTICES};
use super::settings::{CubeSettings, Experiment};

/// The history and the snapshots of a fit, and what it learnt, by name.
type Learnt = (History<CubeMeasure>, Vec<Snapshot>, Vec<(String, Tensor<f64>)>);

/// A new fit of `settings` as a part of a longer one.
pub(super) fn run_first_order<T: Scalar>(
    settings: &CubeSettings,
    on_step: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Learnt, FitError> {
    let (pipeline, parameters) = CubePipeline::<T>::new(settings)?;
    let mut fit = Fit::new(parameters, settings.fit_settings())?;
    let seen = &mut |progress, _: &StepState<'_, T, CubeMeasure>| on_step(progress);
    let (history, snapshots) = drive_history(settings, pipeline, &mut fit, seen)?;
    let value = |parameter: &Parameter<T>| (parameter.name().to_owned(), parameter.value().cast());
    Ok((history, snapshots, fit.parameters().iter().map(value).collect()))
}

/// What is called with every step.
type OnStep<'a, T> = dyn FnMut(Progress, &StepState<'_, T, CubeMeasure>) -> ControlFlow<()> + 'a;

/// Runs `fit`, new or resumed, to its end.
pub(super) fn drive<T: Scalar>(
    settings: &CubeSettings,
    pipeline: CubePipeline<T>,
    fit: &mut Fit<T>,
    on_step: &mut OnStep<'_, T>,
) -> Result<Outcome, FitError> {
    let start = Instant::now();
    let (history, snapshots) = drive_history(settings, pipeline, fit, on_step)?;
    Ok(outcome(settings, &history, snapshots, start.elapsed().as_secs_f64()))
}

/// Runs `fit` to its end, and keeps its history and its snapshots.
fn drive_history<T: Scalar>(
    settings: &CubeSettings,
    mut pipeline: CubePipeline<T>,
    fit: &mut Fit<T>,
    on_step: &mut OnStep<'_, T>,
) -> Result<(History<CubeMeasure>, Vec<Snapshot>), FitError> {
    let done = fit.steps_done();
    let due = snapshot_steps(settings.steps).into_iter().filter(|&step| step >= done);
    let mut due = due.peekable();
    let mut snapshots = Vec::new();
    let history = fit.run_with(&mut pipeline, |seen| {
        if due.next_if_eq(&seen.step.step).is_some() {
            snapshots.push(snapshot(seen.parameters, seen.step));
        }
        on_step(progress(settings, seen.step, seen.ms), seen)
    })?;
    let last = history.last();
    if snapshots.last().is_none_or(|snapshot| snapshot.step != last.step) {
        snapshots.push(snapshot(fit.parameters(), last));
    }
    Ok((history, snapshots))
}

/// What a callback sees of `step`, `ms` after the one before it.
pub(super) fn progress(settings: &CubeSettings, step: &Step<CubeMeasure>, ms: f64) -> Progress {
    let Record { step, seconds, loss, vertex_error, sigma, .. } = record(settings, step);
    Progress { step, steps: settings.steps, seconds, loss, vertex_error, sigma, ms }
}

/// The learnt cube at `step`.
pub(super) fn snapshot<T: Scalar>(
    parameters: &Parameters<T>,
    step: &Step<CubeMeasure>,
) -> Snapshot {
    let get = |name| parameters.get(name).expect("the pipeline made these parameters");
    Snapshot {
        step: step.step,
        vertices: get(VERTICES).raw().cast(),
        colors: get(COLORS).raw().cast(),
        sigma: step.measure.sigma,
    }
}

/// `step` without the errors that do not apply: what is not learnt has none.
pub(super) fn record(settings: &CubeSettings, step: &Step<CubeMeasure>) -> Record {
    let learns_cube = settings.experiment != Experiment::Sigma;
    let Step { step, seconds, loss, measure } = *step;
    Record {
        step,
        seconds,
        loss,
        vertex_error: learns_cube.then_some(measure.vertex_error),
        sigma: measure.sigma,
        color_error: learns_cube.then_some(measure.color_error),
    }
}

pub(super) fn outcome(
    settings: &CubeSettings,
    history: &History<CubeMeasure>,
    snapshots: Vec<Snapshot>,
    wall_seconds: f64,
) -> Outcome {
    let (first, last) = (record(settings, history.initial()), record(settings, history.last()));
    let learns_cube = settings.experiment != Experiment::Sigma;
    Outcome {
        experiment: settings.experiment,
        preset: settings.preset,
        resolution: settings.resolution,
        seed: settings.seed,
        steps: last.step,
        silhouettes: settings.silhouettes,
        precision: settings.precision,
        sigma_target: settings.blurs().then_some(settings.sigma_target),
        sigma_final: last.sigma,
        vertex_error_initial: first.vertex_error,
        vertex_error_final: last.vertex_error,
        vertex_error_plain: learns_cube.then_some(history.last().measure.vertex_error_plain),
        vertex_error_tail: learns_cube.then(|| history.tail(|step| step.measure.vertex_error)),
        color_error_final: last.color_error,
        loss_initial: first.loss,
        loss_final: last.loss,
        ms_per_step_median: history.step_ms_median(),
        target_ms_per_step_median: history.preparation_ms_median(),
        wall_seconds,
        history: history.steps.iter().map(|step| record(settings, step)).collect(),
        snapshots,
    }
}
