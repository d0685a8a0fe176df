//! The optimizers: ours, and those of other crates behind thin adapters.
//!
//! Each starts at the problem's start and runs until the error is below the target, its budget is
//! spent, its own test says that it has converged, or something breaks. Tolerances of their own
//! tests are set as low as they go, so that none stops early by taste.

mod least_squares;
mod line_search;
mod ours;
mod trust_region;

use std::panic::{AssertUnwindSafe, catch_unwind};

use bokashi_fit::Optimizer;

use super::evaluator::Evaluator;
use super::ledger::{Budget, Counts, Halt, LEVELS, Moment};
use super::problem::{Family, Problem};

/// Learning rates that the first-order methods are tried at; every one is kept.
pub const RATES: [f64; 5] = [1e-4, 1e-3, 1e-2, 1e-1, 1.0];

/// An optimizer, with its learning rate where it has one.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Ours: steps along the gradient.
    GradientDescent {
        /// The learning rate.
        rate: f64,
    },
    /// Ours: Adam with its authors' constants.
    Adam {
        /// The learning rate.
        rate: f64,
    },
    /// Ours: AMSGrad with the constants of Adam's authors.
    AmsGrad {
        /// The learning rate.
        rate: f64,
    },
    /// argmin's L-BFGS with 7 pairs and the line search of More and Thuente.
    Lbfgs,
    /// argmin's trust region with Steihaug's conjugate gradients, over Hessian-vector products.
    TrustRegion,
    /// argmin's Gauss-Newton, full steps.
    GaussNewton,
    /// The crate `levenberg-marquardt`: MINPACK's.
    LevenbergMarquardt,
}

impl Method {
    /// Every method, those with a learning rate once per rate.
    pub fn all() -> Vec<Self> {
        let descent = RATES.map(|rate| Self::GradientDescent { rate });
        let adam = RATES.map(|rate| Self::Adam { rate });
        let ams_grad = RATES.map(|rate| Self::AmsGrad { rate });
        let others = [Self::Lbfgs, Self::TrustRegion, Self::GaussNewton, Self::LevenbergMarquardt];
        descent.into_iter().chain(adam).chain(ams_grad).chain(others).collect()
    }

    /// The name, without the rate.
    pub fn name(self) -> &'static str {
        match self {
            Self::GradientDescent { .. } => "gradient descent",
            Self::Adam { .. } => "Adam",
            Self::AmsGrad { .. } => "AMSGrad",
            Self::Lbfgs => "L-BFGS",
            Self::TrustRegion => "trust region",
            Self::GaussNewton => "Gauss-Newton",
            Self::LevenbergMarquardt => "Levenberg-Marquardt",
        }
    }

    /// The learning rate.
    pub fn rate(self) -> Option<f64> {
        match self {
            Self::GradientDescent { rate } | Self::Adam { rate } | Self::AmsGrad { rate } => {
                Some(rate)
            }
            _ => None,
        }
    }

    /// Runs the method; says why it ended.
    fn minimise(self, evaluator: &Evaluator<'_>) -> Result<(), String> {
        match self {
            Self::GradientDescent { rate } => {
                ours::descend(evaluator, Optimizer::GradientDescent, rate)
            }
            Self::Adam { rate } => ours::descend(evaluator, Optimizer::default(), rate),
            Self::AmsGrad { rate } => ours::descend(evaluator, Optimizer::ams_grad(), rate),
            Self::Lbfgs => line_search::lbfgs(evaluator),
            Self::TrustRegion => trust_region::steihaug(evaluator),
            Self::GaussNewton => least_squares::gauss_newton(evaluator),
            Self::LevenbergMarquardt => least_squares::levenberg_marquardt(evaluator),
        }
    }
}

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Outcome {
    /// The error is below the target.
    Reached,
    /// By the method's own test, or with steps that vanish, at an error above the target.
    Converged,
    /// The budget is spent.
    Budget,
    /// Something became infinite or NaN, or an operation refused its inputs.
    Diverged,
    /// The method gave up with an error of its own.
    Failed,
}

impl Outcome {
    /// In one word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::Converged => "converged",
            Self::Budget => "budget",
            Self::Diverged => "diverged",
            Self::Failed => "failed",
        }
    }
}

/// One optimizer on one problem.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Run {
    /// The problem.
    pub problem: String,
    /// Where the problem comes from.
    pub family: Family,
    /// Which of the problem's starts.
    pub seed: u64,
    /// The optimizer.
    pub optimizer: &'static str,
    /// Its learning rate; `null` where it has none.
    pub rate: Option<f64>,
    /// The least error is at most `10^-solved_to`; 0 where it is above 1e-1; at most 8.
    pub solved_to: usize,
    /// The least error: see the module `problem`.
    pub error: f64,
    /// Distance of the best point from the minimiser, over that of the start; `null` where no
    /// minimiser is known, or there are many.
    pub minimiser_error: Option<f64>,
    /// Wall-clock seconds in all.
    pub seconds: f64,
    /// Cost in all: see the module `ledger`.
    pub gradient_evaluations: f64,
    /// How often each kind of evaluation was asked for.
    pub counts: Counts,
    /// How it ended.
    pub outcome: Outcome,
    /// What the method said, where it did not reach the target.
    pub message: String,
    /// When the error first was at most 1e-1, 1e-2, ..., 1e-8; `null` where it never was.
    pub reached: [Option<Moment>; LEVELS],
    /// Falls of the least error by a fifth or more; the first entry is the start, the last the end.
    pub history: Vec<Moment>,
}

