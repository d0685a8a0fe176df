//! Objectives, gradients, Jacobians and Hessian-vector products of a problem, from the tape.
//!
//! # Forward and backward
//! The gradient of `f = sum r^2` is one backward pass. Column j of the Jacobian of `r` is the
//! tangent of `r` over dual numbers whose tangent is unit vector j. `H v` is the tangent of the
//! gradient over dual numbers of tangent `v`: forward over reverse.
//!
//! Optimizers of other crates ask through shared references, so what changes is in a cell.

use std::cell::RefCell;

use bokashi_core::{Dual, Tape, Tensor, hvp, jvp};
use bokashi_fit::FitError;
use nalgebra::{DMatrix, DVector};

use super::ledger::{Budget, Halt, Ledger};
use super::problem::Problem;

/// A problem, evaluated and accounted for.
pub(crate) struct Evaluator<'a> {
    problem: &'a Problem,
    state: RefCell<State>,
}

struct State {
    tape: Tape<f64>,
    dual: Tape<Dual<f64>>,
    ledger: Ledger,
    /// How often in a row an answer was at hand.
    repeated: u32,
    /// The last point and its objective: asked again, it costs nothing.
    last: Option<(Vec<f64>, f64)>,
    /// The last gradient with its point.
    last_gradient: Option<(Vec<f64>, Vec<f64>)>,
    halt: Option<Halt>,
}

/// A method that asks for so many answers that are at hand has come to a stop without knowing it:
/// its step has vanished beside its point.
const MOST_REPEATED: u32 = 100;

impl State {
    /// Counts an answer that was at hand.
    fn repeat(&mut self) -> Result<(), Halt> {
        self.repeated += 1;
        if self.repeated > MOST_REPEATED { Err(Halt::Stalled) } else { Ok(()) }
    }
}

impl<'a> Evaluator<'a> {
    /// An evaluator of `problem`.
    ///
    /// # Errors
    /// [`Halt::Broken`] where the objective at the start is refused, not finite, or the minimum.
    pub(crate) fn new(problem: &'a Problem, budget: Budget) -> Result<Self, Halt> {
        let first = problem.objective(problem.start()).map_err(broken)?;
        let scale = first - problem.least();
        if !(scale > 0.0 && scale.is_finite()) {
            let rule = "a start needs a finite objective above the minimum";
            return Err(Halt::Broken(format!("{rule}, got {first}")));
        }
        let state = State {
            tape: Tape::new(),
            dual: Tape::new(),
            ledger: Ledger::new(budget, problem.least(), scale, problem.start()),
            repeated: 0,
            last: None,
            last_gradient: None,
            halt: None,
        };
        Ok(Self { problem, state: RefCell::new(state) })
    }

