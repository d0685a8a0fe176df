//! One fit of the cube: as a [`Pipeline`], and from [`CubeSettings`] to an [`Outcome`].
//!
//! # The error against the truth
//! `min over p of mean over i of |v_i - truth_p(i)|`, over the 24 automorphisms `p` of the
//! triangulation, each of which is an exact minimum of the loss; the colours' error is under the
//! same `p`.

use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::Blur;

use super::automorphism::automorphisms;
use super::cube::{FACES, VERTEX_COUNT, View, random_start, truth};
use super::outcome::{Outcome, Progress, Record, Snapshot, snapshot_steps};
use super::scene::Scene;
use super::second_order;
use super::settings::{CubeSettings, Experiment, Precision, Preset};
use crate::error::FitError;
use crate::fit::{Fit, StepState};
use crate::history::{History, Step};
use crate::loss::squared_error;
use crate::parameter::{Parameter, Parameters, Variables};
use crate::pipeline::Pipeline;

pub(super) const VERTICES: &str = "vertices";
pub(super) const COLORS: &str = "colors";
pub(super) const SIGMA: &str = "sigma";

/// A learnt cube against the true one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CubeMeasure {
    /// Mean distance of the vertices from the truth, the least over automorphisms.
    pub vertex_error: f64,
    /// Mean distance of each vertex from its own truth.
    pub vertex_error_plain: f64,
    /// Mean distance of the colours, under the automorphism of the vertices.
    pub color_error: f64,
    /// Blur, in pixels; `None` without a blur.
    pub sigma: Option<f64>,
}

/// The cube of one of the paper's experiments, in numbers of type `T`.
#[derive(Debug)]
pub struct CubePipeline<T: Scalar> {
    scene: Scene,
    settings: CubeSettings,
    moves: bool,
    view: View,
    truth: Snapshot,
    /// The truth in `T`: vertices, colours, sigma.
    target_inputs: (Tensor<T>, Tensor<T>, Option<T>),
    target: Option<Tensor<T>>,
    target_tape: Tape<T>,
    automorphisms: Vec<Vec<usize>>,
}

impl<T: Scalar> CubePipeline<T> {
    /// The pipeline of `settings`, and the parameters it starts from: `vertices` and `colors`
    /// (frozen in experiment 5.2) and, where there is a blur, `sigma`.
    ///
    /// # Errors
    /// [`FitError::Setting`] for settings outside their range.
    pub fn new(settings: &CubeSettings) -> Result<(Self, Parameters<T>), FitError> {
        settings.check()?;
        let blur = settings.blurs().then(|| Blur {
            kernel: settings.kernel,
            border: settings.border,
            radius: settings.blur_radius(),
        });
        let truth = truth(settings.blurs().then_some(settings.sigma_target));
        let pipeline = Self {
            scene: Scene::new(settings.resolution, settings.silhouettes, blur)?,
            settings: settings.clone(),
            moves: settings.experiment != Experiment::Sigma,
            view: View::fixed(),
            target_inputs: (
                truth.vertices.cast(),
                truth.colors.cast(),
                truth.sigma.map(T::from_f64),
            ),
            truth,
            target: None,
            target_tape: Tape::new(),
            automorphisms: automorphisms(&FACES, VERTEX_COUNT),
        };
        let parameters = pipeline.start(settings)?;
        Ok((pipeline, parameters))
    }

    /// The parameters that a fit starts from.
    pub(super) fn start(&self, settings: &CubeSettings) -> Result<Parameters<T>, FitError> {
        let rates = settings.learning_rates();
        let start = match settings.experiment {
            Experiment::Sigma => truth(None),
            Experiment::Vertices | Experiment::Joint => random_start(settings.seed, None),
        };
        let mut vertices = Parameter::new(VERTICES, start.vertices.cast()).rate(rates.vertices);
        let mut colors = Parameter::new(COLORS, start.colors.cast()).rate(rates.colors);
        if settings.experiment == Experiment::Sigma {
            (vertices, colors) = (vertices.frozen(), colors.frozen());
        }
        let mut parameters = Parameters::new().with(vertices)?.with(colors)?;
        if settings.blurs() {
            let sigma = Tensor::scalar(T::from_f64(settings.sigma_start));
            let sigma = Parameter::new(SIGMA, sigma).rate(rates.sigma);
            parameters = parameters.with(sigma.mapping(settings.sigma_mapping))?;
        }
        Ok(parameters)
    }

    /// The target image of the step that was prepared last, `[H, W, 3]`.
    pub fn target(&self) -> Option<&Tensor<T>> {
        self.target.as_ref()
    }
}

impl<T: Scalar> Pipeline<T> for CubePipeline<T> {
    type Measure = CubeMeasure;

    #[cfg(feature = "save")]
    fn save_state(&self, state: &mut Vec<u8>) {
        // A pose is a function of the seed and the step: the generator has no other state.
        self.settings.save(state);
    }

