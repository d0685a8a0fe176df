//! What a run spends, and the error it has reached by then.
//!
//! # The unit of cost
//! A *gradient evaluation* is one pass forward and one backward over the tape. Everything else is
//! counted in the same passes. An objective or residuals alone count 1/2. A pass in dual numbers
//! counts twice a plain pass. So `J v` counts 1, a Jacobian of n columns n, and a Hessian-vector
//! product 2.

use std::fmt;
use std::time::{Duration, Instant};

/// How far a run goes: the first limit that it meets ends it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budget {
    /// Gradient evaluations, see the module.
    pub gradients: f64,
    /// Wall-clock time.
    pub time: Duration,
    /// It ends below this error: nothing is left to show.
    pub target: f64,
}

/// Below 1e-8 by enough to see a rate of convergence, above the rounding of most problems.
pub const TARGET: f64 = 1e-12;

/// Errors that a problem is solved to: `10^-1` to `10^-8`.
pub const LEVELS: usize = 8;

/// Why a run must end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Halt {
    /// The error is below the target.
    Target,
    /// The budget is spent.
    Budget,
    /// It asks for the same point again and again.
    Stalled,
    /// Something was infinite or NaN, or an operation refused its inputs.
    Broken(String),
}

impl fmt::Display for Halt {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Target => write!(f, "the error is below the target"),
            Self::Budget => write!(f, "the budget is spent"),
            Self::Stalled => write!(f, "it asks for the same point again and again"),
            Self::Broken(why) => f.write_str(why),
        }
    }
}

impl std::error::Error for Halt {}

/// Cost and error at one time of a run.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Moment {
    /// Wall-clock seconds since the start.
    pub seconds: f64,
    /// Gradient evaluations, as [`Budget::gradients`] counts them.
    pub gradient_evaluations: f64,
    /// The least error so far.
    pub error: f64,
}

/// How often each kind of evaluation was asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct Counts {
    /// The objective or the residuals alone.
    pub values: u64,
    /// The gradient, with the objective.
    pub gradients: u64,
    /// The Jacobian of the residuals.
    pub jacobians: u64,
    /// A Hessian times a vector.
    pub hessian_products: u64,
}

/// An entry of the history stands for a fall of the error by a fifth or more.
const FALL: f64 = 0.8;

/// The record of one run.
#[derive(Debug)]
pub(crate) struct Ledger {
    start: Instant,
    budget: Budget,
    least: f64,
    scale: f64,
    /// Passes over the tape: half gradient evaluations.
    passes: u64,
    pub(crate) counts: Counts,
    pub(crate) best: f64,
    pub(crate) best_x: Vec<f64>,
    pub(crate) history: Vec<Moment>,
    /// When the error first was at most `10^-(k + 1)`.
    pub(crate) reached: [Option<Moment>; LEVELS],
}

impl Ledger {
    /// A ledger of errors `(f - least) / scale`.
    pub(crate) fn new(budget: Budget, least: f64, scale: f64, x: &[f64]) -> Self {
        let first = Moment { seconds: 0.0, gradient_evaluations: 0.0, error: 1.0 };
        Self {
            start: Instant::now(),
            budget,
            least,
            scale,
            passes: 0,
            counts: Counts::default(),
            best: 1.0,
            best_x: x.to_vec(),
            history: vec![first],
            reached: [None; LEVELS],
        }
    }

    /// Takes `passes` off the budget, before the work is done.
    pub(crate) fn spend(&mut self, passes: u64) -> Result<(), Halt> {
        let spent = (self.passes + passes) as f64 / 2.0 > self.budget.gradients;
        if spent || self.start.elapsed() > self.budget.time {
            return Err(Halt::Budget);
        }
        self.passes += passes;
        Ok(())
    }

    /// What was spent so far.
    pub(crate) fn now(&self) -> Moment {
        Moment {
            seconds: self.start.elapsed().as_secs_f64(),
            gradient_evaluations: self.passes as f64 / 2.0,
            error: self.best,
        }
    }

    /// Notes that the objective is `value` at `x`.
    pub(crate) fn note(&mut self, value: f64, x: &[f64]) -> Result<(), Halt> {
        // Minima are known to so many digits: rounding may carry a value below.
        let error = ((value - self.least) / self.scale).max(0.0);
        // False for NaN.
        if value.is_finite() && error < self.best {
            self.best = error;
            self.best_x.copy_from_slice(x);
            let now = self.now();
            for (k, reached) in (1..).zip(&mut self.reached) {
                if reached.is_none() && error <= f64::powi(10.0, -k) {
                    *reached = Some(now);
                }
            }
            if self.history.last().is_none_or(|last| error <= FALL * last.error) {
                self.history.push(now);
            }
        }
        if self.best <= self.budget.target { Err(Halt::Target) } else { Ok(()) }
    }

    /// Ends the record.
    pub(crate) fn close(&mut self) {
        self.history.push(self.now());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: Duration = Duration::from_secs(3600);

    fn ledger(gradients: f64) -> Ledger {
        let budget = Budget { gradients, time: HOUR, target: TARGET };
        Ledger::new(budget, 2.0, 100.0, &[0.0])
    }

    #[test]
    fn the_budget_ends_before_it_is_exceeded() {
        let mut ledger = ledger(2.5);
        for _ in 0..2 {
            assert_eq!(ledger.spend(2), Ok(()));
        }
        assert_eq!(ledger.spend(2), Err(Halt::Budget));
        assert_eq!(ledger.spend(1), Ok(()));
        assert_eq!(ledger.spend(1), Err(Halt::Budget));
        assert_eq!(ledger.now().gradient_evaluations, 2.5);
    }

    #[test]
    fn levels_are_noted_when_they_are_first_met() {
        let mut ledger = ledger(1e9);
        for (value, passes) in [(50.0, 2), (12.0, 2), (60.0, 2), (2.0 + 9e-5, 2), (2.1, 2)] {
            ledger.spend(passes).unwrap();
            ledger.note(value, &[value]).unwrap();
        }
        let at = |k: usize| ledger.reached[k].map(|moment| moment.gradient_evaluations);
        assert_eq!(at(0), Some(2.0));
        assert_eq!((at(1), at(5)), (Some(4.0), Some(4.0)));
        assert_eq!(at(6), None);
        assert_eq!(ledger.best_x, [2.0 + 9e-5]);
        let errors: Vec<f64> = ledger.history.iter().map(|moment| moment.error).collect();
        assert!(errors.windows(2).all(|pair| pair[1] < pair[0]), "{errors:?}");
    }

    #[test]
    fn below_the_target_a_run_halts_and_a_nan_is_no_progress() {
        let mut ledger = ledger(1e9);
        assert_eq!(ledger.note(f64::NAN, &[1.0]), Ok(()));
        assert_eq!((ledger.best, ledger.best_x[0]), (1.0, 0.0));
        assert_eq!(ledger.note(2.0, &[3.0]), Err(Halt::Target));
        assert_eq!((ledger.best, ledger.best_x[0]), (0.0, 3.0));
    }
}
