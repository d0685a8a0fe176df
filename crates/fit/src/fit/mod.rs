//! A fit: the parameters, the state of the optimizer, and the steps between them.
//!
//! A step prepares the pipeline and records its loss. Unless a rule stops the fit, it then runs backward and
//! updates the parameters. A history has the state of each step before its update. So its first entry is the
//! start of the fit, and its last entry the end, which no update follows.

mod diagnosis;
mod drive;
mod listeners;
mod settings;
#[cfg(feature = "save")]
mod state;
mod step;
#[cfg(test)]
mod tests;

use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_core::{Scalar, Tape};

use self::diagnosis::{all_below, check_ways, record_loss, with_origin};
pub use self::drive::{Answer, Listener, Observer, Rules, Steps, drive};
pub use self::listeners::{AfterStep, BeforeUpdate, Every, after_step, before_update, every};
pub use self::settings::FitSettings;
#[cfg(feature = "save")]
pub(crate) use self::state::LoopState;
#[cfg(feature = "save")]
use self::state::PipelineState;
pub use self::step::{StepState, Stepped};
use crate::communicator::Communicator;
use crate::error::FitError;
use crate::history::{History, Step};
use crate::parameter::Parameters;
use crate::pipeline::Pipeline;
use crate::stopping::{Losses, Stop};

/// A fit under way: the parameters, the state of the optimizer and a tape.
#[derive(Debug)]
pub struct Fit<T: Scalar> {
    tape: Tape<T>,
    parameters: Parameters<T>,
    settings: FitSettings,
    step: u64,
    /// The losses of the present run, until it ends.
    losses: Losses,
    /// Whether the loss is known to depend on every parameter.
    is_checked: bool,
    /// The pipeline's state before the preparation of the step.
    #[cfg(feature = "save")]
    pipeline: PipelineState,
    /// Milliseconds to recycle the last step's memory, counted to the next step.
    reset_ms: f64,
}

impl<T: Scalar> Fit<T> {
    /// Makes a fit that starts from `parameters`.
    ///
    /// # Errors
    /// [`FitError::Setting`] for settings outside their range.
    pub fn new(parameters: Parameters<T>, settings: FitSettings) -> Result<Self, FitError> {
        settings.check()?;
        Ok(Self {
            tape: Tape::new(),
            parameters,
            settings,
            step: 0,
            losses: Losses::default(),
            is_checked: false,
            #[cfg(feature = "save")]
            pipeline: PipelineState::default(),
            reset_ms: 0.0,
        })
    }

    /// The fit of `parameters` with the saved `loop_state`.
    #[cfg(feature = "save")]
    pub(crate) fn restored(
        parameters: Parameters<T>,
        loop_state: LoopState<'_>,
    ) -> Result<Self, FitError> {
        let known = loop_state.pipeline;
        let pipeline = PipelineState {
            bytes: known.unwrap_or_default().to_vec(),
            is_known: known.is_some(),
            is_due: known.is_some(),
        };
        let LoopState { settings, step, losses, .. } = loop_state;
        // It was checked when it started; what is optional is not saved.
        Ok(Self { step, losses, is_checked: true, pipeline, ..Self::new(parameters, settings)? })
    }

