//! What a fit is besides its parameters: what it takes to save it.

use bokashi_core::Scalar;

use super::settings::FitSettings;
use crate::pipeline::Pipeline;
use crate::stopping::Losses;

/// What a fit is besides its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LoopState<'a> {
    pub(crate) settings: FitSettings,
    /// How many updates are done.
    pub(crate) step: u64,
    /// The losses of the run before this step.
    pub(crate) losses: Losses,
    /// The pipeline's state before the preparation of the step; `None` before the first.
    pub(crate) pipeline: Option<&'a [u8]>,
}

/// A pipeline's state, as it saved it last.
#[derive(Debug, Default)]
pub(super) struct PipelineState {
    pub(super) bytes: Vec<u8>,
    pub(super) is_known: bool,
    /// Whether it is a resumed fit's, and the pipeline has still to take it back.
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
