//! The fit loop.
//!
//! A step prepares the pipeline, records its loss, and, unless a rule says stop, runs backward and
//! updates the parameters. What a history holds of a step is its state before the update, so its
//! first entry is where the fit started and its last is where it ended, of which no update followed.

mod diagnosis;
mod settings;
#[cfg(feature = "save")]
mod state;
#[cfg(test)]
mod tests;

use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_core::{Scalar, Tape};

use self::diagnosis::{all_below, check_ways, record_loss, with_origin};
pub use self::settings::FitSettings;
#[cfg(feature = "save")]
pub(crate) use self::state::LoopState;
#[cfg(feature = "save")]
use self::state::PipelineState;
use crate::error::FitError;
use crate::history::{History, Step, Stop, Vanished};
use crate::parameter::Parameters;
use crate::pipeline::Pipeline;

/// What a callback sees of a step, before its update.
#[derive(Debug)]
pub struct StepState<'a, T, M> {
    /// Step, seconds, loss and errors.
    pub step: &'a Step<M>,
    /// The parameters.
    pub parameters: &'a Parameters<T>,
    /// Milliseconds of the last update: forward, backward and optimizer; 0 before the first.
    pub ms: f64,
    /// What else there is to save.
    #[cfg(feature = "save")]
    pub(crate) loop_state: LoopState<'a>,
}

/// What a step driven by hand gives back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stepped {
    /// How many updates came before.
    pub step: u64,
    /// The loss before the update.
    pub loss: f64,
    /// Milliseconds of forward, backward and optimizer.
    pub ms: f64,
    /// Milliseconds of the preparation.
    pub preparation_ms: f64,
    /// How many entries of all parameters the update left as they were though it was not zero; by
    /// parameter: [`Parameter::vanished`](crate::Parameter::vanished).
    pub vanished: usize,
}

/// A fit under way: the parameters, the state of the optimizer and a tape.
#[derive(Debug)]
pub struct Fit<T: Scalar> {
    tape: Tape<T>,
    parameters: Parameters<T>,
    settings: FitSettings,
    step: u64,
    /// The least loss of a run that is not at its end, and its step.
    best: (f64, u64),
    /// Whether every parameter is known to have a way to the loss.
    is_checked: bool,
    /// The pipeline's state before the preparation of the step.
    #[cfg(feature = "save")]
    pipeline: PipelineState,
    /// What it took to recycle the last step's memory: part of the step that uses it.
    reset_ms: f64,
}

/// The least loss where there was none yet.
const NO_LOSS: f64 = f64::INFINITY;

/// How a step ended.
enum Advance {
    Updated(Stepped),
    Stopped(Stop),
}

