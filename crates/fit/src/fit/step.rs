//! The states of a step before its update and after it.

#[cfg(feature = "save")]
use super::state::LoopState;
use crate::history::Step;
use crate::parameter::Parameters;

/// The state of a step before its update, for listeners.
#[derive(Debug)]
pub struct StepState<'a, T, M> {
    /// Step, seconds, loss and errors.
    pub step: &'a Step<M>,
    /// The parameters.
    pub parameters: &'a Parameters<T>,
    /// Milliseconds of the last update: forward, backward and optimizer; 0 before the first.
    pub ms: f64,
    /// Milliseconds of this step's preparation.
    pub preparation_ms: f64,
    /// The state that a saved fit needs beside; only a [`Fit`](super::Fit) has one.
    #[cfg(feature = "save")]
    pub(crate) loop_state: Option<LoopState<'a>>,
}

impl<'a, T, M> StepState<'a, T, M> {
    /// The state of `step` with these parameters, for [`Steps`](super::Steps) other than a fit. It cannot be saved.
    pub fn new(
        step: &'a Step<M>,
        parameters: &'a Parameters<T>,
        ms: f64,
        preparation_ms: f64,
    ) -> Self {
        Self {
            step,
            parameters,
            ms,
            preparation_ms,
            #[cfg(feature = "save")]
            loop_state: None,
        }
    }
}

/// The result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stepped {
    /// The number of updates before the step.
    pub step: u64,
    /// The loss before the update.
    pub loss: f64,
    /// Milliseconds of forward, backward and optimizer.
    pub ms: f64,
    /// Milliseconds of the preparation.
    pub preparation_ms: f64,
    /// The number of entries, of all parameters, whose update was not zero and yet changed nothing. For one
    /// parameter see [`Parameter::vanished`](crate::Parameter::vanished).
    pub vanished: usize,
}
