//! What a sample is asked for.

use bokashi::prelude::*;

/// What a sample is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    /// All that is random follows from it.
    pub seed: u64,
    /// How silhouettes look.
    pub silhouettes: Silhouettes,
    /// The most steps that a fit may take, where that is less than a sample needs: to see that it runs.
    pub most_steps: Option<u64>,
}

impl Request {
    /// How many steps to take instead of `needed`.
    pub fn steps(&self, needed: u64) -> u64 {
        self.most_steps.map_or(needed, |most| most.min(needed))
    }
}
