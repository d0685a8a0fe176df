//! Systems of equations and other problems of any number of parameters; numbers as in the source of
//! [`super`].

use bokashi_core::{Scalar, Tensor, Var};
use bokashi_fit::FitError;

use super::super::problem::{Problem, Residuals};
use super::numbers::{given, stacked};

/// Parameters of every problem here but two.
const N: usize = 10;
/// Residuals of the linear ones.
const M: usize = 20;

/// The problems of this file.
pub(super) fn problems() -> Vec<Problem> {
    let n = N as f64;
    let fraction = |j: usize| (1 + j) as f64 * (1.0 / (n + 1.0));
    let bent: Vec<f64> = (0..N).map(|j| fraction(j) * (fraction(j) - 1.0)).collect();
    let spread: Vec<f64> = (1..=9).map(|j| f64::from(j) / 10.0).collect();
    let m = M as f64;
    vec![
        // Also zero elsewhere, and with a local minimum 2.79506e-5: no minimiser to measure by.
        Problem::new("Trigonometric 10", vec![1.0 / n; N], 0.0, Trigonometric),
        // Also zero at (a, ..., a, a^(1 - n)) for another a, and 1 at (0, ..., 0, n + 1).
        Problem::new("Brown almost linear 10", vec![0.5; N], 0.0, BrownAlmostLinear),
        Problem::new("Boundary value 10", bent.clone(), 0.0, BoundaryValue),
        Problem::new("Integral equation 10", bent, 0.0, IntegralEquation),
        Problem::new("Broyden tridiagonal 10", vec![-1.0; N], 0.0, BroydenTridiagonal),
        Problem::new("Broyden banded 10", vec![-1.0; N], 0.0, BroydenBanded),
        Problem::new("Linear, full rank", vec![1.0; N], m - n, LinearFullRank)
            .minimiser_at(vec![-1.0; N]),
        // Whole planes of minimisers.
        Problem::new(
            "Linear, rank 1",
            vec![1.0; N],
            m * (m - 1.0) / (2.0 * (2.0 * m + 1.0)),
            LinearRank1,
        ),
        Problem::new(
            "Linear, rank 1, zeros",
            vec![1.0; N],
            (m * m + 3.0 * m - 6.0) / (2.0 * (2.0 * m - 3.0)),
            LinearRank1WithZeros,
        ),
        // Any order of the entries will do.
        Problem::new("Chebyquad 9", spread, 0.0, Chebyquad),
    ]
}

/// `1, 2, ..., n` as constants.
fn counts<'t, T: Scalar>(x: Var<'t, T>) -> Var<'t, T> {
    let counts: Vec<f64> = (1..=x.shape().size()).map(|j| j as f64).collect();
    given(x, &counts)
}

/// `A x` for the matrix of `entry(i, j)`, of `rows` rows, indices from 1.
fn times<'t, T: Scalar>(
    rows: usize,
    x: Var<'t, T>,
    entry: impl Fn(usize, usize) -> f64,
) -> Result<Var<'t, T>, FitError> {
    let n = x.shape().size();
    let at = |k: usize| T::from_f64(entry(k / n + 1, k % n + 1));
    let matrix = x.tape().constant(&Tensor::from_fn([rows, n], at));
    Ok(matrix.matmul(x.reshape([n, 1])?)?.reshape([rows])?)
}

/// `n - sum_j cos x_j + i (1 - cos x_i) - sin x_i`: (26).
struct Trigonometric;

impl Residuals for Trigonometric {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let off = -x.cos() + T::from_f64(1.0);
        Ok(off * counts(x) - x.sin() + off.sum())
    }
}

/// `x_i + sum_j x_j - (n + 1)` up to `i = n - 1`, then `prod_j x_j - 1`: (27).
struct BrownAlmostLinear;

impl Residuals for BrownAlmostLinear {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let n = x.shape().size();
        let sums = x.slice(0, 0..n - 1)? + x.sum() - T::from_f64((n + 1) as f64);
        let mut product = x.slice(0, 0..1)?;
        for k in 1..n {
            product = product * x.slice(0, k..k + 1)?;
        }
        stacked(&[sums, product - T::from_f64(1.0)])
    }
}

/// `2 x_i - x_(i-1) - x_(i+1) + h^2 (x_i + t_i + 1)^3 / 2`, `h = 1 / (n + 1)`, `t_i = i h`, and 0
/// beyond both ends: (28).
struct BoundaryValue;

impl Residuals for BoundaryValue {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let n = x.shape().size();
        let h = 1.0 / (n + 1) as f64;
        let second = times(n, x, |i, j| match i.abs_diff(j) {
            0 => 2.0,
            1 => -1.0,
            _ => 0.0,
        })?;
        let cube = (x + counts(x) * T::from_f64(h) + T::from_f64(1.0)).powi(3);
        Ok(second + cube * T::from_f64(0.5 * h * h))
    }
}

/// `x_i + h / 2 ((1 - t_i) sum_(j<=i) t_j c_j + t_i sum_(j>i) (1 - t_j) c_j)`,
/// `c_j = (x_j + t_j + 1)^3`, `h` and `t` as in [`BoundaryValue`]: (29).
struct IntegralEquation;

