//! What is seen of a step: before its update, and after it.

#[cfg(feature = "save")]
use super::state::LoopState;
use crate::history::Step;
use crate::parameter::Parameters;

/// What a listener sees of a step, before its update.
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
    /// What else there is to save; only a [`Fit`](super::Fit) has it.
    #[cfg(feature = "save")]
    pub(crate) loop_state: Option<LoopState<'a>>,
}

impl<'a, T, M> StepState<'a, T, M> {
    /// The state of `step` with these parameters, of what is no [`Fit`](super::Fit): it cannot be saved.
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

/// A step that was done.
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
