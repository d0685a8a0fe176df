//! Ten problems of the literature, each for what it is hard by.
//!
//! | problem | hard by |
//! |---|---|
//! | Rosenbrock | a curved valley |
//! | Freudenstein-Roth | a local minimum on the way from the start |
//! | Powell badly scaled, Brown badly scaled | parameters whose sizes differ by 1e6 and more |
//! | Meyer | exponents of samples, at a minimum that is not 0 |
//! | Osborne 1 | sums of exponentials, which are infinite near the start |
//! | Biggs EXP6 | the same, with a local minimum |
//! | Trigonometric | local minima in ten parameters |
//! | Brown almost linear | a singular Jacobian |
//! | Extended Powell | a Hessian that is singular at the minimum |
//!
//! # Source
//! The numbers in brackets are those of the source of [`super`].

use bokashi_core::{Scalar, TensorError, Var};
use bokashi_fit::FitError;

use super::super::problem::{Problem, Residuals, constants};

/// The ten problems.
pub fn literature() -> Vec<Problem> {
    let repeated = |values: &[f64], n: usize| values.iter().copied().cycle().take(n).collect();
    vec![
        Problem::new("Rosenbrock", vec![-1.2, 1.0], 0.0, Rosenbrock).minimiser_at([1.0, 1.0]),
        // Most methods end in the local minimum 48.98425 at (11.41, -0.8968).
        Problem::new("Freudenstein-Roth", vec![0.5, -2.0], 0.0, FreudensteinRoth)
            .minimiser_at([5.0, 4.0]),
        Problem::new("Powell badly scaled", vec![0.0, 1.0], 0.0, PowellBadlyScaled)
            .minimiser_at([1.098_159_329_699_759e-5, 9.106_146_739_867_459]),
        Problem::new("Brown badly scaled", vec![1.0, 1.0], 0.0, BrownBadlyScaled)
            .minimiser_at([1e6, 2e-6]),
        Problem::new("Meyer", vec![0.02, 4000.0, 250.0], 87.945_855_170_56, Meyer).minimiser_at([
            5.609_636_471e-3,
            6_181.346_346,
            345.223_634_6,
        ]),
        Problem::new("Osborne 1", vec![0.5, 1.5, -1.0, 0.01, 0.02], 5.464_894_697_5e-5, Osborne1)
            .minimiser_at([0.375_410_05, 1.935_846_9, -1.464_687_1, 0.012_867_535, 0.022_122_700]),
        // A local minimum 5.65565e-3 lies nearer to the start of many methods.
        Problem::new("Biggs EXP6", vec![1.0, 2.0, 1.0, 1.0, 1.0, 1.0], 0.0, BiggsExp6)
            .minimiser_at([1.0, 10.0, 1.0, 5.0, 4.0, 3.0]),
        // Also zero elsewhere, and with a local minimum 2.79506e-5: no minimiser to measure by.
        Problem::new("Trigonometric 10", vec![0.1; 10], 0.0, Trigonometric),
        // Also zero at (a, ..., a, a^(1 - n)) for another a, and 1 at (0, ..., 0, n + 1).
        Problem::new("Brown almost linear 10", vec![0.5; 10], 0.0, BrownAlmostLinear),
        Problem::new(
            "Extended Powell 20",
            repeated(&[3.0, -1.0, 0.0, 1.0], 20),
            0.0,
            ExtendedPowell,
        )
        .minimiser_at(vec![0.0; 20]),
    ]
}

/// The entry `k` of `x`, of shape `[1]`.
fn entry<'t, T: Scalar>(x: Var<'t, T>, k: usize) -> Result<Var<'t, T>, TensorError> {
    x.slice(0, k..k + 1)
}

/// The entries of `x: [N]`, of shape `[1]` each.
fn entries<'t, T: Scalar, const N: usize>(x: Var<'t, T>) -> Result<[Var<'t, T>; N], TensorError> {
    let mut all = [x; N];
    for (k, one) in all.iter_mut().enumerate() {
        *one = entry(x, k)?;
    }
    Ok(all)
}

/// Residuals of shape `[1]` each as one `[m]`.
fn stacked<'t, T: Scalar>(residuals: &[Var<'t, T>]) -> Result<Var<'t, T>, FitError> {
    Ok(Var::concat(residuals, 0)?)
}

/// `1, 2, ..., m`, times `step`.
fn multiples(m: usize, step: f64) -> Vec<f64> {
    (1..=m).map(|i| step * i as f64).collect()
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

/// `x1 exp(x2 / (t_i + x3)) - y_i`, `t_i = 45 + 5 i`: (10).
struct Meyer;

impl Residuals for Meyer {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        const Y: [f64; 16] = [
            34780.0, 28610.0, 23650.0, 19630.0, 16370.0, 13720.0, 11540.0, 9744.0, 8261.0, 7030.0,
            6005.0, 5147.0, 4427.0, 3820.0, 3307.0, 2872.0,
        ];
        let [x1, x2, x3] = entries(x)?;
        let t: Vec<f64> = multiples(16, 5.0).iter().map(|t| 45.0 + t).collect();
        Ok(x1 * (x2 / (constants(x, &t) + x3)).exp() - constants(x, &Y))
    }
}

