//! Curved valleys and bad scales, in closed form; numbers as in the source of [`super`].

use bokashi_core::{Scalar, Var};
use bokashi_fit::FitError;

use super::super::problem::{Problem, Residuals};
use super::numbers::{entries, stacked};
use super::turn::turn;

/// The problems of this file.
pub(super) fn problems() -> Vec<Problem> {
    vec![
        Problem::new("Rosenbrock", vec![-1.2, 1.0], 0.0, Rosenbrock).minimiser_at([1.0, 1.0]),
        // Most methods end in the local minimum 48.98425 at (11.41, -0.8968).
        Problem::new("Freudenstein-Roth", vec![0.5, -2.0], 0.0, FreudensteinRoth)
            .minimiser_at([5.0, 4.0]),
        Problem::new("Powell badly scaled", vec![0.0, 1.0], 0.0, PowellBadlyScaled)
            .minimiser_at([1.098_159_329_699_759e-5, 9.106_146_739_867_459]),
        Problem::new("Brown badly scaled", vec![1.0, 1.0], 0.0, BrownBadlyScaled)
            .minimiser_at([1e6, 2e-6]),
        Problem::new("Beale", vec![1.0, 1.0], 0.0, Beale).minimiser_at([3.0, 0.5]),
        Problem::new("Helical valley", vec![-1.0, 0.0, 0.0], 0.0, HelicalValley)
            .minimiser_at([1.0, 0.0, 0.0]),
        Problem::new("Powell singular", vec![3.0, -1.0, 0.0, 1.0], 0.0, PowellSingular)
            .minimiser_at([0.0; 4]),
        Problem::new("Wood", vec![-3.0, -1.0, -3.0, -1.0], 0.0, Wood).minimiser_at([1.0; 4]),
    ]
}

/// `10 (x2 - x1^2), 1 - x1`: (1).
struct Rosenbrock;

impl Residuals for Rosenbrock {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2] = entries(x)?;
        stacked(&[(x2 - x1.square()) * T::from_f64(10.0), -x1 + T::from_f64(1.0)])
    }
}

/// `-13 + x1 + ((5 - x2) x2 - 2) x2, -29 + x1 + ((x2 + 1) x2 - 14) x2`: (2).
struct FreudensteinRoth;

impl Residuals for FreudensteinRoth {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2] = entries(x)?;
        let first = ((-x2 + T::from_f64(5.0)) * x2 - T::from_f64(2.0)) * x2;
        let second = ((x2 + T::from_f64(1.0)) * x2 - T::from_f64(14.0)) * x2;
        stacked(&[x1 + first - T::from_f64(13.0), x1 + second - T::from_f64(29.0)])
    }
}

/// `1e4 x1 x2 - 1, exp(-x1) + exp(-x2) - 1.0001`: (3).
struct PowellBadlyScaled;

impl Residuals for PowellBadlyScaled {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2] = entries(x)?;
        let product = (x1 * x2).affine(T::from_f64(1e4), T::from_f64(-1.0));
        stacked(&[product, (-x1).exp() + (-x2).exp() - T::from_f64(1.0001)])
    }
}

/// `x1 - 1e6, x2 - 2e-6, x1 x2 - 2`: (4).
struct BrownBadlyScaled;

impl Residuals for BrownBadlyScaled {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2] = entries(x)?;
        stacked(&[x1 - T::from_f64(1e6), x2 - T::from_f64(2e-6), x1 * x2 - T::from_f64(2.0)])
    }
}

/// `y_i - x1 (1 - x2^i)`: (5).
struct Beale;

impl Residuals for Beale {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2] = entries(x)?;
        let residual = |i: i32, y: f64| x1 * (x2.powi(i) - T::from_f64(1.0)) + T::from_f64(y);
        stacked(&[residual(1, 1.5), residual(2, 2.25), residual(3, 2.625)])
    }
}

/// `10 (x3 - 10 theta(x1, x2)), 10 (sqrt(x1^2 + x2^2) - 1), x3`, with `theta` the angle in turns,
/// from -1/4 to 3/4: (7).
struct HelicalValley;

