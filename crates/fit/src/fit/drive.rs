//! The loop of every fit: steps until a rule stops it, and listeners that follow it.
//!
//! # The order of calls
//! ```text
//! begin
//!   |
//!   +--> ranks agree --> rules --> step: prepare, loss --> before_update --> update --> after_step --+
//!   ^                      | stop                              | stop                                |
//!   |                      +------------> end <----------------+                                     |
//!   +------------------------------------------------------------------------------------------------+
//! ```
//! [`Rules`] act before a step, so that nothing is computed in vain. A fit may have rules of its own:
//! [`Steps::stop`], and those of [`FitSettings`](super::FitSettings), which act before the update.
//!
//! # Ranks
//! All ranks of a job drive the same fit with the same rules, and agree before each step whether to go on. The
//! clock of the first rank decides on time. Three events end the loop on all ranks: a signal to any rank,
//! an error of a listener on any rank, and a break of a listener on the first rank.

use std::ops::ControlFlow;
use std::time::Instant;

use bokashi_core::Scalar;

use super::step::{StepState, Stepped};
use crate::communicator::{Alone, Communicator, agree, agreed};
use crate::error::FitError;
use crate::parameter::Parameters;
use crate::stopping::Stop;

/// A function that is called with the state of a step before its update. It may break with a reason to stop.
pub type Observer<'a, T, M> = dyn FnMut(&StepState<'_, T, M>) -> ControlFlow<Stop> + 'a;

/// The answer of a listener: whether the fit goes on, or an error.
pub type Answer<E> = Result<ControlFlow<()>, E>;

/// A fit that goes step by step: see [`drive`].
pub trait Steps {
    /// The numbers of the parameters.
    type Number: Scalar;
    /// The errors of the parameters against the truth.
    type Measure;
    /// The errors of steps and listeners.
    type Error: From<FitError> + ToString;

    /// The number of updates done.
    fn steps_done(&self) -> u64;

    /// The parameters.
    fn parameters(&self) -> &Parameters<Self::Number>;

    /// Does a step: prepares it, computes its loss, calls `observer`, and updates the parameters unless the
    /// observer breaks or a rule of the fit stops it. A fit that shares its steps among ranks may leave the
    /// observer out.
    ///
    /// # Errors
    /// Those of the step. Parameters are then as they were.
    fn step(
        &mut self,
        observer: &mut Observer<'_, Self::Number, Self::Measure>,
    ) -> Result<ControlFlow<Stop, Stepped>, Self::Error>;

    /// The reason why there is no further step, the same on all ranks; `None` if there is one.
    fn stop(&self) -> Option<Stop> {
        None
    }

    /// Whether the fit has taken the time that its own rules allow. The first rank decides.
    fn is_time_up(&self) -> bool {
        false
    }

    /// The ranks that share the fit.
    fn ranks(&self) -> &dyn Communicator<Self::Number> {
        &Alone
    }
}

/// A listener, which [`drive`] calls as a fit `S` goes on.
///
/// The first rank calls all its listeners, and other ranks those that are shared.
pub trait Listener<S: Steps> {
    /// Whether all ranks call the listener. Its answers must then be the same on all ranks.
    fn is_shared(&self) -> bool {
        false
    }

    /// Called once, before the first step.
    ///
    /// # Errors
    /// They end the fit.
    fn begin(&mut self, fit: &S) -> Answer<S::Error> {
        let _ = fit;
        Ok(ControlFlow::Continue(()))
    }

    /// Called in each step before the update, if the step calls its observer. A break stops the fit without the
    /// update.
    ///
    /// # Errors
    /// They end the fit.
    fn before_update(&mut self, state: &StepState<'_, S::Number, S::Measure>) -> Answer<S::Error> {
        let _ = state;
        Ok(ControlFlow::Continue(()))
    }

    /// Called after each step. A break stops the fit before the next one.
    ///
    /// # Errors
    /// They end the fit.
    fn after_step(&mut self, fit: &S, stepped: &Stepped) -> Answer<S::Error> {
        let _ = (fit, stepped);
        Ok(ControlFlow::Continue(()))
    }

    /// Called once, when the fit has stopped without an error.
    ///
    /// # Errors
    /// They are those of the drive.
    fn end(&mut self, fit: &S, stop: Stop) -> Result<(), S::Error> {
        let _ = (fit, stop);
        Ok(())
    }
}

