//! When a fit of a scene ends before its last step, and how far it is with that.

use std::time::Instant;

use bokashi_fit::{LossRules, Losses, Stop};
use serde::{Deserialize, Serialize};

use crate::description::{HeldOutEntry, StopEntry};

/// What the rules of `[stop]` know of a fit: it is saved with the fit, which so ends where it would have
/// ended without an interruption.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StopState {
    /// The loss of the last step.
    last_loss: Option<f64>,
    /// The least loss of the stage.
    least_loss: Option<f64>,
    /// Steps since the least loss.
    waited: u64,
    /// The best mean PSNR of views that are held out, in the stage.
    best_psnr: Option<f64>,
    /// Measures since that.
    measures_waited: u64,
    /// Seconds of the runs before this one, where the scene limits them: files of two fits that have no such
    /// limit are the same.
    seconds: f64,
}

/// What `[stop]` of a scene says beside the number of steps.
#[derive(Debug, Clone)]
pub(crate) struct StopRules {
    rules: LossRules,
    losses: Losses,
    held_out: Option<HeldOutEntry>,
    best_psnr: Option<f64>,
    measures_waited: u64,
    seconds: Option<f64>,
    /// Of the runs before this one.
    seconds_before: f64,
    started: Instant,
}

impl StopRules {
    /// The rules of a fit that starts, or goes on, now.
    pub(crate) fn new(stop: &StopEntry, state: StopState) -> Self {
        let below = stop.loss_below.map(|loss| loss.0);
        let patience = stop.patience.map(|patience| patience.0 as u64);
        let StopState { last_loss, least_loss, waited, best_psnr, measures_waited, seconds } =
            state;
        Self {
            rules: LossRules { below, patience },
            losses: Losses { last: last_loss, least: least_loss, waited },
            held_out: stop.held_out,
            best_psnr,
            measures_waited,
            seconds: stop.seconds.map(|seconds| seconds.0),
            seconds_before: seconds,
            started: Instant::now(),
        }
    }

    /// What is saved of them.
    pub(crate) fn state(&self) -> StopState {
        let Losses { last, least, waited } = self.losses;
        let seconds = self.seconds.map_or(0.0, |_| self.elapsed());
        let Self { best_psnr, measures_waited, .. } = *self;
        StopState {
            last_loss: last,
            least_loss: least,
            waited,
            best_psnr,
            measures_waited,
            seconds,
        }
    }

    /// Of all runs.
    fn elapsed(&self) -> f64 {
        self.seconds_before + self.started.elapsed().as_secs_f64()
    }

    /// Counts a step.
    pub(crate) fn count(&mut self, loss: f64) {
        self.losses.count(loss);
    }

    /// Whether views that are held out are measured after so many steps of a stage.
    pub(crate) fn measures_after(&self, steps: u64) -> bool {
        self.held_out.is_some_and(|rule| steps.is_multiple_of(rule.every.0 as u64))
    }

    /// Counts a measure of the views that are held out: their mean PSNR in decibels.
    pub(crate) fn measure(&mut self, psnr: f64) {
        let gain = self.held_out.and_then(|rule| rule.gain).map_or(0.0, |gain| gain.0);
        if self.best_psnr.is_none_or(|best| psnr > best + gain) {
            (self.best_psnr, self.measures_waited) = (Some(psnr), 0);
        } else {
            self.measures_waited = self.measures_waited.saturating_add(1);
        }
    }

    /// Begins a stage, whose losses and pictures are others.
    pub(crate) fn begin_stage(&mut self) {
        self.losses.restart();
        (self.best_psnr, self.measures_waited) = (None, 0);
    }

    /// Whether the time is up that the fit may take. Clocks of several ranks do not agree: one decides.
    pub(crate) fn is_time_up(&self) -> bool {
        self.seconds.is_some_and(|most| self.elapsed() >= most)
    }

    /// The rule that stops the fit, or with [`Stop::NoProgress`] its stage, after its last step: the same on all ranks.
    pub(crate) fn stop(&self) -> Option<Stop> {
        self.rules.stop(&self.losses).or(self.is_held_out_done().then_some(Stop::NoProgress))
    }

    /// Whether views that are held out became no better for too long.
    fn is_held_out_done(&self) -> bool {
        self.held_out.is_some_and(|rule| self.measures_waited >= rule.patience.0 as u64)
    }