/// Runs `method` on `problem`. Whatever goes wrong is part of the result: a panic too.
pub fn run(problem: &Problem, seed: u64, method: Method, budget: Budget) -> Run {
    let mut run = Run {
        problem: problem.name().to_owned(),
        family: problem.family(),
        seed,
        optimizer: method.name(),
        rate: method.rate(),
        solved_to: 0,
        error: 1.0,
        minimiser_error: None,
        seconds: 0.0,
        gradient_evaluations: 0.0,
        counts: Counts::default(),
        outcome: Outcome::Failed,
        message: String::new(),
        reached: [None; LEVELS],
        history: Vec::new(),
    };
    let evaluator = match Evaluator::new(problem, budget) {
        Ok(evaluator) => evaluator,
        Err(halt) => {
            run.message = halt.to_string();
            return run;
        }
    };
    let ended = catch_unwind(AssertUnwindSafe(|| method.minimise(&evaluator)));
    (run.outcome, run.message) = match (evaluator.halt(), ended) {
        (Some(Halt::Target), _) => (Outcome::Reached, String::new()),
        (Some(Halt::Budget), _) => (Outcome::Budget, String::new()),
        (Some(Halt::Stalled), _) => (Outcome::Converged, Halt::Stalled.to_string()),
        (Some(Halt::Broken(why)), _) => (Outcome::Diverged, why),
        (None, Ok(Ok(()))) => (Outcome::Converged, String::new()),
        (None, Ok(Err(why))) => (Outcome::Failed, why),
        (None, Err(_)) => (Outcome::Failed, "it panicked".to_owned()),
    };
    let ledger = evaluator.into_ledger();
    let last = ledger.now();
    run.error = ledger.best;
    run.solved_to = ledger.reached.iter().flatten().count();
    run.minimiser_error = problem.minimiser().map(|minimiser| {
        distance(&ledger.best_x, minimiser) / distance(problem.start(), minimiser)
    });
    run.seconds = last.seconds;
    run.gradient_evaluations = last.gradient_evaluations;
    run.counts = ledger.counts;
    run.reached = ledger.reached;
    run.history = ledger.history;
    run
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::stiff::ledger::TARGET;
    use crate::stiff::problems::rotated_quadratic;

    const LIMIT: Budget =
        Budget { gradients: 2_000.0, time: Duration::from_secs(600), target: TARGET };

    #[test]
    fn every_method_solves_an_easy_quadratic() {
        let problem = rotated_quadratic(4, 4.0, 5);
        for method in Method::all() {
            let run = run(&problem, 0, method, LIMIT);
            // Rates that are too small for the budget, or too large to be stable, are no failure
            // of the adapter.
            if method.rate().is_some_and(|rate| rate != 0.1) {
                continue;
            }
            assert_eq!(run.solved_to, LEVELS, "{method:?} {run:?}");
            assert!(run.minimiser_error.unwrap() < 1e-3, "{method:?}");
            assert_eq!(run.reached.iter().flatten().count(), LEVELS);
        }
    }

    #[test]
    fn costs_are_counted_exactly() {
        let problem = rotated_quadratic(4, 4.0, 5);
        for method in Method::all() {
            let run = run(&problem, 0, method, LIMIT);
            let Counts { values, gradients, jacobians, hessian_products } = run.counts;
            let passes = values + 2 * gradients + 2 * 4 * jacobians + 4 * hessian_products;
            assert_eq!(run.gradient_evaluations, passes as f64 / 2.0, "{method:?}");
            assert!(run.gradient_evaluations <= LIMIT.gradients);
        }
        // Linear residuals: one Jacobian, one step.
        let newton = run(&problem, 0, Method::GaussNewton, LIMIT);
        let expected = Counts { values: 2, jacobians: 1, ..Counts::default() };
        assert_eq!((newton.counts, newton.outcome), (expected, Outcome::Reached));
    }

    #[test]
    fn failures_are_kept() {
        let problem = rotated_quadratic(4, 4.0, 5);
        let diverged = run(&problem, 0, Method::GradientDescent { rate: 1e3 }, LIMIT);
        assert_eq!(diverged.outcome, Outcome::Diverged);
        assert!(diverged.message.contains("needs to be finite"), "{}", diverged.message);
        assert_eq!(diverged.solved_to, 0);
        let starved = run(&problem, 0, Method::GradientDescent { rate: 1e-9 }, LIMIT);
        assert_eq!(starved.outcome, Outcome::Budget);
        assert_eq!(starved.gradient_evaluations, LIMIT.gradients);
    }
}
