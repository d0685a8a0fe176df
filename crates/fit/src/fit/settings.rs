//! How to fit, and when to stop.

use crate::error::FitError;
use crate::optimizer::Optimizer;
use crate::schedule::Schedule;
use crate::stopping::LossRules;

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
    /// The rules that stop a fit by its losses.
    pub(super) fn loss_rules(&self) -> LossRules {
        LossRules { below: self.loss_below, patience: self.patience }
    }

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
