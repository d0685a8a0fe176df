//! How stiff a scene is: the condition of `J^T J`.
//!
//! # Forward
//! The singular values of `J` (and of its columns of one block) at a point; `condition =
//! (s_max / s_min)^2` over those above rounding. Directions below `max(m, n) eps s_max` change no
//! residual to first order: they are counted apart, as null directions, and not in the condition.
//! *Scaled* is the same with the columns of `J` scaled to length 1: no rates per parameter bring
//! the condition to less than `1 / n` of it.
//!
//! # Source
//! Null directions: the rule of MATLAB's and NumPy's `rank`. Scaling: van der Sluis, *Condition
//! numbers and equilibration of matrices*, Numerische Mathematik 14, 1969.

use std::time::Duration;

use nalgebra::DMatrix;

use super::evaluator::Evaluator;
use super::ledger::{Budget, Halt};
use super::problem::Problem;

/// The condition of one block of parameters at one point.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Conditioning {
    /// The problem.
    pub problem: String,
    /// Which of its starts.
    pub seed: u64,
    /// `start`, or `minimiser`: the truth.
    pub at: &'static str,
    /// The block of parameters, `all` for all of them.
    pub block: &'static str,
    /// How many parameters it has.
    pub parameters: usize,
    /// How many directions change no residual.
    pub null_directions: usize,
    /// Of `J^T J`, over the other directions; `null` without any.
    pub condition: Option<f64>,
    /// The same with columns scaled to length 1.
    pub condition_scaled: Option<f64>,
}

/// The conditions of `problem` at its start and at its minimiser, of all parameters and of each
/// block.
///
/// # Errors
/// [`Halt::Broken`] where the Jacobian is refused or not finite.
pub fn conditioning(problem: &Problem, seed: u64) -> Result<Vec<Conditioning>, Halt> {
    let time = Duration::MAX;
    let unlimited = Budget { gradients: f64::INFINITY, time, target: f64::NEG_INFINITY };
    let evaluator = Evaluator::new(problem, unlimited)?;
    let points = [("start", Some(problem.start())), ("minimiser", problem.minimiser())];
    let mut all = Vec::new();
    for (at, x) in points {
        let Some(x) = x else { continue };
        let jacobian = evaluator.jacobian(x)?;
        let whole = [("all", 0..problem.size())];
        let several = problem.blocks().len() > 1;
        let parts = problem.blocks().iter().filter(|_| several).cloned();
        for (block, columns) in whole.into_iter().chain(parts) {
            let part = jacobian.columns_range(columns.clone()).into_owned();
            let (condition, null_directions) = condition(&part);
            all.push(Conditioning {
                problem: problem.name().to_owned(),
                seed,
                at,
                block,
                parameters: columns.len(),
                null_directions,
                condition,
                condition_scaled: self::condition(&scaled(part)).0,
            });
        }
    }
    Ok(all)
}

/// The condition of `J^T J` over the directions that are not null, and how many are null.
fn condition(jacobian: &DMatrix<f64>) -> (Option<f64>, usize) {
    let (m, n) = jacobian.shape();
    // The triangular factor has the same singular values, and is as small as the block.
    let factor = if m > n { jacobian.clone().qr().r() } else { jacobian.clone() };
    let values = factor.singular_values();
    let largest = values.max();
    let rounding = m.max(n) as f64 * f64::EPSILON * largest;
    let counted: Vec<f64> = values.iter().copied().filter(|&value| value > rounding).collect();
    let least = counted.iter().copied().fold(f64::INFINITY, f64::min);
    let condition = (!counted.is_empty()).then(|| (largest / least).powi(2));
    (condition, n - counted.len())
}

/// Columns of length 1; those of zeros stay.
fn scaled(mut jacobian: DMatrix<f64>) -> DMatrix<f64> {
    for mut column in jacobian.column_iter_mut() {
        let length = column.norm();
        if length > 0.0 {
            column.unscale_mut(length);
        }
    }
    jacobian
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stiff::problems::rotated_quadratic;

    #[test]
    fn the_condition_of_the_rotated_quadratic_is_the_one_it_was_made_with() {
        for exponent in [0, 4, 8] {
            let expected = f64::powi(10.0, exponent);
            let problem = rotated_quadratic(10, expected, 2);
            for found in conditioning(&problem, 2).unwrap() {
                let condition = found.condition.unwrap();
                assert!((condition / expected - 1.0).abs() < 1e-6, "{condition} {expected}");
                assert_eq!((found.null_directions, found.parameters), (0, 10));
            }
        }
    }

    #[test]
    fn null_directions_are_counted_and_left_out() {
        // Columns 1, 10 and their sum.
        let rows = [[1.0, 0.0, 1.0], [0.0, 10.0, 10.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
        let jacobian = DMatrix::from_fn(4, 3, |i, j| rows[i][j]);
        let (condition, null) = condition(&jacobian);
        assert_eq!(null, 1);
        // J J^T = [[2, 10], [10, 200]]: its two eigenvalues.
        let root = (198.0_f64 * 198.0 + 400.0).sqrt();
        let expected = (202.0 + root) / (202.0 - root);
        assert!((condition.unwrap() / expected - 1.0).abs() < 1e-12);
        assert_eq!(self::condition(&DMatrix::zeros(4, 3)), (None, 3));
    }

    #[test]
    fn scaling_undoes_units() {
        let units = DMatrix::from_diagonal(&nalgebra::dvector![1e-3, 1.0, 1e4]);
        assert!((condition(&scaled(units)).0.unwrap() - 1.0).abs() < 1e-12);
    }
}
