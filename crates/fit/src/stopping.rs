//! The reasons why a fit stops, and the rules that stop it by its losses.

/// The reason why a fit stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Stop {
    /// All steps were done.
    Steps,
    /// Its time was up.
    Time,
    /// The loss fell below the limit.
    LossBelow,
    /// The loss found no new minimum for too many steps.
    NoProgress,
    /// Every entry of the gradient fell below the limit.
    GradientBelow,
    /// A listener stopped it.
    Callback,
    /// A signal with this number stopped it.
    Interrupted(i32),
}

/// Rules that stop a fit by its losses.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LossRules {
    /// Stops where the loss is below this.
    pub below: Option<f64>,
    /// Stops where the loss had no new minimum for so many steps.
    pub patience: Option<u64>,
}

/// The losses so far that [`LossRules`] need. They are saved with a fit, so that a resumed fit stops at the same step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Losses {
    /// The last loss.
    pub last: Option<f64>,
    /// The least loss.
    pub least: Option<f64>,
    /// The number of steps since the least loss.
    pub waited: u64,
}

impl Losses {
    /// Counts the loss of a step. An equal loss is no new minimum.
    pub fn count(&mut self, loss: f64) {
        self.last = Some(loss);
        if self.least.is_none_or(|least| loss < least) {
            (self.least, self.waited) = (Some(loss), 0);
        } else {
            self.waited = self.waited.saturating_add(1);
        }
    }

    /// Forgets the least loss, as later losses cannot be compared with it.
    pub fn restart(&mut self) {
        (self.least, self.waited) = (None, 0);
    }
}

impl LossRules {
    /// The rule that stops a fit with these losses, if one does.
    pub fn stop(&self, losses: &Losses) -> Option<Stop> {
        let is_below = |below| losses.last.is_some_and(|last| last < below);
        if self.below.is_some_and(is_below) {
            return Some(Stop::LossBelow);
        }
        let is_patient = self.patience.is_none_or(|patience| losses.waited < patience);
        (!is_patient).then_some(Stop::NoProgress)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_loss_below_the_limit_or_no_smaller_one_for_so_many_steps_stops() {
        let losses = [5.0, 3.0, 3.0, 4.0, 2.0, 9.0, 9.0, 9.0, 1.0];
        let end = |rules: LossRules| {
            let mut counted = Losses::default();
            losses.iter().position(|&loss| {
                counted.count(loss);
                rules.stop(&counted).is_some()
            })
        };
        assert_eq!(end(LossRules::default()), None);
        assert_eq!(end(LossRules { below: Some(3.0), patience: None }), Some(4));
        for (patience, expected) in [(1, 2), (2, 3), (3, 7), (4, 8)] {
            let rules = LossRules { below: Some(1.5), patience: Some(patience) };
            assert_eq!(end(rules), Some(expected));
        }
    }

    #[test]
    fn what_restarts_waits_from_its_next_loss() {
        let rules = LossRules { below: None, patience: Some(2) };
        let mut losses = Losses::default();
        [1.0, 1.0].into_iter().for_each(|loss| losses.count(loss));
        losses.restart();
        [5.0, 4.0, 4.0].into_iter().for_each(|loss| losses.count(loss));
        assert_eq!(rules.stop(&losses), None);
        losses.count(4.0);
        assert_eq!(rules.stop(&losses), Some(Stop::NoProgress));
    }
}