    pub(crate) fn problem(&self) -> &'a Problem {
        self.problem
    }

    /// Why the run had to end, if it had to.
    pub(crate) fn halt(&self) -> Option<Halt> {
        self.state.borrow().halt.clone()
    }

    /// The record, the evaluator given up.
    pub(crate) fn into_ledger(self) -> Ledger {
        let mut ledger = self.state.into_inner().ledger;
        ledger.close();
        ledger
    }

    /// Takes a gradient off the budget and notes its objective, for a caller that evaluates by
    /// itself.
    pub(crate) fn account(&self, value: f64, x: &[f64]) -> Result<(), Halt> {
        self.with(|state, _| {
            state.ledger.spend(2)?;
            state.ledger.counts.gradients += 1;
            state.ledger.note(value, x)
        })
    }

    /// Halts the run, for a caller that evaluates by itself.
    pub(crate) fn stop(&self, halt: Halt) -> Halt {
        self.state.borrow_mut().halt.get_or_insert(halt).clone()
    }

    /// Runs `work`, and keeps the reason if it halts.
    fn with<R>(
        &self,
        work: impl FnOnce(&mut State, &Problem) -> Result<R, Halt>,
    ) -> Result<R, Halt> {
        let mut state = self.state.borrow_mut();
        if let Some(halt) = &state.halt {
            return Err(halt.clone());
        }
        let result = work(&mut state, self.problem);
        if let Err(halt) = &result {
            state.halt = Some(halt.clone());
        }
        result
    }

    /// The objective at `x`; infinite where it is not finite or refused, so that a search along a
    /// line turns back.
    pub(crate) fn value(&self, x: &[f64]) -> Result<f64, Halt> {
        self.with(|state, problem| {
            if let Some((_, value)) = state.last.as_ref().filter(|(last, _)| last == x) {
                let value = *value;
                return state.repeat().map(|()| value);
            }
            state.repeated = 0;
            state.ledger.spend(1)?;
            state.ledger.counts.values += 1;
            state.tape.reset();
            let leaf = state.tape.constant(&vector(x));
            let recorded = problem.record(leaf).map(|r| r.square().sum().item());
            let value = recorded.ok().filter(|value| value.is_finite()).unwrap_or(f64::INFINITY);
            state.last = Some((x.to_vec(), value));
            state.ledger.note(value, x)?;
            Ok(value)
        })
    }

    /// The residuals at `x`.
    pub(crate) fn residuals(&self, x: &[f64]) -> Result<DVector<f64>, Halt> {
        self.with(|state, problem| {
            state.ledger.spend(1)?;
            state.ledger.counts.values += 1;
            state.tape.reset();
            let leaf = state.tape.constant(&vector(x));
            let residuals = problem.record(leaf).map_err(broken)?;
            let value = residuals.square().sum().item();
            state.ledger.note(value, x)?;
            Ok(DVector::from_column_slice(residuals.value().data()))
        })
    }

    /// The objective at `x` as [`Evaluator::value`] gives it, for a caller that goes on to ask for
    /// the gradient: both are computed at once.
    pub(crate) fn value_before_gradient(&self, x: &[f64]) -> Result<f64, Halt> {
        self.with(|state, problem| {
            if let Some((_, value)) = state.last.as_ref().filter(|(last, _)| last == x) {
                let value = *value;
                return state.repeat().map(|()| value);
            }
            state.repeated = 0;
            state.ledger.spend(2)?;
            state.ledger.counts.gradients += 1;
            state.tape.reset();
            let leaf = state.tape.leaf(&vector(x));
            let loss = problem.record(leaf).map(|r| r.square().sum());
            let result = loss.ok().and_then(|loss| {
                let gradient = loss.backward().ok()?.get_or_zeros(leaf).data().to_vec();
                let all = loss.item().is_finite() && finite("", &gradient).is_ok();
                all.then(|| (loss.item(), gradient))
            });
            let (value, gradient) = result.unzip();
            let value = value.unwrap_or(f64::INFINITY);
            state.last = Some((x.to_vec(), value));
            state.last_gradient = gradient.map(|gradient| (x.to_vec(), gradient));
            state.ledger.note(value, x)?;
            Ok(value)
        })
    }

    /// The gradient at `x`.
    pub(crate) fn gradient(&self, x: &[f64]) -> Result<Vec<f64>, Halt> {
        self.with(|state, problem| {
            if let Some((_, gradient)) = state.last_gradient.as_ref().filter(|(last, _)| last == x)
            {
                let gradient = gradient.clone();
                return state.repeat().map(|()| gradient);
            }
            state.repeated = 0;
            state.ledger.spend(2)?;
            state.ledger.counts.gradients += 1;
            state.tape.reset();
            let leaf = state.tape.leaf(&vector(x));
            let loss = problem.record(leaf).map_err(broken)?.square().sum();
            let value = loss.item();
            let gradients = loss.backward().map_err(|error| broken(error.into()))?;
            let gradient = gradients.get_or_zeros(leaf).data().to_vec();
            finite("the gradient", &gradient)?;
            state.last = Some((x.to_vec(), value));
            state.last_gradient = Some((x.to_vec(), gradient.clone()));
            state.ledger.note(value, x)?;
            Ok(gradient)
        })
    }

    /// The Jacobian of the residuals at `x`, one row per residual, by columns in forward mode.
    pub(crate) fn jacobian(&self, x: &[f64]) -> Result<DMatrix<f64>, Halt> {
        self.with(|state, problem| {
            state.ledger.spend(2 * x.len() as u64)?;
            state.ledger.counts.jacobians += 1;
            let point = Tensor::from_flat_fn([x.len()], |k| x[k]);
            let mut columns = Vec::with_capacity(x.len());
            for j in 0..x.len() {
                let unit = Tensor::from_flat_fn([x.len()], |k| if k == j { 1.0 } else { 0.0 });
                let column =
                    jvp(&mut state.dual, &[(&point, &unit)], |x| problem.record_dual(x[0]));
                let [_, column] = column.map_err(broken)?;
                columns.push(DVector::from_column_slice(column.data()));
            }
            let jacobian = DMatrix::from_columns(&columns);
            finite("the Jacobian", jacobian.as_slice())?;
            Ok(jacobian)
        })
    }

    /// The Hessian of the objective at `x` times `v`.
    pub(crate) fn hessian_times(&self, x: &[f64], v: &[f64]) -> Result<Vec<f64>, Halt> {
        self.with(|state, problem| {
            state.ledger.spend(4)?;
            state.ledger.counts.hessian_products += 1;
            let [point, along] =
                [x, v].map(|entries| Tensor::from_flat_fn([x.len()], |k| entries[k]));
            let products = hvp(&mut state.dual, &[(&point, &along)], |x| {
                Ok(problem.record_dual(x[0])?.square().sum())
            });
            let product = products.map_err(broken)?[0][1].data().to_vec();
            finite("a Hessian-vector product", &product)?;
            Ok(product)
        })
    }
}