    /// The state of the fit besides its parameters.
    #[cfg(feature = "save")]
    pub(crate) fn loop_state(&self) -> LoopState<'_> {
        let Self { settings, step, losses, pipeline, .. } = self;
        LoopState { settings: *settings, step: *step, losses: *losses, pipeline: pipeline.known() }
    }

    /// The settings.
    pub fn settings(&self) -> &FitSettings {
        &self.settings
    }

    /// Goes on with other settings. All steps count from the start of the fit, those of the schedule too: after
    /// 200 steps, a cosine over 400 steps begins with half of the rates.
    ///
    /// # Errors
    /// [`FitError::Setting`] for settings outside their range.
    pub fn set_settings(&mut self, settings: FitSettings) -> Result<(), FitError> {
        settings.check()?;
        self.settings = settings;
        Ok(())
    }

    /// Keeps the present state of `pipeline`, to be saved with the fit before its next step. Each step does so;
    /// call this after changes between steps, and before the first step.
    #[cfg(feature = "save")]
    pub fn keep_state(&mut self, pipeline: &impl Pipeline<T>) {
        self.pipeline.save(pipeline);
    }

    /// The parameters.
    pub fn parameters(&self) -> &Parameters<T> {
        &self.parameters
    }

    /// The parameters, which may be changed between steps.
    pub fn parameters_mut(&mut self) -> &mut Parameters<T> {
        &mut self.parameters
    }

    /// The parameters; the fit ends.
    pub fn into_parameters(self) -> Parameters<T> {
        self.parameters
    }

    /// The tape, for its timings and its report.
    pub fn tape(&self) -> &Tape<T> {
        &self.tape
    }

    /// The number of updates done.
    pub fn steps_done(&self) -> u64 {
        self.step
    }

    /// Does one step, without regard to rules that stop the fit.
    ///
    /// # Errors
    /// - Those of the pipeline.
    /// - [`FitError::NotFinite`] where the loss or a gradient is infinite or NaN. If the value of a parameter is
    ///   so, the error names it.
    /// - [`FitError::NoInfluence`] in the first step, where the loss does not depend on a parameter that is neither
    ///   frozen nor optional.
    ///
    /// Parameters and moments are then as they were.
    pub fn step<P: Pipeline<T>>(&mut self, pipeline: &mut P) -> Result<Stepped, FitError> {
        let preparation_ms = self.prepare(pipeline)?;
        match self.advance(pipeline, None, |_, _, _| ControlFlow::Continue(()))? {
            ControlFlow::Continue(stepped) => {
                self.losses = Losses::default();
                #[cfg(feature = "save")]
                self.pipeline.save(pipeline);
                Ok(Stepped { preparation_ms, ..stepped })
            }
            ControlFlow::Break(_) => unreachable!("no rule was given"),
        }
    }

    /// Does steps until a rule of the settings stops the fit.
    ///
    /// # Errors
    /// As [`Fit::step`].
    pub fn run<P: Pipeline<T>>(
        &mut self,
        pipeline: &mut P,
    ) -> Result<History<P::Measure>, FitError> {
        let mut history = History::with_room_for(self.settings.steps.saturating_sub(self.step));
        self.drive(pipeline, &Rules::default(), &mut [&mut history])?;
        Ok(history)
    }

    /// Does steps until a rule of the settings, one of `rules` or a listener stops the fit: see [`drive`]. Listeners
    /// see every state before its update, and the final state where a rule of the settings stops the fit. After a
    /// listener stopped a drive, the next drive shows the same state again and goes on.
    ///
    /// ```
    /// use bokashi_core::Tensor;
    /// use bokashi_fit::{Fit, FitSettings, Parameter, Parameters, Rules, Stop, StepState};
    /// use bokashi_fit::{before_update, from_fn};
    /// use std::ops::ControlFlow;
    ///
    /// let x = Parameter::new("x", Tensor::scalar(3.0)).rate(0.1);
    /// let mut fit = Fit::<f64>::new(Parameters::new().with(x)?, FitSettings::default())?;
    /// let mut losses = Vec::new();
    /// let mut curve = before_update(|state: &StepState<'_, f64, ()>| {
    ///     losses.push(state.step.loss);
    ///     ControlFlow::Continue(())
    /// });
    /// let mut square = from_fn(|_tape, variables| Ok(variables.get("x")?.square()));
    /// let rules = Rules { steps: Some(20), ..Rules::default() };
    /// assert_eq!(fit.drive(&mut square, &rules, &mut [&mut curve])?, Stop::Steps);
    /// assert_eq!(losses.len(), 20);
    /// # Ok::<(), bokashi_fit::FitError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Fit::step`], and those of listeners.
    pub fn drive<'a, P: Pipeline<T>>(
        &'a mut self,
        pipeline: &'a mut P,
        rules: &Rules<'_>,
        listeners: &mut [&mut dyn Listener<Fitting<'a, T, P>>],
    ) -> Result<Stop, FitError> {
        let mut fitting = Fitting { fit: self, pipeline, start: Instant::now(), ms: 0.0 };
        drive(&mut fitting, rules, listeners)
    }

    /// Prepares the next step. Returns the milliseconds taken.
    fn prepare<P: Pipeline<T>>(&mut self, pipeline: &mut P) -> Result<f64, FitError> {
        // Here and not at the end: whatever ended the last step, its values are let go, the target
        // image among them.
        let start = Instant::now();
        self.tape.reset();
        self.reset_ms = milliseconds_since(start);
        let start = Instant::now();
        #[cfg(feature = "save")]
        if self.pipeline.is_due {
            pipeline.restore_state(&self.pipeline.bytes)?;
            self.pipeline.is_due = false;
        } else {
            self.pipeline.save(pipeline);
        }
        pipeline.prepare_on(self.step, &self.tape)?;
        Ok(milliseconds_since(start))
    }

    /// Does the rest of a step. `observe` is called before the update, and is not timed.
    fn advance<P: Pipeline<T>>(
        &mut self,
        pipeline: &mut P,
        gradient_below: Option<f64>,
        observe: impl FnOnce(&P, &Parameters<T>, f64) -> ControlFlow<Stop>,
    ) -> Result<ControlFlow<Stop, Stepped>, FitError> {
        let Self { tape, parameters, settings, step, is_checked, reset_ms, .. } = self;
        let start = Instant::now();
        let variables = parameters.record(tape);
        let loss = record_loss(pipeline, tape, parameters, &variables)?;
        let value = loss.item().to_f64();
        let forward_ms = milliseconds_since(start);
        if let ControlFlow::Break(stop) = observe(pipeline, parameters, value) {
            return Ok(ControlFlow::Break(stop));
        }

        let start = Instant::now();
        let gradients = loss.backward()?;
        if !std::mem::replace(is_checked, true) {
            check_ways(parameters, &variables, loss)?;
        }
        if gradient_below.is_some_and(|limit| all_below(limit, &variables, &gradients)) {
            return Ok(ControlFlow::Break(Stop::GradientBelow));
        }
        let factor = settings.schedule.factor(*step);
        let updated = settings.optimizer.update(parameters, &variables, &gradients, factor);
        updated.map_err(|error| with_origin(error, loss))?;
        drop(gradients);
        let ms = *reset_ms + forward_ms + milliseconds_since(start);
        let vanished = parameters.list.iter().map(|parameter| parameter.vanished).sum();
        let stepped = Stepped { step: *step, loss: value, ms, preparation_ms: 0.0, vanished };
        *step += 1;
        Ok(ControlFlow::Continue(stepped))
    }
}

