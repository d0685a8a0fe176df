//! The fit loop.
//!
//! A step prepares the pipeline, records its loss, and, unless a rule says stop, runs backward and
//! updates the parameters. What a history holds of a step is its state before the update, so its
//! first entry is where the fit started and its last is where it ended, of which no update followed.

use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_core::{Dependence, Gradients, Scalar, Tape, TensorError, Var};

use crate::error::{FitError, Origin, Quantity};
use crate::history::{History, Step, Stop, Vanished};
use crate::optimizer::Optimizer;
use crate::parameter::{Parameters, Variables};
use crate::pipeline::Pipeline;
use crate::schedule::Schedule;

/// How to fit, and when to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FitSettings {
    /// The largest number of updates.
    pub steps: u64,
    /// How gradients change parameters.
    pub optimizer: Optimizer,
    /// How the learning rates change over the run.
    pub schedule: Schedule,
    /// Stops where the loss is below this.
    pub loss_below: Option<f64>,
    /// Stops where the loss has found no new minimum for so many steps. Where the pose changes
    /// from step to step, so does the loss: allow for it.
    pub patience: Option<u64>,
    /// Stops where every entry of the gradient (of the raw numbers) is smaller than this.
    pub gradient_below: Option<f64>,
}

/// A thousand steps of Adam at a constant rate, without a rule to stop earlier.
impl Default for FitSettings {
    fn default() -> Self {
        Self {
            steps: 1_000,
            optimizer: Optimizer::default(),
            schedule: Schedule::Constant,
            loss_below: None,
            patience: None,
            gradient_below: None,
        }
    }
}

impl FitSettings {
    pub(crate) fn check(&self) -> Result<(), FitError> {
        self.optimizer.check()?;
        self.schedule.check()?;
        let limits = [("loss limit", self.loss_below), ("gradient limit", self.gradient_below)];
        for (setting, limit) in limits {
            if let Some(limit) = limit.filter(|limit| limit.is_nan()) {
                return Err(FitError::setting(setting, "a number", limit));
            }
        }
        if self.patience == Some(0) {
            return Err(FitError::setting("patience", "at least 1 step", 0));
        }
        Ok(())
    }
}

/// What a callback sees of a step, before its update.
#[derive(Debug)]
pub struct Seen<'a, T, M> {
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

/// What a fit is besides its parameters.
#[cfg(feature = "save")]
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LoopState<'a> {
    pub(crate) settings: FitSettings,
    /// How many updates are done.
    pub(crate) step: u64,
    /// The least loss of the run so far, and its step.
    pub(crate) best: (f64, u64),
    /// The pipeline's state before the preparation of the step; `None` before the first.
    pub(crate) pipeline: Option<&'a [u8]>,
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
    pub target_ms: f64,
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

/// A pipeline's state, as it saved it last.
#[cfg(feature = "save")]
#[derive(Debug, Default)]
struct PipelineState {
    bytes: Vec<u8>,
    is_known: bool,
    /// Whether it is a resumed fit's, and the pipeline has still to take it back.
    is_due: bool,
}

#[cfg(feature = "save")]
impl PipelineState {
    fn save<T: Scalar>(&mut self, pipeline: &impl Pipeline<T>) {
        self.bytes.clear();
        pipeline.save_state(&mut self.bytes);
        self.is_known = true;
    }

    fn known(&self) -> Option<&[u8]> {
        self.is_known.then_some(&self.bytes)
    }
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

