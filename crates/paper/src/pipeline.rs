//! The cube as a [`Pipeline`], and its error against the truth.
//!
//! # The error against the truth
//! `min over p of mean over i of |v_i - truth_p(i)|`, over the 24 automorphisms `p` of the
//! triangulation, each of which is an exact minimum of the loss; the colours' error is under the
//! same `p`.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::{FitError, Parameter, Parameters, Pipeline, Variables};
use bokashi_render_ops::{Blur, PixelLoss};

use super::automorphism::automorphisms;
use super::cube::{FACES, VERTEX_COUNT, View, random_start, truth};
use super::outcome::Snapshot;
use super::scene::Scene;
use super::settings::{CubeSettings, Experiment};

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
    /// As they are saved, for each step's state.
    saved_settings: Vec<u8>,
    moves: bool,
    view: View,
    truth: Snapshot,
    /// The truth in `T`: vertices, colours, sigma.
    target_inputs: (Tensor<T>, Tensor<T>, Option<T>),
    target: Option<PixelLoss<T>>,
    /// The background, `[3]`.
    black: Tensor<T>,
    /// Of targets that no fit prepares.
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
            saved_settings: settings.saved(),
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
            black: Tensor::zeros([3]),
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
        self.target.as_ref().map(PixelLoss::reference)
    }
}

impl<T: Scalar> Pipeline<T> for CubePipeline<T> {
    type Measure = CubeMeasure;

    fn save_state(&self, state: &mut Vec<u8>) {
        // A pose is a function of the seed and the step: the generator has no other state.
        state.extend_from_slice(&self.saved_settings);
    }

    fn restore_state(&mut self, state: &[u8]) -> Result<(), FitError> {
        CubeSettings::restored(state)?.check_resumed_by(&self.settings)
    }

    fn prepare(&mut self, step: u64) -> Result<(), FitError> {
        let tape = std::mem::take(&mut self.target_tape);
        let prepared = self.prepare_on(step, &tape);
        self.target_tape = tape;
        prepared
    }

    fn prepare_on(&mut self, step: u64, tape: &Tape<T>) -> Result<(), FitError> {
        if self.moves {
            self.view = View::random(self.settings.seed, step);
        } else if self.target.is_some() {
            return Ok(());
        }
        if let Some(image) = self.target.take().and_then(PixelLoss::into_reference) {
            tape.recycle(image);
        }
        let camera = self.view.camera();
        let image = tape.aside(|tape| -> Result<_, FitError> {
            let (vertices, colors, sigma) = &self.target_inputs;
            let (vertices, colors) = (tape.constant(vertices), tape.constant(colors));
            let sigma = sigma.map(|sigma| tape.constant_scalar(sigma));
            Ok(self.scene.image(&camera, vertices, colors, sigma)?.value())
        })?;
        self.target = Some(PixelLoss::squared(&image, &self.black)?);
        Ok(())
    }

    fn loss<'t>(
        &mut self,
        _tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        let (vertices, colors) = (variables.get(VERTICES)?, variables.get(COLORS)?);
        let camera = self.view.camera();
        let target = self.target.as_ref().expect("a step is prepared before its loss is recorded");
        let sigma = self.target_inputs.2.map(|_| variables.get(SIGMA)).transpose()?;
        self.scene.loss(&camera, vertices, colors, sigma, target)
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

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::*;
    use crate::{Preset, run_cube};

    const EXPERIMENTS: [Experiment; 3] =
        [Experiment::Vertices, Experiment::Sigma, Experiment::Joint];

    fn settings(experiment: Experiment) -> CubeSettings {
        CubeSettings { resolution: 16, ..CubeSettings::new(experiment, Preset::Paper) }
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
            let sigma_mapping = bokashi_fit::Mapping::Identity;
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

            let outcome = run_cube(&CubeSettings { steps: 3, ..settings(experiment) }, &mut |_| {
                ControlFlow::Continue(())
            })
            .unwrap();
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
    fn a_fixed_target_is_rendered_once() {
        let (mut pipeline, _) = CubePipeline::<f32>::new(&settings(Experiment::Sigma)).unwrap();
        pipeline.prepare(0).unwrap();
        let first = pipeline.target().unwrap().data().as_ptr();
        pipeline.prepare(1).unwrap();
        assert_eq!(pipeline.target().unwrap().data().as_ptr(), first);
    }
}