    #[cfg(feature = "save")]
    fn restore_state(&mut self, state: &[u8]) -> Result<(), FitError> {
        CubeSettings::restored(state)?.check_resumed_by(&self.settings)
    }

    fn prepare(&mut self, step: u64) -> Result<(), FitError> {
        if self.moves {
            self.view = View::random(self.settings.seed, step);
        } else if self.target.is_some() {
            return Ok(());
        }
        // The tape takes the buffer of the old image back only where nobody else holds it.
        self.target = None;
        self.target_tape.reset();
        let tape = &self.target_tape;
        let (vertices, colors, sigma) = &self.target_inputs;
        let (vertices, colors) = (tape.constant(vertices), tape.constant(colors));
        let sigma = sigma.map(|sigma| tape.constant_scalar(sigma));
        let image = self.scene.image(&self.view.camera(), vertices, colors, sigma)?;
        self.target = Some(image.value());
        Ok(())
    }

    fn loss<'t>(
        &self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        let sigma = self.truth.sigma.map(|_| variables.get(SIGMA)).transpose()?;
        let (vertices, colors) = (variables.get(VERTICES)?, variables.get(COLORS)?);
        let image = self.scene.image(&self.view.camera(), vertices, colors, sigma)?;
        let target = self.target.as_ref().expect("a step is prepared before its loss is recorded");
        Ok(squared_error(image, tape.constant(target))?)
    }

    fn measure(&self, parameters: &Parameters<T>) -> CubeMeasure {
        let get = |name| parameters.get(name).expect("the pipeline made these parameters");
        let (vertices, colors) = (get(VERTICES).raw().data(), get(COLORS).raw().data());
        let vertex_distances = distances(vertices, self.truth.vertices.data());
        let color_distance =
            |i: usize, j: usize| distance(&colors[3 * i..], &self.truth.colors.data()[3 * j..]);

        let under = |p: &[usize]| mean(|i| vertex_distances[i][p[i]]);
        let errors = self.automorphisms.iter().map(|p| (under(p), p));
        let least = errors.min_by(|(a, _), (b, _)| a.total_cmp(b));
        let (vertex_error, nearest) = least.expect("the identity is an automorphism");
        CubeMeasure {
            vertex_error,
            vertex_error_plain: mean(|i| vertex_distances[i][i]),
            color_error: mean(|i| color_distance(i, nearest[i])),
            sigma: self.truth.sigma.map(|_| get(SIGMA).item().to_f64()),
        }
    }
}

/// The mean of `term` over the vertices.
fn mean(term: impl Fn(usize) -> f64) -> f64 {
    (0..VERTEX_COUNT).map(term).sum::<f64>() / VERTEX_COUNT as f64
}

/// The distance between two points, each given by its first three entries.
fn distance<T: Scalar>(a: &[T], b: &[f64]) -> f64 {
    (0..3).map(|axis| (a[axis].to_f64() - b[axis]).powi(2)).sum::<f64>().sqrt()
}

/// The distance between each vertex and each true one.
fn distances<T: Scalar>(vertices: &[T], truth: &[f64]) -> [[f64; VERTEX_COUNT]; VERTEX_COUNT] {
    let to = |i: usize| std::array::from_fn(|j| distance(&vertices[3 * i..], &truth[3 * j..]));
    std::array::from_fn(to)
}

