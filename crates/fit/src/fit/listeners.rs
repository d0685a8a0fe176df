//! Listeners for any fit: a history, and functions.

use std::ops::ControlFlow;

use super::drive::{Answer, Listener, Steps};
use super::step::{StepState, Stepped};
use crate::history::{History, Vanished};
use crate::stopping::Stop;

/// A history is recorded on each rank.
impl<S: Steps<Measure: Clone>> Listener<S> for History<S::Measure> {
    fn is_shared(&self) -> bool {
        true
    }

    fn before_update(&mut self, state: &StepState<'_, S::Number, S::Measure>) -> Answer<S::Error> {
        self.steps.push(state.step.clone());
        self.preparation_ms.push(state.preparation_ms);
        Ok(ControlFlow::Continue(()))
    }

    fn after_step(&mut self, fit: &S, stepped: &Stepped) -> Answer<S::Error> {
        self.step_ms.push(stepped.ms);
        if stepped.vanished > 0 {
            let all = fit.parameters().iter().enumerate();
            self.vanished.extend(all.filter(|(_, parameter)| parameter.vanished() > 0).map(
                |(index, parameter)| Vanished {
                    step: stepped.step,
                    parameter: index,
                    entries: parameter.vanished(),
                },
            ));
        }
        Ok(ControlFlow::Continue(()))
    }

    fn end(&mut self, _fit: &S, stop: Stop) -> Result<(), S::Error> {
        self.stop = stop;
        Ok(())
    }
}

/// A function as a [`Listener`]: see [`every`].
#[derive(Debug, Clone, Copy)]
pub struct Every<F> {
    steps: u64,
    function: F,
    /// The number of steps done at the last call.
    called: Option<u64>,
}

/// A function as a [`Listener`]: see [`before_update`].
#[derive(Debug, Clone, Copy)]
pub struct BeforeUpdate<F>(F);

/// A function as a [`Listener`]: see [`after_step`].
#[derive(Debug, Clone, Copy)]
pub struct AfterStep<F>(F);

/// A listener that calls `function` before the first step, after each `steps` steps (1 or more), and at the end. All
/// ranks call it. After a signal there is no call at the end. In a resumed fit the first call is at the next
/// multiple of `steps`.
pub fn every<S, F>(steps: u64, function: F) -> Every<F>
where
    S: Steps,
    F: FnMut(&S) -> Result<(), S::Error>,
{
    Every { steps, function, called: None }
}

impl<F> Every<F> {
    fn call<S>(&mut self, fit: &S) -> Result<(), S::Error>
    where
        S: Steps,
        F: FnMut(&S) -> Result<(), S::Error>,
    {
        if self.called.replace(fit.steps_done()) != Some(fit.steps_done()) {
            (self.function)(fit)?;
        }
        Ok(())
    }
}

impl<S, F> Listener<S> for Every<F>
where
    S: Steps,
    F: FnMut(&S) -> Result<(), S::Error>,
{
    fn is_shared(&self) -> bool {
        true
    }

    fn begin(&mut self, fit: &S) -> Answer<S::Error> {
        if fit.steps_done().is_multiple_of(self.steps) {
            self.call(fit)?;
        }
        Ok(ControlFlow::Continue(()))
    }

    fn after_step(&mut self, fit: &S, _stepped: &Stepped) -> Answer<S::Error> {
        self.begin(fit)
    }

    fn end(&mut self, fit: &S, stop: Stop) -> Result<(), S::Error> {
        match stop {
            Stop::Interrupted(_) => Ok(()),
            _ => self.call(fit),
        }
    }
}

/// A listener that calls `function` with the state of each step before its update, on all ranks.
pub fn before_update<T, M, F>(function: F) -> BeforeUpdate<F>
where
    F: FnMut(&StepState<'_, T, M>) -> ControlFlow<()>,
{
    BeforeUpdate(function)
}

/// A listener that calls `function` after each step, on all ranks.
pub fn after_step<F: FnMut(&Stepped) -> ControlFlow<()>>(function: F) -> AfterStep<F> {
    AfterStep(function)
}

impl<S: Steps, F> Listener<S> for BeforeUpdate<F>
where
    F: FnMut(&StepState<'_, S::Number, S::Measure>) -> ControlFlow<()>,
{
    fn is_shared(&self) -> bool {
        true
    }

    fn before_update(&mut self, state: &StepState<'_, S::Number, S::Measure>) -> Answer<S::Error> {
        Ok((self.0)(state))
    }
}

impl<S: Steps, F: FnMut(&Stepped) -> ControlFlow<()>> Listener<S> for AfterStep<F> {
    fn is_shared(&self) -> bool {
        true
    }

    fn after_step(&mut self, _fit: &S, stepped: &Stepped) -> Answer<S::Error> {
        Ok((self.0)(stepped))
    }
}
