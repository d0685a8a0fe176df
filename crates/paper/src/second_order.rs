//! Fits of the cube that end with a second-order method.
//!
//! # Forward
//! First come the tuned rates, for [`FIRST_ORDER`] of the steps: far from the truth the image is not
//! smooth enough for curvature to say more than the slope. Then comes Levenberg-Marquardt, on
//! [`POSES`] new random poses per step. With `r = image - reference` over all of them, `A = J^T J`,
//! `g = J^T r`, the step is `-(A + lambda diag A)^-1 g`. It is kept if `sum r^2` falls on the same
//! poses; `lambda` then shrinks, else it grows. Poses are new, since a fixed set has local minima
//! where a pixel's nearest face changes. The truth is the minimum of every set.
//!
//! # The Jacobian
//! The image is linear in the colours: an image of eight channels, a channel per vertex, holds all
//! their columns. The columns of the vertices and of sigma's raw number are the tangents of images
//! over dual numbers, an image each. They are exact to rounding.
//!
//! # Cost
//! A step of Levenberg-Marquardt takes about as long as [`UPDATES_PER_STEP`] updates of Adam, and
//! stands for as many of the fit's steps. So a run of this preset takes about as long as a run of
//! another preset.
//!
//! # Source
//! Marquardt, *An algorithm for least-squares estimation of nonlinear parameters*, SIAM Journal on
//! Applied Mathematics 11(2), 1963, with its scaling by the diagonal.

use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_core::{ForwardDual, Scalar, Tensor};
use bokashi_fit::{
    Fit, FitError, History, Observer, Parameters, Pipeline as _, Rules, Step, StepState, Stepped,
    Steps, Stop, drive,
};

use super::cube::{VERTEX_COUNT, View};
use super::first_order::{Film, OnStep, outcome};
use super::outcome::Outcome;
use super::pipeline::{COLORS, CubeMeasure, CubePipeline, SIGMA, VERTICES};
use super::settings::{CubeSettings, Experiment, Preset};
use super::views::CubeViews;

/// The share of a run that is first-order.
const FIRST_ORDER: f64 = 0.5;
/// Poses per step: three see every vertex with near certainty, the fourth averages.
const POSES: u64 = 4;
/// How many updates of Adam take about as long as a step: lab/docs/stiff.md compares whole fits.
const UPDATES_PER_STEP: u64 = 150;
/// Marquardt's first `lambda`, and its factors after a good step and after a bad one.
const DAMPING: [f64; 3] = [1e-2, 0.1, 4.0];
/// Below this the damping is rounding.
const LEAST_DAMPING: f64 = 1e-14;

/// The settings of the first part.
fn first_part(settings: &CubeSettings) -> CubeSettings {
    let steps = (FIRST_ORDER * settings.steps as f64).round() as u64;
    CubeSettings { preset: Preset::Tuned, steps, ..settings.clone() }
}

/// Does the fit that `settings` describe, in two parts.
///
/// # Errors
/// As [`super::run_cube`].
pub(super) fn run<T: Scalar>(
    settings: &CubeSettings,
    on_step: &mut OnStep<'_>,
) -> Result<Outcome, FitError> {
    let start = Instant::now();
    let first = first_part(settings);
    let mut history = History::with_room_for(first.steps);
    let mut film = Film::new(settings, first.steps, on_step);
    let (mut pipeline, parameters) = CubePipeline::<T>::new(&first)?;
    let mut fit = Fit::new(parameters, first.fit_settings())?;
    // The state at the end of this part is the first one of the next.
    let rules = Rules { steps: Some(first.steps), ..Rules::default() };
    let stop = fit.drive(&mut pipeline, &rules, &mut [&mut history, &mut film])?;
    if stop == Stop::Steps {
        film.due = None;
        let mut rest = LevenbergMarquardt::new(settings, fit.parameters(), first.steps, start)?;
        drive(&mut rest, &Rules::default(), &mut [&mut history, &mut film])?;
    }
    Ok(outcome(settings, &history, film.snapshots, start.elapsed().as_secs_f64()))
}

/// The second part of a fit, under way.
struct LevenbergMarquardt<'a> {
    settings: &'a CubeSettings,
    /// For its errors against the truth.
    pipeline: CubePipeline<f64>,
    cube: Parameters<f64>,
    damping: f64,
    step: u64,
    /// When the first part began.
    start: Instant,
    /// Of the last step.
    ms: f64,
}

