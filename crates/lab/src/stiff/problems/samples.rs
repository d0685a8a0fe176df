//! Curves through measured or made-up samples; numbers as in the source of [`super`].

use bokashi_core::{Scalar, Var};
use bokashi_fit::FitError;

use super::super::problem::{Problem, Residuals};
use super::numbers::{entries, given};

/// The problems of this file.
pub(super) fn problems() -> Vec<Problem> {
    vec![
        Problem::new("Jennrich-Sampson", vec![0.3, 0.4], 124.362_182_355_614_7, JennrichSampson)
            .minimiser_at([0.257_825_214, 0.257_825_214]),
        Problem::new("Bard", vec![1.0; 3], 8.214_877_306_578_99e-3, Bard).minimiser_at([
            0.082_410_56,
            1.133_036_09,
            2.343_695_18,
        ]),
        Problem::new("Gaussian", vec![0.4, 1.0, 0.0], 1.127_932_769_619e-8, Gaussian)
            .minimiser_at([0.398_956_137_8, 1.000_019_085_3, 0.0]),
        Problem::new("Meyer", vec![0.02, 4000.0, 250.0], 87.945_855_170_56, Meyer).minimiser_at([
            5.609_636_471e-3,
            6_181.346_346,
            345.223_634_6,
        ]),
        // Also zero at (10, 1, -1), and wherever x1 = x2 and x3 = 0: no minimiser to measure by.
        Problem::new("Box 3D", vec![0.0, 10.0, 20.0], 0.0, Box3d),
        Problem::new(
            "Kowalik-Osborne",
            vec![0.25, 0.39, 0.415, 0.39],
            3.075_056_038_492_4e-4,
            KowalikOsborne,
        )
        .minimiser_at([0.192_806_9, 0.191_282_3, 0.123_056_5, 0.136_062_3]),
        Problem::new(
            "Brown-Dennis",
            vec![25.0, 5.0, -5.0, -1.0],
            85_822.201_626_356_28,
            BrownDennis,
        )
        .minimiser_at([-11.594_439_904_8, 13.203_630_051, -0.403_439_488, 0.236_778_774]),
        Problem::new("Osborne 1", vec![0.5, 1.5, -1.0, 0.01, 0.02], 5.464_894_697_5e-5, Osborne1)
            .minimiser_at([0.375_410_05, 1.935_846_9, -1.464_687_1, 0.012_867_535, 0.022_122_700]),
        // A local minimum 5.65565e-3 lies nearer to the start of many methods.
        Problem::new("Biggs EXP6", vec![1.0, 2.0, 1.0, 1.0, 1.0, 1.0], 0.0, BiggsExp6)
            .minimiser_at([1.0, 10.0, 1.0, 5.0, 4.0, 3.0]),
        Problem::new("Gulf", vec![5.0, 2.5, 0.15], 0.0, Gulf).minimiser_at([50.0, 25.0, 1.5]),
        Problem::new(
            "Osborne 2",
            vec![1.3, 0.65, 0.65, 0.7, 0.6, 3.0, 5.0, 7.0, 2.0, 4.5, 5.5],
            4.013_773_629_354_77e-2,
            Osborne2,
        )
        .minimiser_at([
            1.309_977_2,
            0.431_553_8,
            0.633_661_7,
            0.599_430_5,
            0.754_183_2,
            0.904_288_6,
            1.365_811_8,
            4.823_698_8,
            2.398_684_87,
            4.568_874_6,
            5.675_341_47,
        ]),
    ]
}

/// `1, 2, ..., m`, times `step`.
fn multiples(m: usize, step: f64) -> Vec<f64> {
    (1..=m).map(|i| step * i as f64).collect()
}

/// `2 + 2 i - (exp(i x1) + exp(i x2))`, `i` to 10: (6).
struct JennrichSampson;

impl Residuals for JennrichSampson {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2] = entries(x)?;
        let i = given(x, &multiples(10, 1.0));
        Ok(i.affine(T::from_f64(2.0), T::from_f64(2.0)) - ((i * x1).exp() + (i * x2).exp()))
    }
}

