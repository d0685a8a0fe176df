//! Irradiance by spherical harmonics.
//!
//! # Forward
//! `E(n) = sum_i a_i L_i Y_i(m)`, with `m = n / |n|` and the real spherical harmonics Y of the bands 0, 1 and 2:
//! `Y_0 = 1 / (2 sqrt(pi))`, `Y_1..3 = sqrt(3 / (4 pi)) (y, z, x)`,
//! `Y_4,5,7 = sqrt(15 / (4 pi)) (x y, y z, x z)`, `Y_6 = sqrt(5 / (16 pi)) (3 z^2 - 1)`,
//! `Y_8 = sqrt(15 / (16 pi)) (x^2 - y^2)`. The cosine of the angle has the factors `a = pi`, `2 pi / 3` and
//! `pi / 4` in these bands, 0 in band 3, and no more than `-pi / 24` beyond.
//!
//! # Backward
//! `L_bar_i = a_i sum_n E_bar(n) Y_i(m)`; `m_bar = sum_i a_i (L_i . E_bar) dY_i/dm`, and from there to n
//! as for any direction (`vector`). It is smooth everywhere.
//!
//! # Source
//! Ramamoorthi and Hanrahan, *An efficient representation for irradiance environment maps*, SIGGRAPH
//! 2001, eqs. (3), (8), (9). The mean error they find over environments is 1 %, the largest 3 % of the
//! largest irradiance.

use bokashi_core::parallel::{for_each_piece_mut, merge_ranges_into};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};

use crate::error::RenderError;
use crate::vector::{Direction, Vector3};

const NAME: &str = "irradiance";

/// Rows in one piece of work.
const ROWS_PER_PIECE: usize = 1 << 11;

/// The functions of bands 0, 1 and 2.
pub(super) const HARMONICS: usize = 9;

/// `sqrt(1 / (4 pi))`, `sqrt(3 / (4 pi))`, `sqrt(15 / (4 pi))`, `sqrt(5 / (16 pi))`,
/// `sqrt(15 / (16 pi))`.
const NORMS: [f64; 5] = [
    0.28209479177387814,
    0.4886025119029199,
    1.0925484305920792,
    0.31539156525252005,
    0.5462742152960396,
];

/// What the cosine makes of each function: `pi`, `2 pi / 3`, `pi / 4` by band.
const COSINE: [f64; HARMONICS] = {
    use std::f64::consts::{FRAC_PI_4, PI};
    let (one, two) = (2.0 * PI / 3.0, FRAC_PI_4);
    [PI, one, one, one, two, two, two, two, two]
};

/// The functions in a direction.
#[inline(always)]
pub(super) fn harmonics<S: Scalar>([x, y, z]: Vector3<S>) -> [S; HARMONICS] {
    let [a, b, c, d, e] = NORMS.map(S::from_f64);
    let three = S::from_f64(3.0);
    [
        a,
        b * y,
        b * z,
        b * x,
        c * (x * y),
        c * (y * z),
        d * (three * z * z - S::ONE),
        c * (x * z),
        e * (x * x - y * y),
    ]
}

/// `sum_i w_i dY_i/dm`.
#[inline(always)]
fn slope<S: Scalar>([x, y, z]: Vector3<S>, w: [S; HARMONICS]) -> Vector3<S> {
    let [_, b, c, d, e] = NORMS.map(S::from_f64);
    let (two, six) = (S::from_f64(2.0), S::from_f64(6.0));
    [
        b * w[3] + c * (y * w[4] + z * w[7]) + two * e * x * w[8],
        b * w[1] + c * (x * w[4] + z * w[5]) - two * e * y * w[8],
        b * w[2] + c * (y * w[5] + x * w[7]) + six * d * z * w[6],
    ]
}

/// The irradiance of surfaces with `normals: [N, 3]`, of any length but 0, in an environment whose radiance has
/// the `coefficients: [9, C]` in the real spherical harmonics of bands 0 to 2: `[N, C]`.
///
/// The order of the coefficients is (l, m) = (0, 0), (1, -1), (1, 0), (1, 1), (2, -2), .. (2, 2).
/// [`Prefilter::harmonics`](crate::Prefilter::harmonics) makes them of a cube map. Of an environment with a
/// small bright light the result can be a little below 0 on the far side.
///
/// # Errors
/// - [`RenderError::Shape`] unless coefficients are `[9, C]` and normals `[N, 3]`.
/// - [`RenderError::Direction`] for a normal of length 0.
/// - [`RenderError::NotFinite`] for a normal that is infinite or NaN.
/// - `TensorError::ForeignVariable` for variables of two tapes.
#[inline(never)]
pub fn irradiance<'t, T: Scalar>(
    coefficients: Var<'t, T>,
    normals: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    normals.tape().apply(Irradiance, &[coefficients, normals])
}

/// Inputs: coefficients `[9, C]`, normals `[N, 3]`. Output: `[N, C]`.
struct Irradiance;

/// A unit normal, and the functions there times what the cosine makes of them.
type Weights<S> = (Direction<S>, [S; HARMONICS]);