    /// Sets the largest number of updates, those already done included: a fit can so be made
    /// longer. A schedule stays as it is.
    pub fn set_steps(&mut self, steps: u64) {
        self.settings.steps = steps;
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
    /// What the pipeline refuses; [`FitError::NotFinite`] where the loss or a gradient is infinite
    /// or NaN (a value where the loss comes from one); [`FitError::NoWay`] in the first step, where
    /// a parameter that is neither frozen nor optional has no way to the loss. Parameters and
    /// moments are then as they were.
    pub fn step<P: Pipeline<T>>(&mut self, pipeline: &mut P) -> Result<Stepped, FitError> {
        let target_ms = self.prepare(pipeline)?;
        match self.advance(pipeline, None, |_, _| ControlFlow::Continue(()))? {
            Advance::Updated(stepped) => {
                self.best = (NO_LOSS, self.step);
                #[cfg(feature = "save")]
                self.pipeline.save(pipeline);
                Ok(Stepped { target_ms, ..stepped })
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
        mut on_step: impl FnMut(&Seen<'_, T, P::Measure>) -> ControlFlow<()>,
    ) -> Result<History<P::Measure>, FitError> {
        let start = Instant::now();
        let settings = self.settings;
        let mut history = History::with_room_for(settings.steps.saturating_sub(self.step));
        let mut last_ms = 0.0;
        loop {
            let step = self.step;
            history.target_ms.push(self.prepare(pipeline)?);
            let steps = &mut history.steps;
            let mut best = self.best;
            #[cfg(feature = "save")]
            let saved = std::mem::take(&mut self.pipeline);
            let measured = &*pipeline;
            let observe = |parameters: &Parameters<T>, loss: f64| {
                let seconds = start.elapsed().as_secs_f64();
                let measure = measured.measure(parameters);
                steps.push(Step { step, seconds, loss, measure });
                let seen = Seen {
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
        pipeline.prepare(self.step)?;
        Ok(milliseconds_since(start))
    }

    /// Does the rest of a step; `observe` is asked before the update, and is not timed.
    fn advance<P: Pipeline<T>>(
        &mut self,
        pipeline: &P,
        gradient_below: Option<f64>,
        observe: impl FnOnce(&Parameters<T>, f64) -> ControlFlow<Stop>,
    ) -> Result<Advance, FitError> {
        let Self { tape, parameters, settings, step, is_checked, reset_ms, .. } = self;
        let start = Instant::now();
        let variables = parameters.record(tape);
        let loss = record_loss(pipeline, tape, parameters, &variables)?;
        let value = loss.item().to_f64();
        let forward_ms = milliseconds_since(start);
        if let ControlFlow::Break(stop) = observe(parameters, value) {
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
        let stepped = Stepped { step: *step, loss: value, ms, target_ms: 0.0, vanished };
        *step += 1;
        Ok(Advance::Updated(stepped))
    }
}

/// Records the loss and checks that it is a finite scalar; blames a parameter's value where that
/// is at fault.
fn record_loss<'t, T: Scalar, P: Pipeline<T>>(
    pipeline: &P,
    tape: &'t Tape<T>,
    parameters: &Parameters<T>,
    variables: &Variables<'t, T>,
) -> Result<Var<'t, T>, FitError> {
    let loss = match pipeline.loss(tape, variables) {
        Ok(loss) => loss,
        Err(error) => {
            parameters.check_values()?;
            return Err(error);
        }
    };
    let shape = loss.shape();
    if shape.size() != 1 {
        return Err(TensorError::NotScalar { shape }.into());
    }
    let value = loss.item();
    if !value.is_finite() {
        parameters.check_values()?;
        let origin = tape.first_not_finite().map(|first| {
            Box::new(match first.operation() {
                Some(operation) => {
                    Origin::Output { operation, parameters: variables.names_among(&first.inputs()) }
                }
                None => Origin::Input { shape: first.shape() },
            })
        });
        let (value, step) = (value.to_f64(), parameters.updates);
        return Err(FitError::NotFinite { quantity: Quantity::Loss, value, step, origin });
    }
    Ok(loss)
}

/// Checks that every parameter that is fitted has a way to the loss, if only one that rests in this
/// step: where none was recorded, no later step of the same pipeline has one either.
fn check_ways<'t, T: Scalar>(
    parameters: &Parameters<T>,
    variables: &Variables<'t, T>,
    loss: Var<'t, T>,
) -> Result<(), FitError> {
    for (parameter, variable) in parameters.list.iter().zip(&variables.list) {
        if parameter.is_frozen() || parameter.is_optional {
            continue;
        }
        // The value, not the raw numbers: its mapping is no operation of the pipeline.
        if let Dependence::None { end, is_detached } = loss.dependence_on(variable.value)? {
            let parameter = parameter.name().to_owned();
            return Err(FitError::NoWay { parameter, end, is_detached });
        }
    }
    Ok(())
}

/// The error, and where the gradients of `loss` were infinite or NaN first if it is about one.
fn with_origin<T: Scalar>(error: FitError, loss: Var<'_, T>) -> FitError {
    match error {
        FitError::NotFinite { quantity: quantity @ Quantity::Gradient(_), value, step, .. } => {
            let first = loss.first_gradient_not_finite().ok().flatten();
            let operation = first.and_then(Var::operation);
            let origin = operation.map(|operation| Box::new(Origin::Backward { operation }));
            FitError::NotFinite { quantity, value, step, origin }
        }
        error => error,
    }
}

/// Whether every entry of every gradient is smaller than `limit`.
fn all_below<'t, T: Scalar>(
    limit: f64,
    variables: &Variables<'t, T>,
    gradients: &Gradients<'t, T>,
) -> bool {
    let mut all = variables.list.iter().filter_map(|variable| gradients.get(variable.raw));
    all.all(|gradient| gradient.data().iter().all(|entry| entry.abs().to_f64() < limit))
}

fn milliseconds_since(start: Instant) -> f64 {
    1e3 * start.elapsed().as_secs_f64()
}

#[cfg(test)]
mod tests {
    use bokashi_core::Tensor;

    use super::*;
    use crate::loss::squared_error;
    use crate::parameter::{Mapping, Parameter};
    use crate::pipeline::from_fn;

    /// `sum (x - c)^2` with `c = (1, -2)`, which moves by `drift` each step.
    struct Bowl {
        drift: f64,
        center: [f64; 2],
        prepared: Vec<u64>,
    }

    impl Bowl {
        fn new(drift: f64) -> Self {
            Self { drift, center: [1.0, -2.0], prepared: Vec::new() }
        }
    }

    impl<T: Scalar> Pipeline<T> for Bowl {
        type Measure = f64;

        fn prepare(&mut self, step: u64) -> Result<(), FitError> {
            self.prepared.push(step);
            self.center = [1.0 + self.drift * step as f64, -2.0];
            Ok(())
        }

        fn loss<'t>(
            &self,
            tape: &'t Tape<T>,
            variables: &Variables<'t, T>,
        ) -> Result<Var<'t, T>, FitError> {
            let center = Tensor::from_fn([2], |k| T::from_f64(self.center[k]));
            Ok(squared_error(variables.get("x")?, tape.constant(&center))?)
        }

        fn measure(&self, parameters: &Parameters<T>) -> f64 {
            let x = parameters.get("x").unwrap().raw().data();
            (0..2).map(|k| (x[k].to_f64() - self.center[k]).abs()).sum()
        }
    }

    fn start<T: Scalar>(rate: f64) -> Parameters<T> {
        Parameters::new().with(Parameter::new("x", Tensor::zeros([2])).rate(rate)).unwrap()
    }

    fn descent(steps: u64) -> FitSettings {
        FitSettings { steps, optimizer: Optimizer::GradientDescent, ..FitSettings::default() }
    }

    #[test]
    fn one_pipeline_runs_in_both_precisions() {
        let mut bowl = Bowl::new(0.0);
        let wide = Fit::<f64>::new(start(0.25), descent(40)).unwrap().run(&mut bowl).unwrap();
        let narrow = Fit::<f32>::new(start(0.25), descent(40)).unwrap().run(&mut bowl).unwrap();
        for (wide, narrow) in wide.steps.iter().zip(&narrow.steps) {
            assert!((wide.loss - narrow.loss).abs() <= 1e-6 * wide.loss + 1e-12);
        }
    }

    #[test]
    fn a_history_holds_the_state_before_each_update_and_the_final_one() {
        let mut bowl = Bowl::new(0.0);
        // At a rate of 1/4 each update halves the distance, exactly.
        let history = Fit::<f64>::new(start(0.25), descent(10)).unwrap().run(&mut bowl).unwrap();
        assert_eq!(history.stop, Stop::Steps);
        assert_eq!(history.steps.len(), 11);
        assert_eq!((history.step_ms.len(), history.target_ms.len()), (10, 11));
        for (k, step) in history.steps.iter().enumerate() {
            assert_eq!(step.step, k as u64);
            assert_eq!(step.measure, 3.0 * 0.5_f64.powi(k as i32));
            assert_eq!(step.loss, 5.0 * 0.25_f64.powi(k as i32));
        }
        assert!(history.steps.windows(2).all(|pair| pair[0].seconds <= pair[1].seconds));
        assert_eq!(bowl.prepared, (0..=10).collect::<Vec<_>>());
    }

    #[test]
    fn no_steps_leave_the_initial_state_alone() {
        let history =
            Fit::<f64>::new(start(0.25), descent(0)).unwrap().run(&mut Bowl::new(0.0)).unwrap();
        assert_eq!(history.steps.len(), 1);
        assert_eq!(history.initial(), history.last());
        assert_eq!(history.step_ms_median(), None);
    }

    #[test]
    fn steps_by_hand_are_the_steps_of_a_run() {
        let mut by_hand = Fit::<f64>::new(start(0.1), FitSettings::default()).unwrap();
        let mut run = Fit::<f64>::new(start(0.1), FitSettings::default()).unwrap();
        let history = run.run(&mut Bowl::new(0.01)).unwrap();
        let mut bowl = Bowl::new(0.01);
        for step in &history.steps[..1_000] {
            let stepped = by_hand.step(&mut bowl).unwrap();
            assert_eq!((stepped.step, stepped.loss), (step.step, step.loss));
        }
        assert_eq!(by_hand.parameters().value("x"), run.parameters().value("x"));
    }

    #[test]
    fn a_schedule_multiplies_the_rate() {
        let schedule = Schedule::Step { steps: 1, factor: 0.5 };
        let settings = FitSettings { schedule, ..descent(2) };
        let history =
            Fit::<f64>::new(start(0.25), settings).unwrap().run(&mut Bowl::new(0.0)).unwrap();
        // Rates 1/4 and 1/8: distances 1/2 and 1/2 * 3/4.
        assert_eq!(history.last().measure, 3.0 * 0.5 * 0.75);
    }

    #[test]
    fn each_rule_stops_before_the_update_that_it_spares() {
        let run = |settings: FitSettings, drift: f64| {
            let mut fit = Fit::<f64>::new(start(0.25), settings).unwrap();
            let history = fit.run(&mut Bowl::new(drift)).unwrap();
            assert_eq!(fit.steps_done(), history.last().step);
            history
        };
        // The loss is 5 / 4^k and the largest gradient 4 / 2^k.
        let below = run(FitSettings { loss_below: Some(0.1), ..descent(100) }, 0.0);
        assert_eq!((below.stop, below.last().step), (Stop::LossBelow, 3));
        let flat = run(FitSettings { gradient_below: Some(0.3), ..descent(100) }, 0.0);
        assert_eq!((flat.stop, flat.last().step), (Stop::GradientBelow, 4));
        // The centre runs away at a constant speed: the distance settles at twice the speed, which
        // is more than the first loss.
        let stuck = run(FitSettings { patience: Some(5), ..descent(100) }, 10.0);
        assert_eq!((stuck.stop, stuck.last().step), (Stop::NoProgress, 5));
    }

    #[test]
    fn a_callback_sees_every_state_and_can_stop() {
        let mut fit = Fit::<f64>::new(start(0.25), descent(10)).unwrap();
        let mut seen = Vec::new();
        let history = fit.run_with(&mut Bowl::new(0.0), |state| {
            seen.push((state.step.step, state.parameters.get("x").unwrap().raw().data()[0]));
            if state.step.step == 3 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        assert_eq!(seen, [(0, 0.0), (1, 0.5), (2, 0.75), (3, 0.875)]);
        let history = history.unwrap();
        assert_eq!((history.stop, history.steps.len()), (Stop::Callback, 4));
    }

    #[test]
    fn what_is_not_finite_is_named_and_changes_nothing() {
        let x = || Parameter::new("x", Tensor::scalar(1.0_f64));
        let error_of = |parameter: Parameter<f64>, raw: Option<f64>, power: i32| {
            let mut list = Parameters::new().with(parameter).unwrap();
            if let Some(raw) = raw {
                list.list[0].raw = Tensor::scalar(raw);
            }
            let before = list.list[0].raw.clone();
            let mut fit = Fit::new(list, FitSettings::default()).unwrap();
            let mut pipeline = from_fn(move |_, variables| {
                let x = variables.get("x")?;
                Ok(x.powi(power))
            });
            let error = fit.step(&mut pipeline).unwrap_err();
            assert_eq!(fit.parameters().list[0].raw.data(), before.data());
            assert_eq!(fit.steps_done(), 0);
            error.to_string()
        };
        let value = error_of(x().mapping(Mapping::Exp), Some(800.0), 1);
        assert_eq!(value, "the value of \"x\" needs to be finite, got inf at step 0");
        let loss = error_of(x(), Some(1e200), 2);
        let of = "first in the output of powi of \"x\"";
        assert_eq!(loss, format!("the loss needs to be finite, got inf at step 0, {of}"));
        let gradient = error_of(x(), Some(0.0), -1);
        assert_eq!(gradient, format!("the loss needs to be finite, got inf at step 0, {of}"));
    }

    /// The message of the first step of a fit of `a` and `b`, by the loss that `record` makes.
    fn refusal(
        [a, b]: [f64; 2],
        record: impl for<'t> Fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>,
    ) -> Option<String> {
        let mapped = Parameter::new("b", Tensor::scalar(b)).mapping(Mapping::Softplus);
        let list = Parameters::new()
            .with(Parameter::new("a", Tensor::scalar(a)))
            .and_then(|list| list.with(mapped))
            .unwrap();
        let before = list.value("a").unwrap();
        let mut fit = Fit::new(list, FitSettings { steps: 3, ..FitSettings::default() }).unwrap();
        let mut pipeline =
            from_fn(|_, variables| Ok(record(variables.get("a")?, variables.get("b")?)));
        let error = fit.run(&mut pipeline).err()?.to_string();
        assert_eq!((fit.parameters().value("a").unwrap(), fit.steps_done()), (before, 0));
        Some(error)
    }

    #[test]
    fn what_is_not_finite_is_laid_to_the_first_operation() {
        let of = |start, record: for<'t> fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>| {
            refusal(start, record).unwrap()
        };
        let loss = of([-3.0, 2.0], |a, b| ((a * b).ln() + b).exp());
        let rule = "the loss needs to be finite, got NaN at step 0";
        assert_eq!(loss, format!("{rule}, first in the output of ln"));
        let loss = of([-3.0, 2.0], |a, b| a.sqrt() * b);
        assert_eq!(loss, format!("{rule}, first in the output of sqrt of \"a\""));
        let both = of([1e308, 1e308], |a, b| a.square().exp() - (a * b) * b);
        let rule = "the loss needs to be finite, got NaN at step 0";
        assert_eq!(both, format!("{rule}, first in the output of powi of \"a\""));
        let input =
            of([1.0, 2.0], |a, b| a * b + a.tape().constant(&Tensor::full([2], f64::NAN)).sum());
        assert_eq!(input, format!("{rule}, first in an input of shape [2]"));
        let gradient = of([0.0, 2.0], |a, b| (a.square().sqrt() + b).exp());
        let rule = "the gradient of \"a\" needs to be finite, got NaN at step 0";
        assert_eq!(gradient, format!("{rule}, first in the backward pass of sqrt"));
    }

    #[test]
    fn a_parameter_without_a_way_to_the_loss_is_refused_before_the_first_update() {
        let of = |record: for<'t> fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>| {
            refusal([1.0, 2.0], record)
        };
        let unused = of(|_, b| b.square()).unwrap();
        assert_eq!(unused, "\"a\" needs a way to the loss, got a loss that does not use it");
        let mapped = of(|a, _| a.square()).unwrap();
        assert_eq!(mapped, "\"b\" needs a way to the loss, got a loss that does not use it");
        let rule = "\"a\" needs a way to the loss, got one that ends";
        let cut = of(|a, b| (b * a.tape().scalar(a.sin().item())).square()).unwrap();
        assert_eq!(cut, format!("{rule} at sin"));
        let detached = of(|a, b| b * a.exp().detach()).unwrap();
        assert_eq!(detached, format!("{rule} at exp, whose output is detached"));
        let detached = of(|a, b| b * a.detach()).unwrap();
        assert_eq!(detached, format!("{rule} where it is detached"));
        let constant = of(|a, _| a.tape().constant_full([], 1.0)).unwrap();
        assert_eq!(constant, "\"a\" needs a way to the loss, got a loss that does not use it");
    }

    #[test]
    fn a_gradient_of_zero_is_no_reason_to_refuse() {
        for record in [
            (|a, b| a * 0.0 + b) as for<'t> fn(Var<'t, f64>, Var<'t, f64>) -> Var<'t, f64>,
            |a, b| (a - 1.0).square() + b,
            |a, b| a.clamp(5.0, 6.0).unwrap() + b,
        ] {
            assert_eq!(refusal([1.0, 2.0], record), None);
        }
    }

    #[test]
    fn what_is_optional_or_frozen_may_go_unused() {
        let parameter = |name| Parameter::new(name, Tensor::scalar(1.0_f64)).rate(0.1);
        let list = Parameters::new()
            .with(parameter("coarse"))
            .and_then(|list| list.with(parameter("fine").optional()))
            .and_then(|list| list.with(parameter("still").frozen()))
            .unwrap();
        /// Coarse at first, then fine.
        struct Refines(u64);
        impl Pipeline<f64> for Refines {
            type Measure = ();
            fn prepare(&mut self, step: u64) -> Result<(), FitError> {
                self.0 = step;
                Ok(())
            }
            fn loss<'t>(
                &self,
                _tape: &'t Tape<f64>,
                variables: &Variables<'t, f64>,
            ) -> Result<Var<'t, f64>, FitError> {
                Ok(variables.get(if self.0 < 3 { "coarse" } else { "fine" })?.square())
            }
        }
        let settings = FitSettings { steps: 6, ..FitSettings::default() };
        let mut fit = Fit::new(list, settings).unwrap();
        fit.run(&mut Refines(0)).unwrap();
        assert!(fit.parameters().value("fine").unwrap().item() < 1.0);
    }