/// `y_i - (x1 + u_i / (v_i x2 + w_i x3))`, `u_i = i`, `v_i = 16 - i`, `w_i = min(u_i, v_i)`: (8).
struct Bard;

impl Residuals for Bard {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        const Y: [f64; 15] = [
            0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10,
            4.39,
        ];
        let [x1, x2, x3] = entries(x)?;
        let u = multiples(15, 1.0);
        let v: Vec<f64> = u.iter().map(|u| 16.0 - u).collect();
        let w: Vec<f64> = u.iter().zip(&v).map(|(u, v)| u.min(*v)).collect();
        let [y, u, v, w] = [&Y[..], &u, &v, &w].map(|values| given(x, values));
        Ok(y - (x1 + u / (v * x2 + w * x3)))
    }
}

/// `x1 exp(-x2 (t_i - x3)^2 / 2) - y_i`, `t_i = (8 - i) / 2`: (9).
struct Gaussian;

impl Residuals for Gaussian {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        const Y: [f64; 15] = [
            0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521, 0.3989, 0.3521, 0.2420, 0.1295,
            0.0540, 0.0175, 0.0044, 0.0009,
        ];
        let [x1, x2, x3] = entries(x)?;
        let t: Vec<f64> = multiples(15, 1.0).iter().map(|i| (8.0 - i) / 2.0).collect();
        let squares = (given(x, &t) - x3).square();
        Ok(x1 * (squares * x2 * T::from_f64(-0.5)).exp() - given(x, &Y))
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
        Ok(x1 * (x2 / (given(x, &t) + x3)).exp() - given(x, &Y))
    }
}

/// `exp(-t_i x1) - exp(-t_i x2) - x3 (exp(-t_i) - exp(-10 t_i))`, `t_i = i / 10` to 1: (12).
struct Box3d;

impl Residuals for Box3d {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2, x3] = entries(x)?;
        let t = multiples(10, 0.1);
        let decay: Vec<f64> = t.iter().map(|t| (-t).exp() - (-10.0 * t).exp()).collect();
        let down = -given(x, &t);
        Ok((down * x1).exp() - (down * x2).exp() - given(x, &decay) * x3)
    }
}

/// `y_i - x1 (u_i^2 + u_i x2) / (u_i^2 + u_i x3 + x4)`: (15).
struct KowalikOsborne;

impl Residuals for KowalikOsborne {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        const Y: [f64; 11] = [
            0.1957, 0.1947, 0.1735, 0.1600, 0.0844, 0.0627, 0.0456, 0.0342, 0.0323, 0.0235, 0.0246,
        ];
        const U: [f64; 11] = [
            4.0000, 2.0000, 1.0000, 0.5000, 0.2500, 0.1670, 0.1250, 0.1000, 0.0833, 0.0714, 0.0625,
        ];
        let [x1, x2, x3, x4] = entries(x)?;
        let u = given(x, &U);
        let squares = u.square();
        Ok(given(x, &Y) - (squares + u * x2) * x1 / (squares + u * x3 + x4))
    }
}

/// `(x1 + t_i x2 - exp(t_i))^2 + (x3 + x4 sin(t_i) - cos(t_i))^2`, `t_i = i / 5` to 4: (16).
struct BrownDennis;

impl Residuals for BrownDennis {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2, x3, x4] = entries(x)?;
        let t = given(x, &multiples(20, 0.2));
        let first = x1 + t * x2 - t.exp();
        let second = x3 + t.sin() * x4 - t.cos();
        Ok(first.square() + second.square())
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
        let down = -given(x, &t);
        Ok(given(x, &Y) - (x1 + (down * x4).exp() * x2 + (down * x5).exp() * x3))
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
        let down = -given(x, &t);
        let terms = (down * x1).exp() * x3 - (down * x2).exp() * x4 + (down * x5).exp() * x6;
        Ok(terms - given(x, &y))
    }
}

/// Samples of [`Gulf`]: 99 of the up to 100; the last has a residual without a slope at the minimum.
const GULF: usize = 99;

