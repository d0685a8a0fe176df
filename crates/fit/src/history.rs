//! The history of a fit: the loss, the error and the time of every step.

use bokashi_core::Scalar;

use crate::stopping::Stop;

/// A step as it was before its update; the last step of a history is the final state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step<M> {
    /// The number of updates before the step.
    pub step: u64,
    /// Wall-clock seconds since the start of the fit.
    pub seconds: f64,
    /// The loss.
    pub loss: f64,
    /// The errors against the truth, `()` where it is unknown.
    pub measure: M,
}

/// An update that was not zero and yet changed nothing in some entries of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Vanished {
    /// The number of updates before this one.
    pub step: u64,
    /// The index of the parameter in the list.
    pub parameter: usize,
    /// The number of its entries.
    pub entries: usize,
}

/// The history of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct History<M> {
    /// Every step, before its update; the last step is the final state.
    pub steps: Vec<Step<M>>,
    /// Milliseconds of each update: forward, backward and optimizer.
    pub step_ms: Vec<f64>,
    /// Milliseconds of the preparation of each step in `steps`: pose and reference image.
    pub preparation_ms: Vec<f64>,
    /// Updates below half a unit in the last place of some entries, in order. Steps and parameters without such
    /// updates are left out.
    pub vanished: Vec<Vanished>,
    /// The reason why the fit stopped.
    pub stop: Stop,
}

/// The most steps for which a history reserves memory. In longer fits the memory grows.
const MOST_RESERVED: u64 = 1 << 20;

impl<M> History<M> {
    /// An empty history, a [`Listener`](crate::Listener), with capacity for the states before and after each of
    /// `steps` updates.
    pub fn with_room_for(steps: u64) -> Self {
        let capacity = steps.min(MOST_RESERVED) as usize + 1;
        Self {
            steps: Vec::with_capacity(capacity),
            step_ms: Vec::with_capacity(capacity),
            preparation_ms: Vec::with_capacity(capacity),
            vanished: Vec::new(),
            stop: Stop::Steps,
        }
    }

    /// The state in which the fit started.
    ///
    /// # Panics
    /// Where the history is empty; a history that a fit returned never is.
    pub fn initial(&self) -> &Step<M> {
        self.steps.first().expect("a fit records its initial state")
    }

    /// The state that the fit ended in.
    ///
    /// # Panics
    /// Where the history is empty; a history that a fit returned never is.
    pub fn last(&self) -> &Step<M> {
        self.steps.last().expect("a fit records its final state")
    }

    /// The median milliseconds of an update: forward, backward and optimizer; `None` without one.
    pub fn step_ms_median(&self) -> Option<f64> {
        median(&self.step_ms)
    }

    /// The median milliseconds of a preparation: pose and reference image; `None` without one.
    pub fn preparation_ms_median(&self) -> Option<f64> {
        median(&self.preparation_ms)
    }

    /// The largest `error` in the last tenth of the run, with the final state. It shows spikes after convergence. NaN
    /// where an error is NaN.
    pub fn tail(&self, error: impl Fn(&Step<M>) -> f64) -> f64 {
        let from = self.steps.len() - self.steps.len().div_ceil(10);
        self.steps[from..].iter().map(error).fold(f64::NEG_INFINITY, Scalar::maximum_or_nan)
    }
}

/// The middle of the sorted values, the mean of the two middle ones of an even number.
fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let (below, above) = (sorted.len().checked_sub(1)? / 2, sorted.len() / 2);
    Some(0.5 * (sorted[below] + sorted[above]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_the_middle_or_the_mean_of_two() {
        assert_eq!(median(&[]), None);
        assert_eq!(median(&[3.0]), Some(3.0));
        assert_eq!(median(&[3.0, 1.0, 100.0]), Some(3.0));
        assert_eq!(median(&[4.0, 1.0, 100.0, 2.0]), Some(3.0));
    }

    #[test]
    fn the_tail_is_the_worst_of_the_last_tenth() {
        let mut history = History::with_room_for(20);
        for step in 0..=20 {
            history.steps.push(Step { step, seconds: 0.0, loss: 0.0, measure: 20.0 - step as f64 });
        }
        // 21 states: the last 3 are steps 18, 19 and 20.
        assert_eq!(history.tail(|step| step.measure), 2.0);
        history.steps[19].measure = 7.0;
        assert_eq!(history.tail(|step| step.measure), 7.0);
        history.steps[17].measure = 9.0;
        assert_eq!(history.tail(|step| step.measure), 7.0);
        history.steps[18].measure = f64::NAN;
        assert!(history.tail(|step| step.measure).is_nan());
    }
}
