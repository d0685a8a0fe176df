//! The state of a fit besides its parameters, which a saved fit has.

use bokashi_core::Scalar;

use super::settings::FitSettings;
use crate::pipeline::Pipeline;
use crate::stopping::Losses;

/// The state of a fit besides its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LoopState<'a> {
    pub(crate) settings: FitSettings,
    /// The number of updates done.
    pub(crate) step: u64,
    /// The losses of the present run before this step.
    pub(crate) losses: Losses,
    /// The pipeline's state before the preparation of the step; `None` before the first step.
    pub(crate) pipeline: Option<&'a [u8]>,
}

/// The last state that a pipeline saved.
#[derive(Debug, Default)]
pub(super) struct PipelineState {
    pub(super) bytes: Vec<u8>,
    pub(super) is_known: bool,
    /// Whether the pipeline of a resumed fit has yet to restore it.
    pub(super) is_due: bool,
}

impl PipelineState {
    pub(super) fn save<T: Scalar>(&mut self, pipeline: &impl Pipeline<T>) {
        self.bytes.clear();
        pipeline.save_state(&mut self.bytes);
        self.is_known = true;
    }

    pub(super) fn known(&self) -> Option<&[u8]> {
        self.is_known.then_some(&self.bytes)
    }
}