/// `y_i - (x1 + x2 exp(-t_i x4) + x3 exp(-t_i x5))`, `t_i = 10 (i - 1)`: (17).
struct Osborne1;

impl Residuals for Osborne1 {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        const Y: [f64; 33] = [
            0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718,
            0.685, 0.658, 0.628, 0.603, 0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467,
            0.457, 0.448, 0.438, 0.431, 0.424, 0.420, 0.414, 0.411, 0.406,
        ];
        let [x1, x2, x3, x4, x5] = entries(x)?;
        let t: Vec<f64> = multiples(33, 10.0).iter().map(|t| t - 10.0).collect();
        let down = -constants(x, &t);
        Ok(constants(x, &Y) - (x1 + (down * x4).exp() * x2 + (down * x5).exp() * x3))
    }
}

/// `x3 exp(-t_i x1) - x4 exp(-t_i x2) + x6 exp(-t_i x5) - y_i`, `t_i = i / 10` to 1.3, `y_i =
/// exp(-t_i) - 5 exp(-10 t_i) + 3 exp(-4 t_i)`: (18).
struct BiggsExp6;

impl Residuals for BiggsExp6 {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2, x3, x4, x5, x6] = entries(x)?;
        let t = multiples(13, 0.1);
        let sample = |t: &f64| (-t).exp() - 5.0 * (-10.0 * t).exp() + 3.0 * (-4.0 * t).exp();
        let y: Vec<f64> = t.iter().map(sample).collect();
        let down = -constants(x, &t);
        let terms = (down * x1).exp() * x3 - (down * x2).exp() * x4 + (down * x5).exp() * x6;
        Ok(terms - constants(x, &y))
    }
}

/// `n - sum_j cos x_j + i (1 - cos x_i) - sin x_i`: (26).
struct Trigonometric;

impl Residuals for Trigonometric {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let off = -x.cos() + T::from_f64(1.0);
        Ok(off * constants(x, &multiples(x.shape().size(), 1.0)) - x.sin() + off.sum())
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

/// The entries of `x` whose index is `k` modulo `period`, of shape `[n / period, 1]`.
fn every<'t, T: Scalar>(x: Var<'t, T>, k: usize, period: usize) -> Result<Var<'t, T>, FitError> {
    let rows = x.shape().size() / period;
    Ok(x.reshape([rows, period])?.slice(1, k..k + 1)?)
}

/// `x1 + 10 x2, sqrt(5) (x3 - x4), (x2 - 2 x3)^2, sqrt(10) (x1 - x4)^2` of each four entries: (22).
struct ExtendedPowell;

impl Residuals for ExtendedPowell {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2, x3, x4] = [every(x, 0, 4)?, every(x, 1, 4)?, every(x, 2, 4)?, every(x, 3, 4)?];
        stacked(&[
            x1 + x2 * T::from_f64(10.0),
            (x3 - x4) * T::from_f64(5.0_f64.sqrt()),
            (x2 - x3 * T::from_f64(2.0)).square(),
            (x1 - x4).square() * T::from_f64(10.0_f64.sqrt()),
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
        let oracle: [Oracle; 10] = [
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
            (MGH::meyer, MGHInit::meyer(), None),
            (MGH::osborne_1, MGHInit::osborne_1(), None),
            (|x| MGH::aux(13).biggs_exp6(x), MGHInit::biggs_exp6(), Some(MGHMin::biggs_exp6())),
            (MGH::trigonometric, MGHInit::trigonometric(10), None),
            (MGH::brown_almost_linear, MGHInit::brown_almost_linear(10), None),
            (
                MGH::extended_powell_singular,
                MGHInit::extended_powell_singular(20),
                Some(MGHMin::extended_powell_singular(20)),
            ),
        ];
        agrees(&literature(), oracle);
    }

    #[test]
    fn values_at_the_start_are_those_worked_out_by_hand() {
        let all = literature();
        let value = |name: &str| {
            let problem = all.iter().find(|problem| problem.name() == name).expect(name);
            problem.objective(problem.start()).unwrap()
        };
        // 100 (1 - 1.44)^2 + 2.2^2.
        assert!((value("Rosenbrock") - 24.2).abs() < 1e-12);
        // Five times 49 + 5 + 1 + 160.
        assert!((value("Extended Powell 20") - 1075.0).abs() < 1e-11);
    }
}