impl<'a> LevenbergMarquardt<'a> {
    /// The part of a fit that goes on with `learnt` after `step` steps.
    fn new<T: Scalar>(
        settings: &'a CubeSettings,
        learnt: &Parameters<T>,
        step: u64,
        start: Instant,
    ) -> Result<Self, FitError> {
        let (pipeline, mut cube) = CubePipeline::<f64>::new(settings)?;
        for parameter in learnt.iter() {
            cube.set_value(parameter.name(), &parameter.value().cast())?;
        }
        Ok(Self { settings, pipeline, cube, damping: DAMPING[0], step, start, ms: 0.0 })
    }
}

impl Steps for LevenbergMarquardt<'_> {
    type Number = f64;
    type Measure = CubeMeasure;
    type Error = FitError;

    fn steps_done(&self) -> u64 {
        self.step
    }

    fn parameters(&self) -> &Parameters<f64> {
        &self.cube
    }

    fn step(
        &mut self,
        observer: &mut Observer<'_, f64, CubeMeasure>,
    ) -> Result<ControlFlow<Stop, Stepped>, FitError> {
        let (settings, step) = (self.settings, self.step);
        let target = Instant::now();
        let views = CubeViews::new(settings, &views(settings, step))?;
        let preparation_ms = 1e3 * target.elapsed().as_secs_f64();
        let before = Instant::now();
        let residuals = squares(&views, &self.cube)?;
        let seconds = self.start.elapsed().as_secs_f64();
        // The loss of one view, as in the first part.
        let loss = residuals / views.count() as f64;
        let measured = Step { step, seconds, loss, measure: self.pipeline.measure(&self.cube) };
        let state = StepState::new(&measured, &self.cube, self.ms, preparation_ms);
        if let ControlFlow::Break(stop) = observer(&state) {
            return Ok(ControlFlow::Break(stop));
        }
        if step >= settings.steps {
            return Ok(ControlFlow::Break(Stop::Steps));
        }
        self.damping = improve(&mut self.cube, &views, residuals, self.damping)?;
        self.ms = 1e3 * before.elapsed().as_secs_f64();
        self.step = (step + UPDATES_PER_STEP).min(settings.steps);
        let (ms, vanished) = (self.ms, 0);
        Ok(ControlFlow::Continue(Stepped { step, loss, ms, preparation_ms, vanished }))
    }
}

/// The views of a step.
fn views(settings: &CubeSettings, step: u64) -> Vec<View> {
    match settings.experiment {
        Experiment::Sigma => vec![View::fixed()],
        Experiment::Vertices | Experiment::Joint => {
            (step..step + POSES).map(|step| View::random(settings.seed, step)).collect()
        }
    }
}

/// Moves `cube` by one damped step if that lowers the sum of squares, `before`; returns the next
/// damping.
fn improve(
    cube: &mut Parameters<f64>,
    views: &CubeViews,
    before: f64,
    damping: f64,
) -> Result<f64, FitError> {
    let (matrix, gradient) = normal_equations(views, cube)?;
    let [_, less, more] = DAMPING;
    let Some(step) = damped_step(matrix, &gradient, damping) else { return Ok(damping * more) };
    let moved = moved(cube, &step)?;
    // False for NaN; a sigma out of its range is refused.
    if squares(views, &moved).is_ok_and(|after| after < before) {
        *cube = moved;
        return Ok((damping * less).max(LEAST_DAMPING));
    }
    Ok(damping * more)
}

/// The sum of squared residuals.
fn squares(views: &CubeViews, cube: &Parameters<f64>) -> Result<f64, FitError> {
    let value = |name| cube.value(name);
    let sigma = views.blurs().then(|| value(SIGMA)).transpose()?;
    let mut sum = 0.0;
    for view in 0..views.count() {
        let residuals = views.residual(view, &value(VERTICES)?, &value(COLORS)?, sigma.as_ref())?;
        sum += residuals.data().iter().map(|r| r * r).sum::<f64>();
    }
    Ok(sum)
}

/// `cube` with its raw numbers moved by `step`, in the order of the parameters that are learnt.
fn moved(cube: &Parameters<f64>, step: &[f64]) -> Result<Parameters<f64>, FitError> {
    let mut moved = cube.clone();
    let mut rest = step.iter();
    for parameter in cube.iter().filter(|parameter| !parameter.is_frozen()) {
        let raw = parameter.raw().map(|raw| raw + rest.next().copied().unwrap_or(0.0));
        moved.set_raw(parameter.name(), raw)?;
    }
    Ok(moved)
}

