//! Problems of any number of parameters; numbers as in the source of [`super`].

use bokashi_core::{Scalar, Var};
use bokashi_fit::FitError;

use super::super::problem::{Problem, Residuals};
use super::numbers::{entry, given, stacked};
use super::valleys::powell_singular;

/// The problems of this file.
pub(super) fn problems() -> Vec<Problem> {
    let repeated = |values: &[f64], n: usize| values.iter().copied().cycle().take(n).collect();
    let n = 10;
    vec![
        Problem::new("Watson 6", vec![0.0; 6], 2.287_670_053_552_37e-3, Watson).minimiser_at([
            -0.015_725_086_4,
            1.012_434_869_4,
            -0.232_991_625_9,
            1.260_430_087_8,
            -1.513_728_922_7,
            0.992_996_432_4,
        ]),
        Problem::new("Extended Rosenbrock 20", repeated(&[-1.2, 1.0], 20), 0.0, ExtendedRosenbrock)
            .minimiser_at(vec![1.0; 20]),
        Problem::new(
            "Extended Powell 20",
            repeated(&[3.0, -1.0, 0.0, 1.0], 20),
            0.0,
            ExtendedPowell,
        )
        .minimiser_at(vec![0.0; 20]),
        // The minimiser has all entries alike; the objective then is a polynomial of one number.
        Problem::new(
            "Penalty I 10",
            (1..=n).map(|j| j as f64).collect(),
            7.087_651_467_090_369e-5,
            PenaltyI,
        )
        .minimiser_at(vec![0.158_122_297; n]),
        Problem::new("Penalty II 10", vec![0.5; n], 2.936_605_374_567_51e-4, PenaltyII),
        Problem::new(
            "Variably dimensioned 10",
            (1..=n).map(|j| 1.0 - j as f64 / n as f64).collect(),
            0.0,
            VariablyDimensioned,
        )
        .minimiser_at(vec![1.0; n]),
    ]
}

/// `sum_j (j - 1) x_j t_i^(j - 2) - (sum_j x_j t_i^(j - 1))^2 - 1`, `t_i = i / 29` below 1 and 1,
/// then `x1` and `x2 - x1^2 - 1`: (20).
struct Watson;

impl Residuals for Watson {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let (n, m) = (x.shape().size(), 29);
        let t = |i: usize| (i + 1) as f64 / 29.0;
        let powers: Vec<f64> = (0..m * n).map(|k| t(k / n).powi((k % n) as i32)).collect();
        let slopes: Vec<f64> = (0..m * n)
            .map(|k| match k % n {
                0 => 0.0,
                j => j as f64 * t(k / n).powi(j as i32 - 1),
            })
            .collect();
        let column = x.reshape([n, 1])?;
        let product =
            |matrix: &[f64]| given(x, matrix).reshape([m, n])?.matmul(column)?.reshape([m]);
        let curve = product(&slopes)? - product(&powers)?.square() - T::from_f64(1.0);
        let (x1, x2) = (entry(x, 0)?, entry(x, 1)?);
        stacked(&[curve, x1, x2 - x1.square() - T::from_f64(1.0)])
    }
}

/// The entries of `x` whose index is `k` modulo `period`, of shape `[n / period, 1]`.
fn every<'t, T: Scalar>(x: Var<'t, T>, k: usize, period: usize) -> Result<Var<'t, T>, FitError> {
    let rows = x.shape().size() / period;
    Ok(x.reshape([rows, period])?.slice(1, k..k + 1)?)
}

/// Rosenbrock's residuals for each pair of entries: (21).
struct ExtendedRosenbrock;

impl Residuals for ExtendedRosenbrock {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let (odd, even) = (every(x, 0, 2)?, every(x, 1, 2)?);
        stacked(&[(even - odd.square()) * T::from_f64(10.0), -odd + T::from_f64(1.0)])
    }
}

/// Powell's singular residuals for each four entries: (22).
struct ExtendedPowell;

impl Residuals for ExtendedPowell {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let fours = [every(x, 0, 4)?, every(x, 1, 4)?, every(x, 2, 4)?, every(x, 3, 4)?];
        stacked(&powell_singular(fours))
    }
}

/// `sqrt(1e-5) (x_i - 1)`, then `sum_j x_j^2 - 1/4`: (23).
struct PenaltyI;

impl Residuals for PenaltyI {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let small = T::from_f64(1e-5_f64.sqrt());
        let ball = x.square().sum().reshape([1])? - T::from_f64(0.25);
        stacked(&[(x - T::from_f64(1.0)) * small, ball])
    }
}

/// `x1 - 0.2`, `sqrt(1e-5) (e_i + e_(i-1) - y_i)` and `sqrt(1e-5) (e_i - exp(-1/10))` for `i` from 2,
/// `e_i = exp(x_i / 10)`, `y_i = exp(i / 10) + exp((i - 1) / 10)`, then
/// `sum_j (n - j + 1) x_j^2 - 1`: (24).
struct PenaltyII;

impl Residuals for PenaltyII {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let n = x.shape().size();
        let small = T::from_f64(1e-5_f64.sqrt());
        let tenth = |i: usize| (i as f64 / 10.0).exp();
        let y: Vec<f64> = (2..=n).map(|i| tenth(i) + tenth(i - 1)).collect();
        let weights: Vec<f64> = (1..=n).rev().map(|weight| weight as f64).collect();
        let exponentials = (x * T::from_f64(0.1)).exp();
        let (early, late) = (exponentials.slice(0, 0..n - 1)?, exponentials.slice(0, 1..n)?);
        stacked(&[
            entry(x, 0)? - T::from_f64(0.2),
            (late + early - given(x, &y)) * small,
            (late - T::from_f64((-0.1_f64).exp())) * small,
            (x.square() * given(x, &weights)).sum().reshape([1])? - T::from_f64(1.0),
        ])
    }
}

/// `x_i - 1`, then `s = sum_j j (x_j - 1)` and `s^2`: (25).
struct VariablyDimensioned;

impl Residuals for VariablyDimensioned {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let weights: Vec<f64> = (1..=x.shape().size()).map(|j| j as f64).collect();
        let off = x - T::from_f64(1.0);
        let sum = (off * given(x, &weights)).sum().reshape([1])?;
        stacked(&[off, sum, sum.square()])
    }
}

#[cfg(test)]
mod tests {
    use mgh::{MGH, MGHInit, MGHMin};

    use super::super::oracle::{Oracle, agrees};
    use super::*;

    #[test]
    fn values_starts_and_minima_are_those_of_an_independent_implementation() {
        let oracle: [Oracle; 6] = [
            (MGH::watson, MGHInit::watson(6), None),
            (
                MGH::extended_rosenbrock,
                MGHInit::extended_rosenbrock(20),
                Some(MGHMin::extended_rosenbrock(20)),
            ),
            (
                MGH::extended_powell_singular,
                MGHInit::extended_powell_singular(20),
                Some(MGHMin::extended_powell_singular(20)),
            ),
            (MGH::penalty1, MGHInit::penalty1(10), None),
            (MGH::penalty2, MGHInit::penalty2(10), None),
            (
                MGH::variably_dimensioned,
                MGHInit::variably_dimensioned(10),
                Some(MGHMin::variably_dimensioned(10)),
            ),
        ];
        agrees(&problems(), oracle);
    }
}