    /// [`StopRules::stop`] in words.
    pub(crate) fn ended(&self) -> Option<String> {
        let (LossRules { below, patience }, Losses { last, waited, .. }) =
            (self.rules, self.losses);
        match (self.stop()?, below, last, patience) {
            (Stop::LossBelow, Some(below), Some(last), _) => {
                Some(format!("`stop.loss_below` is {below}, and the last loss was {last:.3e}"))
            }
            (.., Some(patience)) if waited >= patience => Some(format!(
                "no smaller loss came in {waited} steps, and `stop.patience` is {patience}"
            )),
            _ => Some(format!(
                "held-out views became no better in {} measures, and `stop.held_out.patience` is {}",
                self.measures_waited, self.held_out?.patience.0
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::description::{Count, NotNegative, Positive};

    /// How many of these losses are counted until the rules end the fit, which is saved and resumed after
    /// each so many steps.
    fn counted(stop: &StopEntry, losses: &[f64], between: usize) -> usize {
        let mut rules = StopRules::new(stop, StopState::default());
        let end = losses.iter().enumerate().position(|(step, &loss)| {
            if step % between == between - 1 {
                let text = serde_json::to_string(&rules.state()).unwrap();
                rules = StopRules::new(stop, serde_json::from_str(&text).unwrap());
            }
            rules.count(loss);
            rules.ended().is_some()
        });
        end.map_or(losses.len(), |at| at + 1)
    }

    #[test]
    fn a_fit_ends_by_its_loss_or_by_patience_wherever_it_was_interrupted() {
        let losses = [5.0, 3.0, 3.0, 4.0, 2.0, 9.0, 9.0, 9.0, 1.0];
        for between in 1..10 {
            let counted = |stop: StopEntry| counted(&stop, &losses, between);
            assert_eq!(counted(StopEntry::default()), 9);
            let below = StopEntry { loss_below: Some(Positive(3.0)), ..StopEntry::default() };
            assert_eq!(counted(below), 5);
            let patient =
                |steps| StopEntry { patience: Some(Count(steps)), ..StopEntry::default() };
            // The same loss again is no smaller one.
            for (steps, end) in [(1, 3), (2, 4), (3, 8), (4, 9)] {
                assert_eq!(counted(patient(steps)), end);
            }
        }
    }

    #[test]
    fn seconds_of_all_runs_count_where_they_are_limited() {
        let stop = |seconds| StopEntry { seconds: Some(Positive(seconds)), ..StopEntry::default() };
        assert!(StopRules::new(&stop(1e-12), StopState::default()).is_time_up());
        let earlier = StopState { seconds: 60.0, ..StopState::default() };
        assert!(StopRules::new(&stop(60.0), earlier).is_time_up());
        let later = StopRules::new(&stop(1e6), earlier);
        assert!(!later.is_time_up());
        assert!(later.state().seconds >= 60.0);
        // Files of fits without a limit do not know the time.
        assert_eq!(StopRules::new(&StopEntry::default(), earlier).state(), StopState::default());
    }

    #[test]
    fn a_stage_counts_from_its_own_losses() {
        let stop = StopEntry { patience: Some(Count(2)), ..StopEntry::default() };
        let mut rules = StopRules::new(&stop, StopState::default());
        [1.0, 1.0].into_iter().for_each(|loss| rules.count(loss));
        rules.begin_stage();
        [5.0, 4.0, 4.0].into_iter().for_each(|loss| rules.count(loss));
        assert_eq!(rules.ended(), None);
        rules.count(4.0);
        assert!(
            rules
                .ended()
                .is_some_and(|message| message.starts_with("no smaller loss came in 2 steps"))
        );
    }

    #[test]
    fn held_out_views_end_a_stage_where_they_became_no_better_by_enough_for_too_long() {
        let measures = [20.0, 22.0, 22.4, 22.5, 22.5, 22.9, 22.0, 22.0, 30.0];
        let end = |patience, gain: f64| {
            let rule = HeldOutEntry {
                every: Count(10),
                patience: Count(patience),
                gain: (gain > 0.0).then_some(NotNegative(gain)),
            };
            let stop = StopEntry { held_out: Some(rule), ..StopEntry::default() };
            let mut rules = StopRules::new(&stop, StopState::default());
            assert!(rules.measures_after(20) && !rules.measures_after(21));
            measures.iter().position(|&psnr| {
                let text = serde_json::to_string(&rules.state()).unwrap();
                rules = StopRules::new(&stop, serde_json::from_str(&text).unwrap());
                rules.measure(psnr);
                let words = "held-out views became no better in ";
                let is_said = rules.ended().is_some_and(|ended| ended.starts_with(words));
                assert_eq!(is_said, rules.stop().is_some());
                is_said
            })
        };
        // The same again is no better; and a gain is over the best before, not over the last.
        assert_eq!((end(1, 0.0), end(2, 0.0), end(3, 0.0)), (Some(4), Some(7), None));
        assert_eq!((end(1, 0.45), end(2, 0.45), end(3, 0.45)), (Some(2), Some(5), Some(6)));
        let mut none = StopRules::new(&StopEntry::default(), StopState::default());
        assert!(!none.measures_after(0));
        [1.0; 9].into_iter().for_each(|psnr| none.measure(psnr));
        assert_eq!(none.stop(), None);
    }

    #[test]
    fn a_stage_measures_from_its_own_pictures() {
        let rule = HeldOutEntry { every: Count(1), patience: Count(1), gain: None };
        let stop = StopEntry { held_out: Some(rule), ..StopEntry::default() };
        let mut rules = StopRules::new(&stop, StopState::default());
        [30.0, 30.0].into_iter().for_each(|psnr| rules.measure(psnr));
        assert!(rules.stop().is_some());
        rules.begin_stage();
        assert_eq!(rules.stop(), None);
        rules.measure(20.0);
        assert_eq!(rules.stop(), None);
    }
}
