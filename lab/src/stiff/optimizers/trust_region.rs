//! argmin's trust region with Steihaug's conjugate gradients.
//!
//! What argmin calls the Hessian is here a point at which products are asked for: it multiplies
//! vectors by tangents of the tape's gradient and is never a matrix.

use std::cell::RefCell;

use argmin::core::{CostFunction, Error, Executor, Gradient, Hessian};
use argmin::solver::trustregion::{Steihaug, TrustRegion};
use argmin_math::ArgminDot;
use nalgebra::DVector;

use crate::stiff::evaluator::Evaluator;

/// Brown's problem lies 1e6 from its start; argmin's default of 100 would be a wall.
const LARGEST_RADIUS: f64 = 1e10;

struct Objective<'a, 'p>(&'a Evaluator<'p>);

impl CostFunction for Objective<'_, '_> {
    type Param = DVector<f64>;
    type Output = f64;

    fn cost(&self, x: &DVector<f64>) -> Result<f64, Error> {
        Ok(self.0.value(x.as_slice())?)
    }
}

impl Gradient for Objective<'_, '_> {
    type Param = DVector<f64>;
    type Gradient = DVector<f64>;

    fn gradient(&self, x: &DVector<f64>) -> Result<DVector<f64>, Error> {
        Ok(DVector::from_vec(self.0.gradient(x.as_slice())?))
    }
}

impl<'a, 'p> Hessian for Objective<'a, 'p> {
    type Param = DVector<f64>;
    type Hessian = Products<'a, 'p>;

    fn hessian(&self, x: &DVector<f64>) -> Result<Products<'a, 'p>, Error> {
        Ok(Products { evaluator: self.0, x: x.clone(), last: RefCell::new(None) })
    }
}

/// The Hessian at a point, as a map.
#[derive(Clone)]
struct Products<'a, 'p> {
    evaluator: &'a Evaluator<'p>,
    x: DVector<f64>,
    /// A vector and its product: Steihaug's method asks for each twice.
    last: RefCell<Option<(DVector<f64>, DVector<f64>)>>,
}

impl ArgminDot<DVector<f64>, DVector<f64>> for Products<'_, '_> {
    fn dot(&self, v: &DVector<f64>) -> DVector<f64> {
        if let Some((_, product)) = self.last.borrow().as_ref().filter(|(last, _)| last == v) {
            return product.clone();
        }
        // There is no way to fail here. NaN ends the conjugate gradients, and the evaluator, once
        // halted, refuses the next objective.
        let product = self.evaluator.hessian_times(self.x.as_slice(), v.as_slice());
        let product =
            product.map_or_else(|_| DVector::from_element(v.len(), f64::NAN), DVector::from_vec);
        *self.last.borrow_mut() = Some((v.clone(), product.clone()));
        product
    }
}

/// Runs the trust region.
pub(super) fn steihaug(evaluator: &Evaluator<'_>) -> Result<(), String> {
    let start = DVector::from_column_slice(evaluator.problem().start());
    // In exact numbers n would do.
    let iterations = 2 * start.len() as u64;
    let solver = TrustRegion::new(Steihaug::new().with_max_iters(iterations))
        .with_max_radius(LARGEST_RADIUS)
        .map_err(|error| error.to_string())?;
    let run = Executor::new(Objective(evaluator), solver)
        .configure(|state| state.param(start).max_iters(u64::MAX))
        .run();
    run.map(drop).map_err(|error| error.to_string())
}