/// `J^T J`, row-major, and `J^T r`, over the raw numbers of the parameters that are learnt.
fn normal_equations(
    views: &CubeViews,
    cube: &Parameters<f64>,
) -> Result<(Vec<f64>, Vec<f64>), FitError> {
    let learns = |name| cube.get(name).is_ok_and(|parameter| !parameter.is_frozen());
    let (vertices, colors) = (cube.value(VERTICES)?, cube.value(COLORS)?);
    let sigma = views.blurs().then(|| cube.get(SIGMA)).transpose()?;
    let sigma_value = sigma.map(|sigma| sigma.value());
    let shape = if learns(VERTICES) { 2 * 3 * VERTEX_COUNT } else { 0 };
    let n = shape + usize::from(learns(SIGMA));
    let (mut matrix, mut gradient) = (vec![0.0; n * n], vec![0.0; n]);
    let unit = Tensor::from_flat_fn([VERTEX_COUNT, VERTEX_COUNT], |k| {
        if k % (VERTEX_COUNT + 1) == 0 { 1.0 } else { 0.0 }
    });
    for view in 0..views.count() {
        let sigma_here = sigma_value.as_ref();
        let residual = views.residual(view, &vertices, &colors, sigma_here)?;
        // Each column of vertices or sigma as a whole; those of colours by vertex.
        let mut columns: Vec<(usize, Tensor<f64>)> = Vec::new();
        let mut shares = None;
        let dual_colors = colors.cast();
        let dual_sigma = sigma_value.as_ref().map(Tensor::cast);
        if shape > 0 {
            for k in 0..vertices.size() {
                let mut along = vertices.cast::<ForwardDual<f64>>();
                along.data_mut()[k].tangent = 1.0;
                let image = views.image(view, &along, &dual_colors, dual_sigma.as_ref())?;
                columns.push((k, image.tangents()));
            }
            shares = Some(views.image(view, &vertices, &unit, sigma_here)?);
        }
        if let Some(sigma) = sigma.filter(|sigma| !sigma.is_frozen()) {
            let moving = |raw| ForwardDual { value: raw, tangent: 1.0 };
            let along = sigma.raw().map(|raw| sigma.mapped_by().value(moving(raw)));
            let image = views.image(view, &vertices.cast(), &dual_colors, Some(&along))?;
            columns.push((shape, image.tangents()));
        }
        let mut row: Vec<(usize, f64)> = Vec::with_capacity(n);
        for (k, &r) in residual.data().iter().enumerate() {
            row.clear();
            let slopes = columns.iter().map(|(j, column)| (*j, column.data()[k]));
            row.extend(slopes.filter(|&(_, slope)| slope != 0.0));
            if let Some(shares) = &shares {
                let (pixel, channel) = (k / 3, k % 3);
                let shares = &shares.data()[pixel * VERTEX_COUNT..][..VERTEX_COUNT];
                let column = |v: usize| 3 * VERTEX_COUNT + 3 * v + channel;
                let slopes = shares.iter().enumerate().map(|(v, &share)| (column(v), share));
                row.extend(slopes.filter(|&(_, slope)| slope != 0.0));
            }
            for &(i, a) in &row {
                gradient[i] += a * r;
                let line = &mut matrix[i * n..][..n];
                row.iter().for_each(|&(j, b)| line[j] += a * b);
            }
        }
    }
    Ok((matrix, gradient))
}

/// `-(A + damping diag A)^-1 g` for the symmetric `matrix` A, by Cholesky's factors; `None` where
/// it is not positive definite: some parameter changes no pixel.
fn damped_step(mut matrix: Vec<f64>, gradient: &[f64], damping: f64) -> Option<Vec<f64>> {
    let n = gradient.len();
    for i in 0..n {
        matrix[i * n + i] *= 1.0 + damping;
    }
    // A = L L^T, L below the diagonal and on it.
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| matrix[i * n + k] * matrix[j * n + k]).sum();
            let rest = matrix[i * n + j] - dot;
            matrix[i * n + j] = if i == j {
                if rest <= 0.0 || !rest.is_finite() {
                    return None;
                }
                rest.sqrt()
            } else {
                rest / matrix[j * n + j]
            };
        }
    }
    let mut x: Vec<f64> = gradient.iter().map(|g| -g).collect();
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| matrix[i * n + k] * x[k]).sum();
        x[i] = (x[i] - dot) / matrix[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| matrix[k * n + i] * x[k]).sum();
        x[i] = (x[i] - dot) / matrix[i * n + i];
    }
    Some(x)
}

#[cfg(test)]
mod tests {
    use bokashi_core::Tape;

    use super::*;
    use crate::{Progress, run_cube};

    fn settings(experiment: Experiment) -> CubeSettings {
        let new = CubeSettings::new(experiment, Preset::SecondOrder);
        CubeSettings { resolution: 16, sigma_target: 1.4, seed: 5, ..new }
    }

