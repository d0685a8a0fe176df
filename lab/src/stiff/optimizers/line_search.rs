//! argmin's L-BFGS.

use argmin::core::{CostFunction, Error, Executor, Gradient};
use argmin::solver::linesearch::MoreThuenteLineSearch;
use argmin::solver::quasinewton::LBFGS;
use nalgebra::DVector;

use crate::stiff::evaluator::Evaluator;

/// Pairs of steps and gradient changes that are remembered: between the 3 and 20 of its authors.
const PAIRS: usize = 7;

/// The objective as the line search asks for it: every point it tries needs the gradient too.
struct Objective<'a, 'p>(&'a Evaluator<'p>);

impl CostFunction for Objective<'_, '_> {
    type Param = DVector<f64>;
    type Output = f64;

    fn cost(&self, x: &DVector<f64>) -> Result<f64, Error> {
        Ok(self.0.value_before_gradient(x.as_slice())?)
    }
}

impl Gradient for Objective<'_, '_> {
    type Param = DVector<f64>;
    type Gradient = DVector<f64>;

    fn gradient(&self, x: &DVector<f64>) -> Result<DVector<f64>, Error> {
        Ok(DVector::from_vec(self.0.gradient(x.as_slice())?))
    }
}

/// Runs L-BFGS.
pub(super) fn lbfgs(evaluator: &Evaluator<'_>) -> Result<(), String> {
    let start = DVector::from_column_slice(evaluator.problem().start());
    let search = MoreThuenteLineSearch::new();
    let solver = LBFGS::new(search, PAIRS)
        .with_tolerance_grad(0.0)
        .and_then(|solver| solver.with_tolerance_cost(0.0))
        .map_err(|error| error.to_string())?;
    let run = Executor::new(Objective(evaluator), solver)
        .configure(|state| state.param(start).max_iters(u64::MAX))
        .run();
    run.map(drop).map_err(|error| error.to_string())
}