fn vector(x: &[f64]) -> Tensor<f64> {
    Tensor::from_flat_fn([x.len()], |k| x[k])
}

fn broken(error: FitError) -> Halt {
    Halt::Broken(error.to_string())
}

fn finite(what: &str, entries: &[f64]) -> Result<(), Halt> {
    match entries.iter().find(|entry| !entry.is_finite()) {
        None => Ok(()),
        Some(entry) => Err(Halt::Broken(format!("{what} needs to be finite, got {entry}"))),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::stiff::problems::{literature, rotated_quadratic};

    fn budget(gradients: f64) -> Budget {
        Budget { gradients, time: Duration::from_secs(3600), target: 0.0 }
    }

    #[test]
    fn each_kind_of_evaluation_costs_what_the_ledger_says() {
        let problem = rotated_quadratic(3, 10.0, 0);
        let x = [0.1, 0.2, 0.3];
        type Ask = fn(&Evaluator<'_>, &[f64]) -> Result<(), Halt>;
        let asks: [(Ask, f64); 5] = [
            (|e, x| e.value(x).map(drop), 0.5),
            (|e, x| e.residuals(x).map(drop), 0.5),
            (|e, x| e.gradient(x).map(drop), 1.0),
            (|e, x| e.jacobian(x).map(drop), 3.0),
            (|e, x| e.hessian_times(x, &[1.0, 0.0, 0.0]).map(drop), 2.0),
        ];
        for (ask, cost) in asks {
            let evaluator = Evaluator::new(&problem, budget(100.0)).unwrap();
            ask(&evaluator, &x).unwrap();
            let spent = evaluator.into_ledger().history.last().unwrap().gradient_evaluations;
            assert_eq!(spent, cost);
        }
    }

    #[test]
    fn what_was_just_asked_costs_nothing_again() {
        let problem = rotated_quadratic(3, 10.0, 0);
        let evaluator = Evaluator::new(&problem, budget(100.0)).unwrap();
        let x = [0.1, 0.2, 0.3];
        let gradient = evaluator.gradient(&x).unwrap();
        assert_eq!(evaluator.gradient(&x).unwrap(), gradient);
        assert_eq!(evaluator.value(&x).unwrap(), problem.objective(&x).unwrap());
        assert_eq!(evaluator.into_ledger().now().gradient_evaluations, 1.0);
    }

    #[test]
    fn the_jacobian_gives_the_gradient() {
        // grad f = 2 J^T r.
        for problem in literature() {
            let evaluator = Evaluator::new(&problem, budget(1e9)).unwrap();
            let x = problem.start();
            let gradient = DVector::from_vec(evaluator.gradient(x).unwrap());
            let jacobian = evaluator.jacobian(x).unwrap();
            let product = 2.0 * jacobian.transpose() * evaluator.residuals(x).unwrap();
            let off = (&gradient - &product).amax();
            assert!(off <= 1e-12 * gradient.amax(), "{} {off}", problem.name());
        }
    }

    #[test]
    fn hessians_are_symmetric_and_those_of_the_quadratic_are_exact() {
        let problem = rotated_quadratic(6, 1e4, 1);
        let evaluator = Evaluator::new(&problem, budget(1e9)).unwrap();
        let x = problem.start();
        let unit = |j: usize| (0..6).map(|k| f64::from(u8::from(k == j))).collect::<Vec<_>>();
        let columns: Vec<_> = (0..6)
            .map(|j| DVector::from_vec(evaluator.hessian_times(x, &unit(j)).unwrap()))
            .collect();
        let hessian = DMatrix::from_columns(&columns);
        let jacobian = evaluator.jacobian(x).unwrap();
        assert!((&hessian - hessian.transpose()).amax() < 1e-15);
        assert!((hessian - 2.0 * jacobian.transpose() * jacobian).amax() < 1e-14);
    }

    #[test]
    fn asking_for_one_point_for_ever_ends_a_run() {
        let problem = rotated_quadratic(3, 10.0, 0);
        let evaluator = Evaluator::new(&problem, budget(10.0)).unwrap();
        let stalled = (0..1_000).find_map(|_| evaluator.value(&[0.5; 3]).err());
        assert_eq!(stalled, Some(Halt::Stalled));
    }

    #[test]
    fn after_a_halt_nothing_more_is_evaluated() {
        let problem = rotated_quadratic(3, 10.0, 0);
        let evaluator = Evaluator::new(&problem, budget(1.0)).unwrap();
        assert!(evaluator.gradient(&[0.0; 3]).is_ok());
        assert_eq!(evaluator.gradient(&[0.5; 3]), Err(Halt::Budget));
        // A cheaper one would still fit.
        assert_eq!(evaluator.value(&[0.5; 3]), Err(Halt::Budget));
        assert_eq!(evaluator.halt(), Some(Halt::Budget));
    }
}