/// Does the fit that `settings` describe; `on_step` sees every state before its update and the
/// final one, and may stop the fit.
///
/// # Errors
/// [`FitError::Setting`] for settings outside their range; what the operations and the optimizer
/// refuse.
pub fn run_cube(
    settings: &CubeSettings,
    on_step: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Outcome, FitError> {
    match settings.precision {
        Precision::F32 => run::<f32>(settings, on_step),
        Precision::F64 => run::<f64>(settings, on_step),
    }
}

fn run<T: Scalar>(
    settings: &CubeSettings,
    on_step: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Outcome, FitError> {
    if settings.preset == Preset::SecondOrder {
        return second_order::run::<T>(settings, on_step);
    }
    let (pipeline, parameters) = CubePipeline::<T>::new(settings)?;
    let mut fit = Fit::new(parameters, settings.fit_settings())?;
    drive(settings, pipeline, &mut fit, &mut |progress, _| on_step(progress))
}

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
        target_ms_per_step_median: history.target_ms_median(),
        wall_seconds,
        history: history.steps.iter().map(|step| record(settings, step)).collect(),
        snapshots,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes::Silhouettes;

    const EXPERIMENTS: [Experiment; 3] =
        [Experiment::Vertices, Experiment::Sigma, Experiment::Joint];

    fn settings(experiment: Experiment) -> CubeSettings {
        CubeSettings { resolution: 16, ..CubeSettings::new(experiment, Preset::Paper) }
    }

    fn run_quietly(settings: &CubeSettings) -> Outcome {
        run_cube(settings, &mut |_| ControlFlow::Continue(())).unwrap()
    }

    /// The pipeline of `settings`, with its parameters at the truth, permuted by `p`.
    fn at_truth<T: Scalar>(
        settings: &CubeSettings,
        p: &[usize],
    ) -> (CubePipeline<T>, Parameters<T>) {
        let (pipeline, mut parameters) = CubePipeline::<T>::new(settings).unwrap();
        let (vertices, colors, sigma) = pipeline.target_inputs.clone();
        let permuted = |tensor: Tensor<T>| {
            Tensor::from_flat_fn(tensor.shape(), |k| tensor.data()[3 * p[k / 3] + k % 3])
        };
        parameters.set_value(VERTICES, &permuted(vertices)).unwrap();
        parameters.set_value(COLORS, &permuted(colors)).unwrap();
        if let Some(sigma) = sigma {
            parameters.set_value(SIGMA, &Tensor::scalar(sigma)).unwrap();
        }
        (pipeline, parameters)
    }

    #[test]
    fn the_truth_has_loss_zero_and_gradients_exactly_zero() {
        for experiment in EXPERIMENTS {
            // Without a mapping, through which sigma would be rounded.
            let sigma_mapping = crate::Mapping::Identity;
            let settings = CubeSettings { sigma_mapping, ..settings(experiment) };
            let (mut pipeline, parameters) = at_truth::<f32>(&settings, &[0, 1, 2, 3, 4, 5, 6, 7]);
            pipeline.prepare(5).unwrap();
            let tape = Tape::new();
            let variables = parameters.record(&tape);
            let loss = pipeline.loss(&tape, &variables).unwrap();
            assert_eq!(loss.item(), 0.0, "{experiment}");
            let gradients = loss.backward().unwrap();
            for parameter in parameters.iter().filter(|parameter| !parameter.is_frozen()) {
                let gradient = gradients.get(variables.raw(parameter.name()).unwrap()).unwrap();
                assert!(gradient.data().iter().all(|&entry| entry == 0.0), "{experiment}");
            }
            let measure = pipeline.measure(&parameters);
            assert_eq!((measure.vertex_error, measure.color_error), (0.0, 0.0));
        }
    }

    #[test]
    fn every_automorphism_of_the_truth_is_a_minimum_and_counts_as_right() {
        let settings = settings(Experiment::Vertices);
        for p in automorphisms(&FACES, VERTEX_COUNT) {
            let (mut pipeline, parameters) = at_truth::<f64>(&settings, &p);
            let measure = pipeline.measure(&parameters);
            assert_eq!((measure.vertex_error, measure.color_error), (0.0, 0.0));
            let moved = p.iter().enumerate().any(|(i, &j)| i != j);
            assert_eq!(measure.vertex_error_plain > 0.1, moved);
            for step in 0..5 {
                pipeline.prepare(step).unwrap();
                let tape = Tape::new();
                let loss = pipeline.loss(&tape, &parameters.record(&tape)).unwrap();
                assert!(loss.item() < 1e-24, "{p:?} {}", loss.item());
            }
        }
    }

    #[test]
    fn a_permutation_that_is_no_automorphism_does_not_count_as_right() {
        let (pipeline, parameters) =
            at_truth::<f64>(&settings(Experiment::Vertices), &[1, 0, 2, 3, 4, 5, 6, 7]);
        let measure = pipeline.measure(&parameters);
        // Two of eight vertices are off by a side, and so are their colours.
        assert_eq!(measure.vertex_error_plain, 0.25);
        assert_eq!((measure.vertex_error, measure.color_error), (0.25, 0.25));
    }

    #[test]
    fn both_precisions_see_the_same_start_and_the_same_targets() {
        let settings = settings(Experiment::Joint);
        let (mut wide, wide_start) = CubePipeline::<f64>::new(&settings).unwrap();
        let (mut narrow, narrow_start) = CubePipeline::<f32>::new(&settings).unwrap();
        for (wide, narrow) in wide_start.iter().zip(narrow_start.iter()) {
            assert_eq!(wide.name(), narrow.name());
            let pairs = wide.raw().data().iter().zip(narrow.raw().data());
            assert!(
                pairs.into_iter().all(|(wide, narrow)| (wide - f64::from(*narrow)).abs() < 1e-7)
            );
        }
        for step in 0..5 {
            wide.prepare(step).unwrap();
            narrow.prepare(step).unwrap();
            assert_eq!(wide.view, narrow.view);
            let images = (wide.target().unwrap().data(), narrow.target().unwrap().data());
            let pairs = images.0.iter().zip(images.1);
            assert!(
                pairs.into_iter().all(|(wide, narrow)| (wide - f64::from(*narrow)).abs() < 1e-5)
            );
        }
    }

    #[test]
    fn each_experiment_learns_what_it_should_and_reports_what_applies() {
        for experiment in EXPERIMENTS {
            let (pipeline, parameters) = CubePipeline::<f32>::new(&settings(experiment)).unwrap();
            let learnt: Vec<_> =
                parameters.iter().filter(|parameter| !parameter.is_frozen()).collect();
            let learnt: Vec<_> = learnt.iter().map(|parameter| parameter.name()).collect();
            let expected: &[&str] = match experiment {
                Experiment::Vertices => &[VERTICES, COLORS],
                Experiment::Sigma => &[SIGMA],
                Experiment::Joint => &[VERTICES, COLORS, SIGMA],
            };
            assert_eq!(learnt, expected);
            assert_eq!(pipeline.moves, experiment != Experiment::Sigma);

            let outcome = run_quietly(&CubeSettings { steps: 3, ..settings(experiment) });
            assert_eq!(outcome.history.len(), 4);
            let cube = experiment != Experiment::Sigma;
            let sigma = experiment != Experiment::Vertices;
            for value in [
                outcome.vertex_error_initial,
                outcome.vertex_error_final,
                outcome.vertex_error_plain,
                outcome.vertex_error_tail,
                outcome.color_error_final,
                outcome.history[0].vertex_error,
                outcome.history[0].color_error,
            ] {
                assert_eq!(value.is_some(), cube);
            }
            for value in [outcome.sigma_target, outcome.sigma_final, outcome.history[0].sigma] {
                assert_eq!(value.is_some(), sigma);
            }
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_bits() {
        let settings = CubeSettings { steps: 30, ..settings(Experiment::Joint) };
        let [one, other] = [run_quietly(&settings), run_quietly(&settings)];
        assert_eq!(one.snapshots, other.snapshots);
        let losses = |outcome: &Outcome| -> Vec<u64> {
            outcome.history.iter().map(|record| record.loss.to_bits()).collect()
        };
        assert_eq!(losses(&one), losses(&other));
        let another = run_quietly(&CubeSettings { seed: 1, ..settings });
        assert_ne!(one.snapshots, another.snapshots);
    }

    #[test]
    fn a_callback_stops_a_fit_and_the_last_state_is_kept() {
        let settings = settings(Experiment::Vertices);
        let mut seen = Vec::new();
        let outcome = run_cube(&settings, &mut |progress| {
            seen.push(progress.step);
            if progress.step == 17 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        let outcome = outcome.unwrap();
        assert_eq!(seen, (0..=17).collect::<Vec<_>>());
        assert_eq!((outcome.steps, outcome.history.len()), (17, 18));
        let steps: Vec<u64> = outcome.snapshots.iter().map(|snapshot| snapshot.step).collect();
        assert!(steps.contains(&0) && steps.contains(&10));
        assert_eq!(steps.last(), Some(&17));
        assert!(steps.is_sorted());
    }

    #[test]
    fn sigma_is_found_from_either_side() {
        for (start, target) in [(2.0, 1.0), (2.0, 2.8)] {
            let settings = CubeSettings {
                steps: 1_000,
                sigma_start: start,
                sigma_target: target,
                precision: Precision::F64,
                ..settings(Experiment::Sigma)
            };
            let outcome = run_quietly(&settings);
            let error = (outcome.sigma_final.unwrap() - target).abs();
            assert!(error < 1e-4, "from {start} to {target}: {error}");
        }
    }

    #[test]
    fn a_fixed_target_is_rendered_once() {
        let (mut pipeline, _) = CubePipeline::<f32>::new(&settings(Experiment::Sigma)).unwrap();
        pipeline.prepare(0).unwrap();
        let first = pipeline.target().unwrap().data().as_ptr();
        pipeline.prepare(1).unwrap();
        assert_eq!(pipeline.target().unwrap().data().as_ptr(), first);
    }

    #[test]
    fn a_cube_is_learnt_in_a_thousand_steps() {
        for silhouettes in [Silhouettes::Antialias, Silhouettes::Exact] {
            let settings = CubeSettings {
                preset: Preset::Tuned,
                resolution: 32,
                steps: 1_000,
                silhouettes,
                precision: Precision::F64,
                ..settings(Experiment::Vertices)
            };
            let outcome = run_quietly(&settings);
            assert_eq!(outcome.silhouettes, silhouettes);
            assert!(outcome.vertex_error_initial.unwrap() > 0.3);
            let [vertices, colors] = [outcome.vertex_error_final, outcome.color_error_final];
            assert!(vertices.unwrap() < 1e-6, "{silhouettes}: {vertices:?}");
            assert!(colors.unwrap() < 1e-6, "{silhouettes}: {colors:?}");
            assert!(!outcome.is_stuck());
        }
    }
}