    #[test]
    fn updates_that_vanish_are_in_the_history_by_step_and_parameter() {
        let parameter = |name, rate| Parameter::new(name, Tensor::full([3], 1.0_f32)).rate(rate);
        let list = Parameters::new()
            .with(parameter("moves", 0.25))
            .and_then(|list| list.with(parameter("stays", 1e-9)))
            .unwrap();
        let sum = || {
            from_fn(|_, variables| Ok((variables.get("moves")? + variables.get("stays")?).sum()))
        };
        let mut fit = Fit::new(list, descent(2)).unwrap();
        let history = fit.run(&mut sum()).unwrap();
        let expected = [0, 1].map(|step| Vanished { step, parameter: 1, entries: 3 });
        assert_eq!(history.vanished, expected);
        assert_eq!(fit.step(&mut sum()).unwrap().vanished, 3);
    }

    #[test]
    fn a_loss_that_is_no_scalar_is_refused() {
        let mut fit = Fit::<f64>::new(start(0.1), FitSettings::default()).unwrap();
        let error = fit.run(&mut from_fn(|_, variables| variables.get("x"))).unwrap_err();
        assert!(error.to_string().ends_with("needs a scalar, got shape [2]"), "{error}");
    }

    #[test]
    fn settings_outside_their_range_are_refused() {
        for settings in [
            FitSettings { patience: Some(0), ..FitSettings::default() },
            FitSettings { loss_below: Some(f64::NAN), ..FitSettings::default() },
            FitSettings {
                schedule: Schedule::Step { steps: 0, factor: 0.5 },
                ..FitSettings::default()
            },
        ] {
            assert!(matches!(Fit::<f64>::new(start(0.1), settings), Err(FitError::Setting { .. })));
        }
    }
}