/// Rules that stop a fit, beside its own.
#[derive(Clone, Copy, Default)]
pub struct Rules<'a> {
    /// The most updates, counted from the start of the fit. No listener sees the state after the last one.
    pub steps: Option<u64>,
    /// The most seconds of this run, by the clock of the first rank.
    pub seconds: Option<f64>,
    /// A function that is called before each step. It returns the number of a signal that stops the fit.
    pub interrupt: Option<&'a dyn Fn() -> Option<i32>>,
}

/// Does steps until a rule or a listener stops the fit.
///
/// # Errors
/// Those of steps and listeners. An error on one rank is an error on all.
pub fn drive<S: Steps>(
    fit: &mut S,
    rules: &Rules<'_>,
    listeners: &mut [&mut dyn Listener<S>],
) -> Result<Stop, S::Error> {
    let start = Instant::now();
    let is_first = fit.ranks().rank() == 0;
    let called = listeners.iter_mut().filter(|listener| is_first || listener.is_shared());
    let mut listeners: Vec<_> = called.collect();
    let mut answer = ask_all(&mut listeners, |listener| listener.begin(fit));
    let stop = loop {
        let is_time_up = rules.seconds.is_some_and(|most| start.elapsed().as_secs_f64() >= most)
            || fit.steps_done() > 0 && fit.is_time_up();
        let call = agreed_call(fit.ranks(), rules, answer, is_time_up)?;
        let is_done = rules.steps.is_some_and(|most| fit.steps_done() >= most);
        let stop = fit.stop().or(is_done.then_some(Stop::Steps)).or(call);
        if let Some(stop) = stop {
            break stop;
        }
        let mut failed = None;
        let stepped = fit.step(&mut |state| match ask_all(&mut listeners, |listener| {
            listener.before_update(state)
        }) {
            Ok(flow) => flow.map_break(|()| Stop::Callback),
            Err(error) => {
                failed = Some(error);
                ControlFlow::Break(Stop::Callback)
            }
        })?;
        match (failed, stepped) {
            (Some(error), _) => return Err(error),
            (None, ControlFlow::Break(stop)) => break stop,
            (None, ControlFlow::Continue(stepped)) => {
                answer = ask_all(&mut listeners, |listener| listener.after_step(fit, &stepped));
            }
        }
    };
    let ended = listeners.iter_mut().try_for_each(|listener| listener.end(fit, stop));
    agreed(fit.ranks(), ended).map(|()| stop)
}

/// Calls `ask` with all listeners, even after one of them breaks. Returns whether the fit goes on.
fn ask_all<S: Steps, L: Listener<S> + ?Sized, E>(
    listeners: &mut [&mut &mut L],
    mut ask: impl FnMut(&mut L) -> Answer<E>,
) -> Answer<E> {
    let mut flow = ControlFlow::Continue(());
    for listener in listeners {
        if ask(listener)?.is_break() {
            flow = ControlFlow::Break(());
        }
    }
    Ok(flow)
}

/// Agrees among ranks on a reason to stop that only one of them may know.
fn agreed_call<T, E: From<FitError> + ToString>(
    ranks: &dyn Communicator<T>,
    rules: &Rules<'_>,
    answer: Answer<E>,
    is_time_up: bool,
) -> Result<Option<Stop>, E> {
    // Numbers of signals are small.
    let signal = rules.interrupt.and_then(|signal| signal()).map_or(0, i32::unsigned_abs) as u8;
    let answer_bytes = answer.map(|flow| [signal, flow.is_break().into(), is_time_up.into()]);
    let (signal, of_first) = if ranks.size() == 1 {
        // Nothing is allocated for one rank.
        let answer_bytes = answer_bytes?;
        (answer_bytes[0], answer_bytes)
    } else {
        let all = agree(ranks, answer_bytes.map(Vec::from))?;
        let signals = all.iter().filter_map(|bytes| bytes.first().copied());
        let signal = signals.into_iter().find(|&signal| signal != 0).unwrap_or(0);
        let of_first = all.first().and_then(|bytes| bytes.first_chunk());
        (signal, of_first.copied().unwrap_or_default())
    };
    Ok(match of_first {
        _ if signal != 0 => Some(Stop::Interrupted(signal.into())),
        [_, 1, _] => Some(Stop::Callback),
        [_, _, 1] => Some(Stop::Time),
        _ => None,
    })
}