/// `exp(-|y_i - x2|^x3 / x1) - t_i`, `t_i = i / 100`, `y_i = 25 + (-50 ln t_i)^(2/3)`: (11), whose
/// printed `y_i m i x2` reads `y_i - x2`.
struct Gulf;

impl Residuals for Gulf {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        let [x1, x2, x3] = entries(x)?;
        let t = multiples(GULF, 0.01);
        let y: Vec<f64> = t.iter().map(|t| 25.0 + (-50.0 * t.ln()).powf(2.0 / 3.0)).collect();
        let power = ((given(x, &y) - x2).abs().ln() * x3).exp();
        Ok((-(power / x1)).exp() - given(x, &t))
    }
}

/// `y_i - (x1 exp(-t_i x5) + sum_k x_(1+k) exp(-(t_i - x_(8+k))^2 x_(5+k)))`, `k` to 3,
/// `t_i = (i - 1) / 10`: (19).
struct Osborne2;

impl Residuals for Osborne2 {
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError> {
        const Y: [f64; 65] = [
            1.366, 1.191, 1.112, 1.013, 0.991, 0.885, 0.831, 0.847, 0.786, 0.725, 0.746, 0.679,
            0.608, 0.655, 0.616, 0.606, 0.602, 0.626, 0.651, 0.724, 0.649, 0.649, 0.694, 0.644,
            0.624, 0.661, 0.612, 0.558, 0.533, 0.495, 0.500, 0.423, 0.395, 0.375, 0.372, 0.391,
            0.396, 0.405, 0.428, 0.429, 0.523, 0.562, 0.607, 0.653, 0.672, 0.708, 0.633, 0.668,
            0.645, 0.632, 0.591, 0.559, 0.597, 0.625, 0.739, 0.710, 0.729, 0.720, 0.636, 0.581,
            0.428, 0.292, 0.162, 0.098, 0.054,
        ];
        let [x1, x2, x3, x4, x5, x6, x7, x8, x9, x10, x11] = entries(x)?;
        let t: Vec<f64> = (0..Y.len()).map(|i| i as f64 / 10.0).collect();
        let t = given(x, &t);
        let peak = |height: Var<'t, T>, width: Var<'t, T>, center: Var<'t, T>| {
            (-((t - center).square() * width)).exp() * height
        };
        let peaks = peak(x2, x6, x9) + peak(x3, x7, x10) + peak(x4, x8, x11);
        Ok(given(x, &Y) - ((-(t * x5)).exp() * x1 + peaks))
    }
}

#[cfg(test)]
mod tests {
    use mgh::{MGH, MGHInit, MGHMin};

    use super::super::oracle::{Oracle, agrees};
    use super::*;

    #[test]
    fn values_starts_and_minima_are_those_of_an_independent_implementation() {
        let oracle: [Oracle; 11] = [
            (
                |x| MGH::aux(10).jennrich_and_sampson(x),
                MGHInit::jennrich_and_sampson(),
                Some(MGHMin::jennrich_and_sampson()),
            ),
            (MGH::bard, MGHInit::bard(), Some(MGHMin::bard())),
            (MGH::gaussian, MGHInit::gaussian(), Some(MGHMin::gaussian())),
            (MGH::meyer, MGHInit::meyer(), None),
            (|x| MGH::aux(10).box_3d(x), MGHInit::box_3d(), None),
            (MGH::kowalik_and_osborne, MGHInit::kowalik_and_osborne(), None),
            (
                |x| MGH::aux(20).brown_and_dennis(x),
                MGHInit::brown_and_dennis(),
                Some(MGHMin::brown_and_dennis()),
            ),
            (MGH::osborne_1, MGHInit::osborne_1(), None),
            (|x| MGH::aux(13).biggs_exp6(x), MGHInit::biggs_exp6(), Some(MGHMin::biggs_exp6())),
            (
                |x| MGH::aux(GULF).gulf_research_and_development(x),
                MGHInit::gulf_research_and_development(),
                Some(MGHMin::gulf_research_and_development()),
            ),
            (MGH::osborne_2, MGHInit::osborne_2(), None),
        ];
        agrees(&problems(), oracle);
    }
}
