//! Methods on residuals and their Jacobian: argmin's Gauss-Newton and the crate
//! `levenberg-marquardt`.

use argmin::core::{Error, Executor, Jacobian, Operator};
use argmin::solver::gaussnewton::GaussNewton;
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::storage::Owned;
use nalgebra::{DMatrix, DVector, Dyn};

use crate::stiff::evaluator::Evaluator;

struct System<'a, 'p>(&'a Evaluator<'p>);

impl Operator for System<'_, '_> {
    type Param = DVector<f64>;
    type Output = DVector<f64>;

    fn apply(&self, x: &DVector<f64>) -> Result<DVector<f64>, Error> {
        Ok(self.0.residuals(x.as_slice())?)
    }
}

impl Jacobian for System<'_, '_> {
    type Param = DVector<f64>;
    type Jacobian = DMatrix<f64>;

    fn jacobian(&self, x: &DVector<f64>) -> Result<DMatrix<f64>, Error> {
        Ok(self.0.jacobian(x.as_slice())?)
    }
}

/// Runs Gauss-Newton with full steps: argmin's variant with a line search compares the norm of the
/// residuals with the slope of half its square.
pub(super) fn gauss_newton(evaluator: &Evaluator<'_>) -> Result<(), String> {
    let start = DVector::from_column_slice(evaluator.problem().start());
    let solver =
        GaussNewton::new().with_tolerance(f64::MIN_POSITIVE).map_err(|error| error.to_string())?;
    let run = Executor::new(System(evaluator), solver)
        .configure(|state| state.param(start).max_iters(u64::MAX))
        .run();
    run.map(drop).map_err(|error| error.to_string())
}

struct Squares<'a, 'p> {
    evaluator: &'a Evaluator<'p>,
    x: DVector<f64>,
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Squares<'_, '_> {
    type ParameterStorage = Owned<f64, Dyn>;
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.x.copy_from(x);
    }

    fn params(&self) -> DVector<f64> {
        self.x.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        self.evaluator.residuals(self.x.as_slice()).ok()
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        self.evaluator.jacobian(self.x.as_slice()).ok()
    }
}

/// Runs Levenberg-Marquardt.
pub(super) fn levenberg_marquardt(evaluator: &Evaluator<'_>) -> Result<(), String> {
    let x = DVector::from_column_slice(evaluator.problem().start());
    // The budget decides, not a number of its own.
    let patience = usize::MAX / (x.len() + 2);
    let solver = LevenbergMarquardt::new().with_patience(patience);
    let (_, report) = solver.minimize(Squares { evaluator, x });
    if report.termination.was_successful() {
        Ok(())
    } else {
        Err(format!("{:?}", report.termination))
    }
}