impl Residuals for HelicalValley {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2, x3] = entries(x)?;
        let radius = (x1.square() + x2.square()).sqrt();
        let climb = x3 - turn(x1, x2)? * T::from_f64(10.0);
        stacked(&[
            climb * T::from_f64(10.0),
            radius.affine(T::from_f64(10.0), T::from_f64(-10.0)),
            x3,
        ])
    }
}

/// The residuals of Powell's singular function of four parameters.
pub(super) fn powell_singular<'t, T: Scalar>(x: [Var<'t, T>; 4]) -> [Var<'t, T>; 4] {
    let [x1, x2, x3, x4] = x;
    [
        x1 + x2 * T::from_f64(10.0),
        (x3 - x4) * T::from_f64(5.0_f64.sqrt()),
        (x2 - x3 * T::from_f64(2.0)).square(),
        (x1 - x4).square() * T::from_f64(10.0_f64.sqrt()),
    ]
}

/// `x1 + 10 x2, sqrt(5) (x3 - x4), (x2 - 2 x3)^2, sqrt(10) (x1 - x4)^2`: (13).
struct PowellSingular;

impl Residuals for PowellSingular {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        stacked(&powell_singular(entries(x)?))
    }
}

/// `10 (x2 - x1^2), 1 - x1, sqrt(90) (x4 - x3^2), 1 - x3, sqrt(10) (x2 + x4 - 2),
/// (x2 - x4) / sqrt(10)`: (14).
struct Wood;

impl Residuals for Wood {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2, x3, x4] = entries(x)?;
        stacked(&[
            (x2 - x1.square()) * T::from_f64(10.0),
            -x1 + T::from_f64(1.0),
            (x4 - x3.square()) * T::from_f64(90.0_f64.sqrt()),
            -x3 + T::from_f64(1.0),
            (x2 + x4 - T::from_f64(2.0)) * T::from_f64(10.0_f64.sqrt()),
            (x2 - x4) * T::from_f64(10.0_f64.sqrt().recip()),
        ])
    }
}

#[cfg(test)]
mod tests {
    use mgh::{MGH, MGHInit, MGHMin};

    use super::super::oracle::{Oracle, agrees};
    use super::*;

    #[test]
    fn values_starts_and_minima_are_those_of_an_independent_implementation() {
        let oracle: [Oracle; 8] = [
            (MGH::rosenbrock, MGHInit::rosenbrock(), Some(MGHMin::rosenbrock())),
            (
                MGH::freudenstein_and_roth,
                MGHInit::freudenstein_and_roth(),
                Some(MGHMin::freudenstein_and_roth()),
            ),
            (
                MGH::powell_badly_scaled,
                MGHInit::powell_badly_scaled(),
                Some(MGHMin::powell_badly_scaled()),
            ),
            (
                MGH::brown_badly_scaled,
                MGHInit::brown_badly_scaled(),
                Some(MGHMin::brown_badly_scaled()),
            ),
            (MGH::beale, MGHInit::beale(), Some(MGHMin::beale())),
            (MGH::hellical_valley, MGHInit::hellical_valley(), Some(MGHMin::hellical_valley())),
            (MGH::powell_singular, MGHInit::powell_singular(), Some(MGHMin::powell_singular())),
            (MGH::wood, MGHInit::wood(), Some(MGHMin::wood())),
        ];
        agrees(&problems(), oracle);
    }

    #[test]
    fn values_at_the_start_are_those_worked_out_by_hand() {
        let all = problems();
        let value = |name: &str| {
            let problem = all.iter().find(|problem| problem.name() == name).expect(name);
            problem.objective(problem.start()).unwrap()
        };
        // 100 (1 - 1.44)^2 + 2.2^2.
        assert!((value("Rosenbrock") - 24.2).abs() < 1e-12);
        // 49 + 5 + 1 + 160.
        assert!((value("Powell singular") - 215.0).abs() < 1e-12);
        // (-50)^2: half a turn from the x axis, on the circle of radius 1.
        assert!((value("Helical valley") - 2500.0).abs() < 1e-10);
        // 1.5^2 + 2.25^2 + 2.625^2.
        assert!((value("Beale") - 14.203_125).abs() < 1e-12);
    }
}