/// A fit and its pipeline, which [`Fit::drive`] steps.
#[derive(Debug)]
pub struct Fitting<'a, T: Scalar, P> {
    fit: &'a mut Fit<T>,
    pipeline: &'a mut P,
    start: Instant,
    /// Milliseconds of the last update.
    ms: f64,
}

impl<T: Scalar, P> Fitting<'_, T, P> {
    /// The fit.
    pub fn fit(&self) -> &Fit<T> {
        self.fit
    }

    /// The pipeline.
    pub fn pipeline(&self) -> &P {
        self.pipeline
    }
}

impl<T: Scalar, P: Pipeline<T>> Steps for Fitting<'_, T, P> {
    type Number = T;
    type Measure = P::Measure;
    type Error = FitError;

    fn steps_done(&self) -> u64 {
        self.fit.step
    }

    fn parameters(&self) -> &Parameters<T> {
        &self.fit.parameters
    }

    fn ranks(&self) -> &dyn Communicator<T> {
        self.pipeline.ranks()
    }

    fn step(
        &mut self,
        observer: &mut Observer<'_, T, P::Measure>,
    ) -> Result<ControlFlow<Stop, Stepped>, FitError> {
        let Self { fit, pipeline, start, ms } = self;
        let preparation_ms = fit.prepare(*pipeline)?;
        let (step, settings) = (fit.step, fit.settings);
        let mut losses = fit.losses;
        #[cfg(feature = "save")]
        let saved = std::mem::take(&mut fit.pipeline);
        let observe = |pipeline: &P, parameters: &Parameters<T>, loss: f64| {
            let seconds = start.elapsed().as_secs_f64();
            let measured = Step { step, seconds, loss, measure: pipeline.measure(parameters) };
            let state = StepState {
                step: &measured,
                parameters,
                ms: *ms,
                preparation_ms,
                #[cfg(feature = "save")]
                loop_state: Some(LoopState { settings, step, losses, pipeline: saved.known() }),
            };
            observer(&state)?;
            losses.count(loss);
            match settings.loss_rules().stop(&losses) {
                Some(stop) => ControlFlow::Break(stop),
                None if step >= settings.steps => ControlFlow::Break(Stop::Steps),
                None => ControlFlow::Continue(()),
            }
        };
        let advanced = fit.advance(*pipeline, settings.gradient_below, observe);
        #[cfg(feature = "save")]
        {
            fit.pipeline = saved;
        }
        let advanced = advanced?;
        match &advanced {
            // It goes on with this state, whose loss will be counted then.
            ControlFlow::Break(Stop::Callback) => {}
            ControlFlow::Break(_) => fit.losses = Losses::default(),
            ControlFlow::Continue(stepped) => (fit.losses, *ms) = (losses, stepped.ms),
        }
        Ok(advanced.map_continue(|stepped| Stepped { preparation_ms, ..stepped }))
    }
}

fn milliseconds_since(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}
