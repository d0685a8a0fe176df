//! The rotated quadratic: linear least squares whose eigenvectors lie across the axes.
//!
//! # Forward
//! `r = D Q (x - 1)`, with `Q` a random rotation and `D` diagonal, its entries evenly spaced in
//! the logarithm from 1 to `1 / sqrt(condition)`: `J^T J = Q^T D^2 Q` has the condition asked for,
//! and no rate per parameter can help, since no axis is special.
//!
//! # Source
//! The rotation: Gram-Schmidt on a matrix of independent normal numbers is uniform over all
//! rotations and reflections (Stewart, *The efficient generation of random orthogonal matrices*,
//! SIAM Journal on Numerical Analysis 17(3), 1980); normal numbers by Box and Muller 1958.

use std::f64::consts::TAU;

use bokashi_core::{Scalar, Var};
use bokashi_fit::FitError;
use nalgebra::DMatrix;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::problem::{Problem, Residuals, constants};

/// The quadratic of `n` parameters and the given condition number of `J^T J`, rotated by `seed`.
/// It starts at 0; its minimum is 0, at all ones.
pub fn rotated_quadratic(n: usize, condition: f64, seed: u64) -> Problem {
    let rotation = orthogonal(n, seed);
    let spread = |i: usize| condition.powf(-0.5 * i as f64 / (n - 1).max(1) as f64);
    let matrix = (0..n * n).map(|k| spread(k / n) * rotation[(k / n, k % n)]).collect();
    let name = format!("Quadratic of 1e{:.0}", condition.log10());
    Problem::new(name, vec![0.0; n], 0.0, Quadratic { n, matrix }).minimiser_at(vec![1.0; n])
}

/// A random orthogonal matrix.
fn orthogonal(n: usize, seed: u64) -> DMatrix<f64> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    // In (0, 1]: its logarithm is finite.
    let mut uniform = || ((generator.next_u64() >> 11) + 1) as f64 / (1_u64 << 53) as f64;
    let mut normal = || (-2.0 * uniform().ln()).sqrt() * (TAU * uniform()).cos();
    let matrix = DMatrix::from_fn(n, n, |_, _| normal());
    matrix.qr().q()
}

struct Quadratic {
    n: usize,
    /// `D Q`, row-major.
    matrix: Vec<f64>,
}

impl Residuals for Quadratic {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let off = (x - T::from_f64(1.0)).reshape([self.n, 1])?;
        let matrix = constants(x, &self.matrix).reshape([self.n, self.n])?;
        Ok(matrix.matmul(off)?.reshape([self.n])?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rotation_is_orthogonal_and_the_seeds_differ() {
        for seed in 0..5 {
            let q = orthogonal(12, seed);
            let off = (&q * q.transpose() - DMatrix::identity(12, 12)).amax();
            assert!(off < 1e-14, "{off}");
            assert_ne!(q, orthogonal(12, seed + 1));
        }
    }

    #[test]
    fn the_condition_is_the_one_asked_for() {
        let (n, condition) = (10, 1e8);
        let rotation = orthogonal(n, 3);
        let problem = rotated_quadratic(n, condition, 3);
        // Along a row of Q the objective grows as the square of that row's entry of D.
        for i in 0..n {
            let x: Vec<f64> = (0..n).map(|k| 1.0 + rotation[(i, k)]).collect();
            let expected = condition.powf(-(i as f64) / (n - 1) as f64);
            let value = problem.objective(&x).unwrap();
            assert!((value - expected).abs() < 1e-15 + 1e-9 * expected, "{value} {expected}");
        }
        assert_eq!(problem.objective(&vec![1.0; n]).unwrap(), 0.0);
        assert_eq!(problem.name(), "Quadratic of 1e8");
    }
}