impl Residuals for IntegralEquation {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let n = x.shape().size();
        let h = 1.0 / (n + 1) as f64;
        let t = |i: usize| i as f64 * h;
        let cube = (x + counts(x) * T::from_f64(h) + T::from_f64(1.0)).powi(3);
        let kernel =
            |i: usize, j: usize| if j <= i { (1.0 - t(i)) * t(j) } else { t(i) * (1.0 - t(j)) };
        Ok(x + times(n, cube, |i, j| 0.5 * h * kernel(i, j))?)
    }
}

/// `(3 - 2 x_i) x_i - x_(i-1) - 2 x_(i+1) + 1`, 0 beyond both ends: (30).
struct BroydenTridiagonal;

impl Residuals for BroydenTridiagonal {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let beside = times(x.shape().size(), x, |i, j| match (i, j) {
            _ if j + 1 == i => 1.0,
            _ if j == i + 1 => 2.0,
            _ => 0.0,
        })?;
        Ok(x * T::from_f64(3.0) - x.square() * T::from_f64(2.0) - beside + T::from_f64(1.0))
    }
}

/// `x_i (2 + 5 x_i^2) + 1 - sum x_j (1 + x_j)` over `j` from `i - 5` to `i + 1` but `i`: (31).
struct BroydenBanded;

impl Residuals for BroydenBanded {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let near = |i: usize, j: usize| j != i && j + 5 >= i && j <= i + 1;
        let band = times(x.shape().size(), x + x.square(), |i, j| f64::from(u8::from(near(i, j))))?;
        Ok(x * T::from_f64(2.0) + x.powi(3) * T::from_f64(5.0) + T::from_f64(1.0) - band)
    }
}

/// `x_i - 2 / m sum_j x_j - 1` up to `i = n`, then without `x_i`, to m: (32).
struct LinearFullRank;

impl Residuals for LinearFullRank {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let share = 2.0 / M as f64;
        let own = |i: usize, j: usize| f64::from(u8::from(i == j));
        Ok(times(M, x, |i, j| own(i, j) - share)? - T::from_f64(1.0))
    }
}

/// `i sum_j j x_j - 1`, `i` to m: (33).
struct LinearRank1;

impl Residuals for LinearRank1 {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        Ok(times(M, x, |i, j| (i * j) as f64)? - T::from_f64(1.0))
    }
}

/// `(i - 1) sum_j j x_j - 1` with `j` from 2 to n - 1, and -1 for `i = 1` and `i = m`: (34).
struct LinearRank1WithZeros;

impl Residuals for LinearRank1WithZeros {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let n = x.shape().size();
        let entry = |i: usize, j: usize| match (i, j) {
            (M, _) | (_, 1) => 0.0,
            (_, j) if j == n => 0.0,
            (i, j) => ((i - 1) * j) as f64,
        };
        Ok(times(M, x, entry)? - T::from_f64(1.0))
    }
}

/// The mean of the i-th Chebyshev polynomial of `2 x_j - 1` less its integral over `[0, 1]`, which
/// is `-1 / (i^2 - 1)` for even i and 0 for odd ones, `i` to n: (35).
struct Chebyquad;

impl Residuals for Chebyquad {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let z = x * T::from_f64(2.0) - T::from_f64(1.0);
        let (mut before, mut polynomial) = (z * T::from_f64(0.0) + T::from_f64(1.0), z);
        let mut residuals = Vec::new();
        for i in 1..=x.shape().size() {
            let integral = if i % 2 == 0 { -1.0 / ((i * i) as f64 - 1.0) } else { 0.0 };
            residuals.push(polynomial.mean()?.reshape([1])? - T::from_f64(integral));
            (before, polynomial) = (polynomial, z * polynomial * T::from_f64(2.0) - before);
        }
        stacked(&residuals)
    }
}

#[cfg(test)]
mod tests {
    use mgh::{MGH, MGHInit};

    use super::super::oracle::{Oracle, agrees};
    use super::*;

    #[test]
    fn values_and_starts_are_those_of_an_independent_implementation() {
        let oracle: [Oracle; 10] = [
            (MGH::trigonometric, MGHInit::trigonometric(N), None),
            (MGH::brown_almost_linear, MGHInit::brown_almost_linear(N), None),
            (MGH::discrete_boundary_value, MGHInit::discrete_boundary_value(N), None),
            (MGH::discrete_integral_equation, MGHInit::discrete_integral_equation(N), None),
            (MGH::broyden_tridiagonal, MGHInit::broyden_tridiagonal(N), None),
            (MGH::broyden_banded, MGHInit::broyden_banded(N), None),
            (|x| MGH::aux(M).linear_full_rank(x), MGHInit::linear_full_rank(N), None),
            (|x| MGH::aux(M).linear_rank_1(x), MGHInit::linear_rank_1(N), None),
            (|x| MGH::aux(M).linear_rank_1_zero(x), MGHInit::linear_rank_1_zero(N), None),
            (|x| MGH::aux(9).chebyquad(x), MGHInit::chebyquad(9), None),
        ];
        agrees(&problems(), oracle);
    }
}