/// `None` where the normal is zero.
#[inline(always)]
fn weights<T: Scalar>(normal: &[T; 3]) -> Option<Weights<T::Wide>> {
    let direction = Direction::new(normal.map(T::widen))?;
    let functions = harmonics(direction.unit);
    let weights = std::array::from_fn(|i| T::Wide::from_f64(COSINE[i]) * functions[i]);
    Some((direction, weights))
}

impl<T: Scalar> Op<T> for Irradiance {
    /// Gradients of coefficients: sums of each piece, and of all.
    type Saved = [Vec<Vec<T::Wide>>; 2];
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let &[HARMONICS, channels] = &**inputs.shape(0) else {
            let rule = "coefficients of shape [9, C]";
            return Err(RenderError::shape(NAME, rule, inputs.shape(0)));
        };
        let &[count, 3] = &**inputs.shape(1) else {
            return Err(RenderError::shape(NAME, "normals of shape [N, 3]", inputs.shape(1)));
        };
        let (coefficients, (normals, _)) = (inputs.data(0), inputs.data(1).as_chunks::<3>());
        check(normals)?;
        let out = outputs.push([count, channels]);
        if channels == 0 {
            return Ok(());
        }
        for_each_piece_mut(out, channels * ROWS_PER_PIECE, |piece, out| {
            let normals = &normals[piece * ROWS_PER_PIECE..];
            for (out, normal) in out.chunks_exact_mut(channels).zip(normals) {
                let Some((_, weights)) = weights(normal) else { continue };
                for (c, out) in out.iter_mut().enumerate() {
                    let terms = weights.iter().enumerate();
                    let sum: T::Wide =
                        terms.map(|(i, &w)| w * coefficients[i * channels + c].widen()).sum();
                    *out = T::narrow(sum);
                }
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(1).input_if(0, inputs.needs(1))
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        [pieces, all]: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let channels = kept.input_shape(0)[1];
        let (bars, (normals, _)) = (kept.only_upstream(), kept.input(1).as_chunks::<3>());
        if channels == 0 {
            return;
        }
        if let Some(coefficients_bar) = gradients.get(0) {
            all.resize_with(1, Vec::new);
            let totals = &mut all[0];
            totals.clear();
            totals.resize(HARMONICS * channels, T::Wide::ZERO);
            let work = |rows: std::ops::Range<usize>, sums: &mut Vec<T::Wide>| {
                sums.clear();
                sums.resize(HARMONICS * channels, T::Wide::ZERO);
                let bars = bars[rows.start * channels..].chunks_exact(channels);
                for (normal, bar) in normals[rows].iter().zip(bars) {
                    let Some((_, weights)) = weights(normal) else { continue };
                    for (sums, weight) in sums.chunks_exact_mut(channels).zip(weights) {
                        for (sum, bar) in sums.iter_mut().zip(bar) {
                            *sum += weight * bar.widen();
                        }
                    }
                }
            };
            merge_ranges_into(pieces, normals.len(), ROWS_PER_PIECE, work, |sums| {
                totals.iter_mut().zip(sums).for_each(|(total, sum)| *total += *sum);
            });
            coefficients_bar.add_each(|k| T::narrow(totals[k]));
        }
        if let Some(normals_bar) = gradients.get(1) {
            let coefficients = kept.input(0);
            for_each_piece_mut(normals_bar.entries(), 3 * ROWS_PER_PIECE, |piece, entries| {
                let first = piece * ROWS_PER_PIECE;
                let rows = normals[first..].iter().zip(bars[first * channels..].chunks(channels));
                for (entry, (normal, bar)) in entries.as_chunks_mut::<3>().0.iter_mut().zip(rows) {
                    let Some(direction) = Direction::new(normal.map(T::widen)) else { continue };
                    let of_function = std::array::from_fn(|i| {
                        let coefficients = &coefficients[i * channels..][..channels];
                        let terms = coefficients.iter().zip(bar);
                        let sum: T::Wide = terms.map(|(l, bar)| l.widen() * bar.widen()).sum();
                        T::Wide::from_f64(COSINE[i]) * sum
                    });
                    let bar = direction.pull_back(slope(direction.unit, of_function));
                    for (entry, bar) in entry.iter_mut().zip(bar) {
                        *entry += T::narrow(bar);
                    }
                }
            });
        }
    }
}

/// # Errors
/// [`RenderError::NotFinite`] and [`RenderError::Direction`], for the first normal that is none.
fn check<T: Scalar>(normals: &[[T; 3]]) -> Result<(), RenderError> {
    let is_bad = |normal: &[T; 3]| {
        let is_zero = normal.iter().all(|&entry| entry == T::ZERO);
        is_zero || !normal.iter().all(|entry| entry.is_finite())
    };
    let Some(row) = normals.iter().position(is_bad) else { return Ok(()) };
    Err(match normals[row].iter().find(|entry| !entry.is_finite()) {
        None => RenderError::Direction { operation: NAME, row },
        Some(entry) => {
            let value = entry.to_f64();
            RenderError::NotFinite { operation: NAME, what: "normals", row, value }
        }
    })
}
