//! The gradient against difference quotients.
//!
//! With upstream gradients `u`, the subject is the number `F = <u, out>`. Per entry `x` of an input,
//! with `D(h) = (F(x + h) - F(x - h)) / (2 h)`:
//!
//! - the reference is Richardson's `R = (4 D(h/2) - D(h)) / 3`, in error by `O(h^4)`;
//! - its error bar is `|R - D(h/2)|`, which is `O(h^2)`, plus the rounding of `F` over `h`: at least
//!   `ROUNDINGS eps sum |u out|`, more where `F` is measured to be noisier ([`noise`]);
//! - the law is `|gradient - R| <= bar + ROUNDINGS eps scale`, where `scale` is the largest entry of
//!   the gradient with respect to the same input, by either reckoning.
//!
//! Steps become shorter until the discrete state is the same on the whole stencil and the bar is a
//! millionth. An entry is left out where no step will do: the state changes however short the step,
//! or the bar stays above `VAGUE` of the scale and above the unit roundoff of a slope of 1.
//!
//! # Source
//! The noise level: Moré and Wild, *Estimating computational noise*, SIAM Journal on Scientific
//! Computing 33, 2011.

use bokashi_core::Tensor;

use super::adjoint::{direction, moved};
use crate::failure::{Broken, differentiated, entry};
use crate::run::{Point, dot, forward, largest};
use crate::trial::{NEGLIGIBLE, ROUNDINGS, Tally, Trial};

/// In units of `max(1, |x|)`. At the first the errors `h^4` and `eps / h` of a smooth subject
/// balance; the others are for subjects that bend more, or have kinks nearby.
const STEPS: [f64; 3] = [1e-3, 1e-4, 1e-5];
/// A bar this small, relative to the quotient, needs no shorter step.
const SHARP: f64 = 1e-6;
/// Three digits of a derivative are worth having, fewer are not.
const VAGUE: f64 = 1e-3;
/// Long enough to cross a rounding within the subject, and so short that the third difference of a
/// smooth function, 1e-21 of its third derivative, is below any rounding.
const NOISE_STEP: f64 = 1e-7;
/// Errors this many standard deviations large are rare in a quotient of four values.
const NOISE_MARGIN: f64 = 12.0;
/// The most entries looked at per input; a larger input has as many, evenly spread.
const MOST_ENTRIES: usize = 160;

/// A difference quotient and its error bar.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quotient {
    pub(crate) value: f64,
    pub(crate) bar: f64,
}

/// Richardson's pair for the slope at 0, from the values at `step`, `-step`, `step / 2` and
/// `-step / 2`, each in error by `rounding`.
pub(crate) fn richardson(step: f64, rounding: f64, values: [f64; 4]) -> Quotient {
    let [above, below, half_above, half_below] = values;
    let (wide, narrow) = ((above - below) / (2.0 * step), (half_above - half_below) / step);
    let value = (4.0 * narrow - wide) / 3.0;
    Quotient { value, bar: (value - narrow).abs() + rounding / step }
}

/// The values of `f` for [`richardson`], where it has all of them.
pub(crate) fn on_stencil<R>(step: f64, f: impl FnMut(f64) -> Option<R>) -> Option<[R; 4]> {
    let offsets = [step, -step, 0.5 * step, -0.5 * step];
    let values: Option<Vec<R>> = offsets.into_iter().map(f).collect();
    values?.try_into().ok()
}

pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    let size = trial.size();
    let upstream_size: f64 = trial.upstream.iter().flat_map(Tensor::data).map(|u| u.abs()).sum();
    let direction = direction(trial, 701);
    let noise = noise(|h| Some(vec![value(trial, &moved(trial, &direction, h))?]));
    let rounding = (ROUNDINGS * f64::EPSILON * size).max(noise);
    for (i, gradient) in trial.gradients() {
        let stride = gradient.size().div_ceil(MOST_ENTRIES).max(1);
        let entries = || (0..gradient.size()).step_by(stride);
        let quotients: Vec<_> = entries().map(|k| quotient(trial, i, k, size, rounding)).collect();
        let references = quotients.iter().flatten().map(|quotient| quotient.value.abs());
        let scale = references.fold(largest(gradient).max(NEGLIGIBLE * size), f64::max);
        // Where all of a gradient is 0, a bar below the rounding of slopes of 1 still says so.
        let vague = (VAGUE * scale).max(f64::EPSILON * upstream_size);
        for (k, quotient) in entries().zip(quotients) {
            let Some(Quotient { value, bar }) = quotient.filter(|q| q.bar <= vague) else {
                tally.left_out += 1;
                continue;
            };
            let bound = bar + ROUNDINGS * f64::EPSILON * scale;
            tally.compare((gradient.data()[k], value), bound, || {
                let entry_name = entry(&format!("in{i}"), gradient.shape(), k);
                format!("d {} / d {entry_name}", differentiated(&trial.upstream))
            })?;
        }
    }
    Ok(tally)
}

/// `F` at `point`, where the subject is on the same smooth piece.
fn value(trial: &Trial, point: &Point<f64>) -> Option<f64> {
    let (outputs, state) = forward(&*trial.case.subject, point).ok()?;
    let smooth = state == trial.nominal.state
        && outputs.len() == trial.upstream.len()
        && outputs.iter().zip(&trial.upstream).all(|(y, u)| y.shape() == u.shape());
    smooth.then(|| dot(&outputs, &trial.upstream).0)
}

/// The most rounding to expect of an entry of `f`: some standard deviations of the noisiest one, by
/// third differences over steps so short that a smooth function has none to speak of. The rounding of
/// the points themselves is in it. 0 where `f` is not smooth so close to 0.
pub(crate) fn noise(f: impl Fn(f64) -> Option<Vec<f64>>) -> f64 {
    const POINTS: usize = 13;
    let rows = (0..POINTS).map(|k| f(k as f64 * NOISE_STEP)).collect::<Option<Vec<_>>>();
    let Some(mut rows) = rows else { return 0.0 };
    for _ in 0..3 {
        let difference = |pair: &[Vec<f64>]| {
            pair[1].iter().zip(&pair[0]).map(|(after, before)| after - before).collect()
        };
        rows = rows.windows(2).map(difference).collect();
    }
    let square =
        |entry: usize| rows.iter().map(|row| row[entry].powi(2)).sum::<f64>() / rows.len() as f64;
    let largest = (0..rows[0].len()).map(square).fold(0.0, f64::max);
    // (3!)^2 / 6! of the variance of a third difference is the variance of a value.
    NOISE_MARGIN * (largest / 20.0).sqrt()
}

/// The quotient for entry `k` of input `i` with the first step that will do, or else the one with
/// the smallest bar; `None` where the subject is not smooth on any stencil.
fn quotient(trial: &Trial, i: usize, k: usize, size: f64, rounding: f64) -> Option<Quotient> {
    let x = trial.point[i].0.data()[k];
    let gradient = trial.nominal.gradients[i].as_ref()?.data()[k].abs();
    let mut moved = trial.point.clone();
    let mut value_at = |x: f64| {
        moved[i].0.data_mut()[k] = x;
        value(trial, &moved)
    };
    let mut best: Option<Quotient> = None;
    for step in STEPS {
        // A power of two, so that x + h - x is h but for the rounding of x + h itself.
        let step = (step * x.abs().max(1.0)).log2().floor().exp2();
        let Some(values) = on_stencil(step, |h| value_at(x + h)) else { continue };
        let new = richardson(step, rounding, values);
        if best.is_none_or(|best| new.bar < best.bar) {
            best = Some(new);
        }
        if new.bar <= SHARP * new.value.abs().max(gradient) || new.bar <= SHARP * NEGLIGIBLE * size
        {
            break;
        }
    }
    best
}
