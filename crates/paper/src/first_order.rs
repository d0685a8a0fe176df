//! Fits of the cube by gradients alone, and what is kept of any fit of it.

use std::iter::Peekable;
use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_core::Scalar;
use bokashi_fit::{
    Answer, Fit, FitError, Fitting, History, Listener, Parameters, Rules, Step, StepState, Steps,
    Stop,
};

use super::outcome::{Outcome, Progress, Record, Snapshot, snapshot_steps};
use super::pipeline::{COLORS, CubeMeasure, CubePipeline, VERTICES};
use super::settings::{CubeSettings, Experiment};

/// What is called with every step.
pub(super) type OnStep<'a> = dyn FnMut(Progress) -> ControlFlow<()> + 'a;

/// A fit of the cube by gradients, under way.
pub(super) type CubeFitting<'a, T> = Fitting<'a, T, CubePipeline<T>>;

/// Keeps the cube along the way, and tells how the fit goes; in fits of several parts it is a listener of each.
pub(super) struct Film<'a> {
    settings: &'a CubeSettings,
    on_step: &'a mut OnStep<'a>,
    /// The steps with a snapshot; `None`: all of them.
    pub(super) due: Option<Peekable<std::vec::IntoIter<u64>>>,
    pub(super) snapshots: Vec<Snapshot>,
    last: Option<Step<CubeMeasure>>,
}

impl<'a> Film<'a> {
    /// A film of a fit of `settings`, or of its first `steps` steps.
    pub(super) fn new(settings: &'a CubeSettings, steps: u64, on_step: &'a mut OnStep<'a>) -> Self {
        let due = Some(snapshot_steps(steps).into_iter().peekable());
        Self { settings, on_step, due, snapshots: Vec::new(), last: None }
    }
}

impl<S: Steps<Measure = CubeMeasure>> Listener<S> for Film<'_> {
    fn before_update(&mut self, state: &StepState<'_, S::Number, CubeMeasure>) -> Answer<S::Error> {
        let step = state.step;
        let is_due = self.due.as_mut().is_none_or(|due| {
            // A fit that goes on from a file begins late.
            while due.next_if(|&due| due < step.step).is_some() {}
            due.next_if_eq(&step.step).is_some()
        });
        if is_due {
            self.snapshots.push(snapshot(state.parameters, step));
        }
        self.last = Some(*step);
        Ok((self.on_step)(progress(self.settings, step, state.ms)))
    }

    fn end(&mut self, fit: &S, _stop: Stop) -> Result<(), S::Error> {
        // What no update followed is the final state.
        let last = self.last.filter(|last| last.step == fit.steps_done());
        let known = self.snapshots.last().map(|snapshot| snapshot.step);
        if let Some(last) = last.filter(|last| known != Some(last.step)) {
            self.snapshots.push(snapshot(fit.parameters(), &last));
        }
        Ok(())
    }
}

/// Runs `fit`, new or resumed, to its end, with a listener that saves it where there is one.
pub(super) fn run_to_end<'a, T: Scalar>(
    settings: &CubeSettings,
    pipeline: &'a mut CubePipeline<T>,
    fit: &'a mut Fit<T>,
    saving: Option<&mut dyn Listener<CubeFitting<'a, T>>>,
    on_step: &mut OnStep<'_>,
) -> Result<Outcome, FitError> {
    let start = Instant::now();
    let mut history = History::with_room_for(settings.steps.saturating_sub(fit.steps_done()));
    let mut film = Film::new(settings, settings.steps, on_step);
    let mut listeners: Vec<&mut dyn Listener<_>> = vec![&mut history];
    listeners.extend(saving.map(|saving| saving as &mut dyn Listener<_>));
    listeners.push(&mut film);
    fit.drive(pipeline, &Rules::default(), &mut listeners)?;
    let snapshots = film.snapshots;
    Ok(outcome(settings, &history, snapshots, start.elapsed().as_secs_f64()))
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
        kernel: settings.blurs().then_some(settings.kernel),
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