impl<T: Scalar> Fit<T> {
    /// A fit that starts from `parameters`.
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
            best: (NO_LOSS, 0),
            is_checked: false,
            #[cfg(feature = "save")]
            pipeline: PipelineState::default(),
            reset_ms: 0.0,
        })
    }

    /// The fit of `parameters` that `loop_state` was saved of.
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
        let LoopState { settings, step, best, .. } = loop_state;
        // It was checked when it started; what is optional is not saved.
        Ok(Self { step, best, is_checked: true, pipeline, ..Self::new(parameters, settings)? })
    }

    /// What the fit is besides its parameters.
    #[cfg(feature = "save")]
    pub(crate) fn loop_state(&self) -> LoopState<'_> {
        let Self { settings, step, best, pipeline, .. } = self;
        LoopState { settings: *settings, step: *step, best: *best, pipeline: pipeline.known() }
    }

    /// The settings.
    pub fn settings(&self) -> &FitSettings {
        &self.settings
    }

    /// Goes on with other settings. Steps, those of the schedule too, count from the start of the fit: a
    /// cosine over 400 steps continues at step 200 with half of the rates, however short the last one was.
    ///
    /// # Errors
    /// [`FitError::Setting`] for settings outside their range.
    pub fn set_settings(&mut self, settings: FitSettings) -> Result<(), FitError> {
        settings.check()?;
        self.settings = settings;
        Ok(())
    }

    /// Keeps the state of `pipeline` as it is now for whoever saves the fit before its next step. A step
    /// keeps it by itself; this is for what changes between steps, and for a fit without any.
    #[cfg(feature = "save")]
    pub fn keep_state(&mut self, pipeline: &impl Pipeline<T>) {
        self.pipeline.save(pipeline);
    }

    /// The parameters.
    pub fn parameters(&self) -> &Parameters<T> {
        &self.parameters
    }

    /// The parameters, to be changed between steps.
    pub fn parameters_mut(&mut self) -> &mut Parameters<T> {
        &mut self.parameters
    }

    /// The parameters, the fit given up.
    pub fn into_parameters(self) -> Parameters<T> {
        self.parameters
    }

    /// The tape, to time its operations and to take its report.
    pub fn tape(&self) -> &Tape<T> {
        &self.tape
    }

    /// How many updates are done.
    pub fn steps_done(&self) -> u64 {
        self.step
    }

    /// Does one step, whatever the rules to stop say.
    ///
    /// # Errors
    /// - What the pipeline refuses.
    /// - [`FitError::NotFinite`] where the loss or a gradient is infinite or NaN. Where a parameter's
    ///   value is at fault, the error names that value.
    /// - [`FitError::NoWay`] in the first step, where a parameter that is neither frozen nor optional
    ///   has no way to the loss.
    ///
    /// Parameters and moments are then as they were.
    pub fn step<P: Pipeline<T>>(&mut self, pipeline: &mut P) -> Result<Stepped, FitError> {
        let preparation_ms = self.prepare(pipeline)?;
        match self.advance(pipeline, None, |_, _, _| ControlFlow::Continue(()))? {
            Advance::Updated(stepped) => {
                self.best = (NO_LOSS, self.step);
                #[cfg(feature = "save")]
                self.pipeline.save(pipeline);
                Ok(Stepped { preparation_ms, ..stepped })
            }
            Advance::Stopped(_) => unreachable!("no rule was given"),
        }
    }

    /// Steps until a rule says stop.
    ///
    /// # Errors
    /// As [`Fit::step`].
    pub fn run<P: Pipeline<T>>(
        &mut self,
        pipeline: &mut P,
    ) -> Result<History<P::Measure>, FitError> {
        self.run_with(pipeline, |_| ControlFlow::Continue(()))
    }

    /// Steps until a rule or `on_step` says stop. `on_step` sees every state before its update, and
    /// the final one. A run after one that `on_step` stopped goes on with it; it sees the state
    /// that it was stopped in again.
    ///
    /// # Errors
    /// As [`Fit::step`].
    pub fn run_with<P: Pipeline<T>>(
        &mut self,
        pipeline: &mut P,
        mut on_step: impl FnMut(&StepState<'_, T, P::Measure>) -> ControlFlow<()>,
    ) -> Result<History<P::Measure>, FitError> {
        let start = Instant::now();
        let settings = self.settings;
        let mut history = History::with_room_for(settings.steps.saturating_sub(self.step));
        let mut last_ms = 0.0;
        loop {
            let step = self.step;
            history.preparation_ms.push(self.prepare(pipeline)?);
            let steps = &mut history.steps;
            let mut best = self.best;
            #[cfg(feature = "save")]
            let saved = std::mem::take(&mut self.pipeline);
            let observe = |pipeline: &P, parameters: &Parameters<T>, loss: f64| {
                let seconds = start.elapsed().as_secs_f64();
                let measure = pipeline.measure(parameters);
                steps.push(Step { step, seconds, loss, measure });
                let seen = StepState {
                    step: &steps[steps.len() - 1],
                    parameters,
                    ms: last_ms,
                    #[cfg(feature = "save")]
                    loop_state: LoopState { settings, step, best, pipeline: saved.known() },
                };
                if on_step(&seen).is_break() {
                    return ControlFlow::Break(Stop::Callback);
                }
                if settings.loss_below.is_some_and(|limit| loss < limit) {
                    return ControlFlow::Break(Stop::LossBelow);
                }
                if loss < best.0 {
                    best = (loss, step);
                }
                if settings.patience.is_some_and(|patience| step - best.1 >= patience) {
                    return ControlFlow::Break(Stop::NoProgress);
                }
                if step >= settings.steps {
                    return ControlFlow::Break(Stop::Steps);
                }
                ControlFlow::Continue(())
            };
            let advanced = self.advance(pipeline, settings.gradient_below, observe);
            #[cfg(feature = "save")]
            {
                self.pipeline = saved;
            }
            self.best = best;
            match advanced? {
                Advance::Updated(stepped) => {
                    last_ms = stepped.ms;
                    history.step_ms.push(last_ms);
                    if stepped.vanished > 0 {
                        let list = self.parameters.list.iter().enumerate();
                        let list = list.filter(|(_, parameter)| parameter.vanished > 0);
                        history.vanished.extend(list.map(|(at, parameter)| Vanished {
                            step: stepped.step,
                            parameter: at,
                            entries: parameter.vanished,
                        }));
                    }
                }
                Advance::Stopped(stop) => {
                    history.stop = stop;
                    if stop != Stop::Callback {
                        self.best = (NO_LOSS, self.step);
                    }
                    return Ok(history);
                }
            }
        }
    }

    /// Prepares the next step; returns the milliseconds it took.
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

    /// Does the rest of a step; `observe` is asked before the update, and is not timed.
    fn advance<P: Pipeline<T>>(
        &mut self,
        pipeline: &mut P,
        gradient_below: Option<f64>,
        observe: impl FnOnce(&P, &Parameters<T>, f64) -> ControlFlow<Stop>,
    ) -> Result<Advance, FitError> {
        let Self { tape, parameters, settings, step, is_checked, reset_ms, .. } = self;
        let start = Instant::now();
        let variables = parameters.record(tape);
        let loss = record_loss(pipeline, tape, parameters, &variables)?;
        let value = loss.item().to_f64();
        let forward_ms = milliseconds_since(start);
        if let ControlFlow::Break(stop) = observe(pipeline, parameters, value) {
            return Ok(Advance::Stopped(stop));
        }

        let start = Instant::now();
        let gradients = loss.backward()?;
        if !std::mem::replace(is_checked, true) {
            check_ways(parameters, &variables, loss)?;
        }
        if gradient_below.is_some_and(|limit| all_below(limit, &variables, &gradients)) {
            return Ok(Advance::Stopped(Stop::GradientBelow));
        }
        let factor = settings.schedule.factor(*step);
        let updated = settings.optimizer.update(parameters, &variables, &gradients, factor);
        updated.map_err(|error| with_origin(error, loss))?;
        drop(gradients);
        let ms = *reset_ms + forward_ms + milliseconds_since(start);
        let vanished = parameters.list.iter().map(|parameter| parameter.vanished).sum();
        let stepped = Stepped { step: *step, loss: value, ms, preparation_ms: 0.0, vanished };
        *step += 1;
        Ok(Advance::Updated(stepped))
    }
}

fn milliseconds_since(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}
