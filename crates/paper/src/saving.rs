//! Fits of the cube that are saved and go on from a file.
//!
//! What the pipeline saves of itself are its settings: a pose is a function of the seed and the step.
//! A fit can so go on from its file alone, and a file of another experiment is refused.

use std::fmt;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use bokashi_core::Tape;
use bokashi_fit::saved::{Stored, precision_and_state, read};
use bokashi_fit::{
    Answer, Fit, FitError, FitSettings, Fitting, Listener, Parameters, Pipeline, Step, StepState,
    Stop,
};

use super::experiment::run_cube;
use super::first_order::{CubeFitting, record, run_to_end};
use super::outcome::{Outcome, Progress};
use super::pipeline::CubePipeline;
use super::settings::{CubeSettings, Precision, Preset};

/// Where a fit of the cube is saved, and what it goes on from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Saving {
    /// The file of an earlier fit to go on from; `None`: a new fit.
    pub resume: Option<PathBuf>,
    /// The file to save to at the end, whatever ended the run.
    pub save: Option<PathBuf>,
    /// Saves after so many updates each, too.
    pub every: Option<u64>,
}

/// Does the fit that `settings` describe as [`run_cube`](super::run_cube) does, from where and to
/// where `saving` says. The outcome's history and times are those of this run, its initial errors
/// those of the fit.
///
/// # Errors
/// As [`run_cube`](super::run_cube); as [`Fit::save`] and [`Fit::resume`]; [`FitError::Saved`] for
/// a file of other settings. Only `steps` may differ, where the schedule does not depend on it, and
/// be no fewer than those done: else [`FitError::Setting`], as for a preset that is not first-order.
pub fn run_cube_saving(
    settings: &CubeSettings,
    saving: &Saving,
    on_step: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Outcome, FitError> {
    if saving.is_free_of(settings)? {
        return run_cube(settings, on_step);
    }
    match settings.precision {
        Precision::F32 => run::<f32>(settings, saving, on_step),
        Precision::F64 => run::<f64>(settings, saving, on_step),
    }
}

impl Saving {
    /// Checks what [`run_cube_saving`] would refuse before its first step.
    ///
    /// # Errors
    /// As [`run_cube_saving`], but for those of steps and of writing.
    pub fn check(&self, settings: &CubeSettings) -> Result<(), FitError> {
        if self.is_free_of(settings)? {
            return settings.check();
        }
        match settings.precision {
            Precision::F32 => begin::<f32>(settings, self).map(drop),
            Precision::F64 => begin::<f64>(settings, self).map(drop),
        }
    }

    /// Whether the fit that `settings` describe is of a kind that cannot be saved, and is not to be.
    fn is_free_of(&self, settings: &CubeSettings) -> Result<bool, FitError> {
        if self.every == Some(0) {
            return Err(FitError::setting("a fit that is saved", "at least 1 step in between", 0));
        }
        if settings.preset != Preset::SecondOrder {
            return Ok(false);
        }
        if *self == Self::default() {
            return Ok(true);
        }
        let rule = "a first-order preset, whose whole state it holds";
        Err(FitError::setting("a fit that is saved", rule, settings.preset))
    }
}

/// The pipeline of `settings`, and the fit as it begins: new, or from a file.
fn begin<T: Stored>(
    settings: &CubeSettings,
    saving: &Saving,
) -> Result<(CubePipeline<T>, Fit<T>), FitError> {
    let (pipeline, parameters) = CubePipeline::<T>::new(settings)?;
    let fit = match &saving.resume {
        None => Fit::new(parameters, settings.fit_settings())?,
        Some(path) => resumed(settings, &parameters, path)?,
    };
    Ok((pipeline, fit))
}

fn run<T: Stored>(
    settings: &CubeSettings,
    saving: &Saving,
    on_step: &mut dyn FnMut(Progress) -> ControlFlow<()>,
) -> Result<Outcome, FitError> {
    let (mut pipeline, mut fit) = begin::<T>(settings, saving)?;
    let start = fit.steps_done();
    let mut checkpoint =
        saving.save.as_deref().map(|path| Checkpoint { path, every: saving.every, start });
    let listener =
        checkpoint.as_mut().map(|checkpoint| checkpoint as &mut dyn Listener<CubeFitting<'_, T>>);
    let mut outcome = run_to_end(settings, &mut pipeline, &mut fit, listener, on_step)?;
    if start > 0 {
        let first = initial::<T>(settings)?;
        outcome.loss_initial = first.loss;
        outcome.vertex_error_initial = record(settings, &first).vertex_error;
    }
    Ok(outcome)
}

/// Saves a fit to a file at its end, whatever ended it, and after every so many updates.
struct Checkpoint<'a> {
    path: &'a Path,
    every: Option<u64>,
    /// The updates that were done before.
    start: u64,
}

impl<T: Stored, P: Pipeline<T>> Listener<Fitting<'_, T, P>> for Checkpoint<'_> {
    fn before_update(&mut self, state: &StepState<'_, T, P::Measure>) -> Answer<FitError> {
        let step = state.step.step;
        if step > self.start && self.every.is_some_and(|every| step % every == 0) {
            state.save(self.path)?;
        }
        Ok(ControlFlow::Continue(()))
    }

    fn end(&mut self, fit: &Fitting<'_, T, P>, _stop: Stop) -> Result<(), FitError> {
        fit.fit().save(self.path)
    }
}

/// The fit in the file `path`, where it is that of `settings`, whose `start` is as a new fit's.
fn resumed<T: Stored>(
    settings: &CubeSettings,
    start: &Parameters<T>,
    path: &Path,
) -> Result<Fit<T>, FitError> {
    CubeSettings::saved_in(path)?.check_resumed_by(settings)?;
    let mut fit = Fit::<T>::resume(path)?;
    if settings.steps < fit.steps_done() {
        let given = format!("{} of {}", settings.steps, fit.steps_done());
        return Err(FitError::setting("steps", "no fewer than are already done", given));
    }
    fit.set_settings(FitSettings { steps: settings.steps, ..*fit.settings() })?;
    if *fit.settings() != settings.fit_settings() {
        let rule = "a schedule that does not depend on the number of steps, to go on for another";
        return Err(FitError::saved(rule, format!("{:?}", fit.settings().schedule)));
    }
    // The pipeline takes its parameters by name: a file made by hand might have others.
    let alike = fit.parameters().iter().len() == start.iter().len()
        && fit.parameters().iter().zip(start.iter()).all(|(saved, new)| saved.is_like(new));
    if !alike {
        let names: Vec<_> = fit.parameters().iter().map(|parameter| parameter.name()).collect();
        return Err(FitError::saved("the parameters of its experiment", format!("{names:?}")));
    }
    Ok(fit)
}

/// The first step of a new fit, before its update.
fn initial<T: Stored>(
    settings: &CubeSettings,
) -> Result<Step<<CubePipeline<T> as Pipeline<T>>::Measure>, FitError> {
    let (mut pipeline, parameters) = CubePipeline::<T>::new(settings)?;
    pipeline.prepare(0)?;
    let tape = Tape::new();
    let loss = pipeline.loss(&tape, &parameters.record(&tape))?.item().to_f64();
    Ok(Step { step: 0, seconds: 0.0, loss, measure: pipeline.measure(&parameters) })
}

impl CubeSettings {
    /// The settings of the fit that is saved in the file `path`.
    ///
    /// # Errors
    /// As [`Fit::resume`]; [`FitError::Saved`] for a fit of something else.
    pub fn saved_in(path: impl AsRef<Path>) -> Result<Self, FitError> {
        Self::of_saved(&read(path.as_ref())?)
    }

    /// The settings of the fit whose file's bytes are `file`.
    ///
    /// # Errors
    /// As [`CubeSettings::saved_in`].
    pub fn of_saved(file: &[u8]) -> Result<Self, FitError> {
        let (precision, state) = precision_and_state(file)?;
        let settings = Self::restored(state.unwrap_or_default())?;
        if settings.precision.to_string() != precision {
            let rule = format!("the precision of its numbers, {precision}, in its settings");
            return Err(FitError::saved(rule, settings.precision));
        }
        Ok(settings)
    }

    /// The settings as they are saved: a JSON object.
    pub(super) fn saved(&self) -> Vec<u8> {
        serde_json::to_vec(self).expect("settings are words and numbers")
    }

    /// What [`CubeSettings::saved`] returned.
    pub(super) fn restored(state: &[u8]) -> Result<Self, FitError> {
        let foreign = |error| FitError::saved("a fit of the cube, with its settings", error);
        let settings: Self = serde_json::from_slice(state).map_err(foreign)?;
        for check in [settings.optimizer.check(), settings.rate_schedule().check()] {
            check?;
        }
        settings.check()?;
        Ok(settings)
    }

    /// Checks that a fit saved with these settings can go on with `others`: that nothing but the
    /// number of steps differs.
    pub(super) fn check_resumed_by(&self, others: &Self) -> Result<(), FitError> {
        fn same<V: PartialEq + fmt::Debug>(
            what: &str,
            saved: &V,
            given: &V,
        ) -> Result<(), FitError> {
            if saved == given {
                return Ok(());
            }
            let rule = format!("the {what} of the fit that resumes it, {given:?}");
            Err(FitError::saved(rule, format!("{saved:?}")))
        }
        same("experiment", &self.experiment, &others.experiment)?;
        same("preset", &self.preset, &others.preset)?;
        same("resolution", &self.resolution, &others.resolution)?;
        same("target sigma", &self.sigma_target, &others.sigma_target)?;
        same("kernel", &self.kernel, &others.kernel)?;
        same("seed", &self.seed, &others.seed)?;
        same("silhouettes", &self.silhouettes, &others.silhouettes)?;
        same("precision", &self.precision, &others.precision)?;
        // Whatever else there is, and may come.
        same("settings", self, &Self { steps: self.steps, ..others.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Silhouettes;
    use crate::run_cube;
    use crate::settings::{Experiment, Rates};
    use bokashi_fit::Mapping;
    use bokashi_fit::Optimizer;
    use bokashi_fit::Schedule;
    use bokashi_render_ops::{Border, Kernel, Radius};

    const EXPERIMENTS: [Experiment; 3] =
        [Experiment::Vertices, Experiment::Sigma, Experiment::Joint];
    const SILHOUETTES: [Silhouettes; 3] =
        [Silhouettes::Aliased, Silhouettes::Antialias, Silhouettes::Exact];
    const PRECISIONS: [Precision; 2] = [Precision::F32, Precision::F64];
    const KERNELS: [Kernel; 4] =
        [Kernel::Unnormalized, Kernel::Sampled, Kernel::Discrete, Kernel::Disc];
    const BORDERS: [Border; 3] = [Border::Zero, Border::Mirror, Border::Clamp];

    fn settings(experiment: Experiment, preset: Preset) -> CubeSettings {
        CubeSettings { resolution: 12, steps: 30, seed: 5, ..CubeSettings::new(experiment, preset) }
    }

    fn run(settings: &CubeSettings, saving: &Saving, until: u64) -> Result<Outcome, FitError> {
        run_cube_saving(settings, saving, &mut |progress| match progress.step >= until {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        })
    }

    /// The bits of all numbers of the history from `step` on.
    fn bits(outcome: &Outcome, step: u64) -> Vec<[Option<u64>; 4]> {
        let records = outcome.history.iter().filter(|record| record.step >= step);
        let numbers = |record: &crate::Record| {
            [Some(record.loss), record.vertex_error, record.sigma, record.color_error]
        };
        records.map(|record| numbers(record).map(|number| number.map(f64::to_bits))).collect()
    }

    #[test]
    fn an_interrupted_fit_goes_on_to_the_same_bits() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cube");
        for experiment in EXPERIMENTS {
            for preset in [Preset::Paper, Preset::Tuned] {
                for precision in PRECISIONS {
                    for (optimizer, silhouettes) in [
                        (Optimizer::default(), Silhouettes::Antialias),
                        (Optimizer::ams_grad(), Silhouettes::Exact),
                    ] {
                        let settings = settings(experiment, preset);
                        let settings =
                            CubeSettings { precision, optimizer, silhouettes, ..settings };
                        let whole = run_cube(&settings, &mut |_| ControlFlow::Continue(()));
                        let whole = whole.unwrap();
                        let to = Saving { save: Some(file.clone()), ..Saving::default() };
                        let first = run(&settings, &to, 13).unwrap();
                        assert_eq!(first.steps, 13);
                        assert_eq!(CubeSettings::saved_in(&file).as_ref(), Ok(&settings));
                        let from = Saving { resume: Some(file.clone()), ..Saving::default() };
                        let rest = run(&settings, &from, u64::MAX).unwrap();
                        assert_eq!(bits(&rest, 0), bits(&whole, 13));
                        assert_eq!(rest.snapshots.last(), whole.snapshots.last());
                        assert_eq!(rest.loss_initial, whole.loss_initial);
                        assert_eq!(rest.vertex_error_initial, whole.vertex_error_initial);
                        let late = whole.snapshots.iter().filter(|snapshot| snapshot.step >= 13);
                        assert!(late.eq(&rest.snapshots));
                    }
                }
            }
        }
    }

    #[test]
    fn a_fit_is_saved_as_often_as_asked_and_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cube");
        let settings = settings(Experiment::Joint, Preset::Paper);
        let saving = Saving { save: Some(file.clone()), every: Some(8), ..Saving::default() };
        let steps_in = |file: &Path| Fit::<f32>::resume(file).unwrap().steps_done();
        let mut seen = Vec::new();
        run_cube_saving(&settings, &saving, &mut |_| {
            seen.push(file.exists().then(|| steps_in(&file)));
            ControlFlow::Continue(())
        })
        .unwrap();
        let expected: Vec<_> =
            (0..=30).map(|step| Some(step / 8 * 8).filter(|&step| step > 0)).collect();
        assert_eq!(seen, expected);
        assert_eq!(steps_in(&file), 30);
        let never = Saving { every: Some(0), ..saving };
        let error = run(&settings, &never, 0).unwrap_err().to_string();
        assert_eq!(error, "a fit that is saved needs at least 1 step in between, got 0");
    }

    #[test]
    fn a_fit_can_be_made_longer_where_its_schedule_does_not_depend_on_its_length() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cube");
        let to = Saving { save: Some(file.clone()), ..Saving::default() };
        let from = Saving { resume: Some(file.clone()), ..Saving::default() };
        let long = settings(Experiment::Joint, Preset::Paper);
        run(&CubeSettings { steps: 11, ..long.clone() }, &to, u64::MAX).unwrap();
        let rest = run(&long, &from, u64::MAX).unwrap();
        let whole = run_cube(&long, &mut |_| ControlFlow::Continue(())).unwrap();
        assert_eq!(bits(&rest, 0), bits(&whole, 11));
        let fewer = run(&CubeSettings { steps: 10, ..long }, &from, u64::MAX).unwrap_err();
        let rule = "steps needs no fewer than are already done, got 10 of 11";
        assert_eq!(fewer.to_string(), rule);

        let long = settings(Experiment::Joint, Preset::Tuned);
        run(&CubeSettings { steps: 11, ..long.clone() }, &to, u64::MAX).unwrap();
        let error = run(&long, &from, u64::MAX).unwrap_err().to_string();
        assert!(
            error.starts_with("a saved fit needs a schedule that does not depend on"),
            "{error}"
        );
    }

    #[test]
    fn a_file_of_other_settings_is_refused_with_the_first_that_differs() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cube");
        let ours = settings(Experiment::Joint, Preset::Paper);
        run(&ours, &Saving { save: Some(file.clone()), ..Saving::default() }, 3).unwrap();
        let from = Saving { resume: Some(file), ..Saving::default() };
        let table = [
            (
                CubeSettings { seed: 6, ..ours.clone() },
                "the seed of the fit that resumes it, 6, got 5",
            ),
            (CubeSettings { resolution: 8, ..ours.clone() }, "resumes it, 8, got 12"),
            (
                CubeSettings { precision: Precision::F64, ..ours.clone() },
                "resumes it, F64, got F32",
            ),
            (CubeSettings { sigma_target: 1.0, ..ours.clone() }, "resumes it, 1.0, got 4.0"),
            (
                CubeSettings { silhouettes: Silhouettes::Exact, ..ours.clone() },
                "the silhouettes of the fit that resumes it, Exact, got Antialias",
            ),
        ];
        for (settings, message) in table {
            let error = run(&settings, &from, 5).unwrap_err().to_string();
            assert!(error.ends_with(message), "{error}");
        }
        let mirror = CubeSettings { border: Border::Mirror, ..ours };
        let error = run(&mirror, &from, 5).unwrap_err().to_string();
        assert!(error.starts_with("a saved fit needs the settings of the fit that"), "{error}");
    }

    #[test]
    fn settings_of_every_kind_come_back_from_their_bytes() {
        let mut settings = settings(Experiment::Sigma, Preset::Tuned);
        for k in 0..6 {
            settings.kernel = KERNELS[k % 4];
            settings.border = BORDERS[k / 2];
            settings.sigma_mapping = [Mapping::Identity, Mapping::Softplus, Mapping::Exp][k % 3];
            settings.seed = u64::MAX - k as u64;
            settings.silhouettes = SILHOUETTES[k / 2];
            settings.rates =
                (k % 2 == 0).then_some(Rates { vertices: 0.1, colors: 0.2, sigma: 0.3 });
            settings.schedule = (k > 2).then_some(Schedule::Step { steps: 9, factor: 0.5 });
            settings.radius = [None, Some(Radius::Fixed(7)), Some(Radius::Tolerance(1e-3))][k % 3];
            let state = settings.saved();
            assert_eq!(CubeSettings::restored(&state).as_ref(), Ok(&settings));
            for length in 0..state.len() {
                assert!(CubeSettings::restored(&state[..length]).is_err());
            }
        }
        let huge = CubeSettings { resolution: usize::MAX, ..settings };
        let state = huge.saved();
        let error = CubeSettings::restored(&state).unwrap_err().to_string();
        assert!(error.starts_with("resolution needs at most 4096 pixels"), "{error}");
        for state in [&b"something"[..], b"{}", b"", b"{\"experiment\":\"sphere\"}"] {
            let error = CubeSettings::restored(state).unwrap_err().to_string();
            let rule = "a saved fit needs a fit of the cube, with its settings, got ";
            assert!(error.starts_with(rule), "{error}");
        }
    }
}