    #[test]
    fn a_damped_step_is_the_one_worked_out_by_hand() {
        // [[4, 2], [2, 3]] has the inverse [[3, -2], [-2, 4]] / 8.
        let step = damped_step(vec![4.0, 2.0, 2.0, 3.0], &[1.0, 2.0], 0.0).unwrap();
        assert!((step[0] - 0.125).abs() < 1e-15 && (step[1] + 0.75).abs() < 1e-15, "{step:?}");
        // With a damping of 1 the diagonal doubles: [[8, 2], [2, 6]], of determinant 44.
        let step = damped_step(vec![4.0, 2.0, 2.0, 3.0], &[1.0, 2.0], 1.0).unwrap();
        assert!((step[0] + 2.0 / 44.0).abs() < 1e-15 && (step[1] + 14.0 / 44.0).abs() < 1e-15);
        assert_eq!(damped_step(vec![1.0, 2.0, 2.0, 1.0], &[1.0, 2.0], 0.0), None);
        assert_eq!(damped_step(vec![0.0], &[0.0], 1.0), None);
    }

    #[test]
    fn the_normal_equations_agree_with_the_tape() {
        for experiment in [Experiment::Vertices, Experiment::Sigma, Experiment::Joint] {
            let settings = settings(experiment);
            let (_, cube) = CubePipeline::<f64>::new(&settings).unwrap();
            let views = CubeViews::new(&settings, &views(&settings, 3)).unwrap();
            let (matrix, gradient) = normal_equations(&views, &cube).unwrap();
            let n = gradient.len();

            let tape = Tape::new();
            let variables = cube.record(&tape);
            let get = |name| variables.get(name).unwrap();
            let sigma = views.blurs().then(|| get(SIGMA));
            let residuals = views.residuals(get(VERTICES), get(COLORS), sigma).unwrap();
            let loss = residuals.square().sum();
            assert!((loss.item() - squares(&views, &cube).unwrap()).abs() < 1e-12 * loss.item());
            let gradients = loss.backward().unwrap();
            let learnt = cube.iter().filter(|parameter| !parameter.is_frozen());
            let exact: Vec<f64> = learnt
                .flat_map(|parameter| {
                    let raw = variables.raw(parameter.name()).unwrap();
                    gradients.get_or_zeros(raw).data().to_vec()
                })
                .collect();
            assert_eq!(exact.len(), n);
            let size = exact.iter().fold(0.0, |size: f64, g| size.max(g.abs()));
            for (g, exact) in gradient.iter().zip(&exact) {
                assert!((2.0 * g - exact).abs() < 1e-13 * size, "{experiment} {g} {exact}");
            }
            assert!((0..n * n).all(|k| matrix[k] == matrix[k % n * n + k / n]));
        }
    }

    #[test]
    fn the_parts_follow_one_another_and_end_at_the_last_step() {
        for (experiment, steps) in [(Experiment::Joint, 700), (Experiment::Sigma, 1)] {
            let settings = CubeSettings { steps, ..settings(experiment) };
            let mut seen = Vec::new();
            let outcome = run_cube(&settings, &mut |progress| {
                assert_eq!(progress.steps, steps);
                seen.push(progress.step);
                ControlFlow::Continue(())
            })
            .unwrap();
            let steps: Vec<u64> = outcome.history.iter().map(|record| record.step).collect();
            assert_eq!(seen, steps);
            assert!(steps.windows(2).all(|pair| pair[0] < pair[1]), "{steps:?}");
            assert_eq!(steps.last(), Some(&settings.steps));
            assert_eq!(outcome.preset, Preset::SecondOrder);
            let times: Vec<f64> = outcome.history.iter().map(|record| record.seconds).collect();
            assert!(times.windows(2).all(|pair| pair[0] <= pair[1]));
            let last = outcome.snapshots.last().map(|snapshot| snapshot.step);
            assert_eq!(last, Some(settings.steps));
        }
    }

    #[test]
    fn a_callback_can_stop_either_part() {
        let settings = CubeSettings { steps: 700, ..settings(Experiment::Vertices) };
        for stop in [100, 350, 500] {
            let outcome = run_cube(&settings, &mut |progress| {
                if progress.step >= stop {
                    ControlFlow::Break(())
                } else {
                    ControlFlow::Continue(())
                }
            })
            .unwrap();
            assert_eq!(outcome.steps, stop);
        }
    }

    #[test]
    fn what_is_not_first_order_is_not_saved() {
        let settings = settings(Experiment::Joint);
        let saving = crate::Saving { save: Some("fit".into()), ..Default::default() };
        let seen = &mut |_: Progress| ControlFlow::Continue(());
        let error = crate::run_cube_saving(&settings, &saving, seen).unwrap_err().to_string();
        let rule = "a fit that is saved needs a first-order preset, whose whole state it holds";
        assert_eq!(error, format!("{rule}, got second-order"));
    }
}
