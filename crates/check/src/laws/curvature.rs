//! Hessian-vector products, forward over reverse: the backward pass over dual numbers.
//!
//! For `F = <u, out>` with Hessian `H`: `<H v, w> = <v, H w>` to rounding, and `H v` agrees with a
//! Richardson pair of differences of the gradient along `v`. So the derivative of the backward
//! pass is checked too, wherever a subject is used for second-order methods.
//!
//! The rounding of the gradient `g` is at least `ROUNDINGS eps max |g|`, more where `g` is measured to
//! be noisier along `v` ([`noise`]). It is where terms of `g` cancel: `x + h v` is rounded, which moves
//! `g` by up to `eps |H| |x|`, however small `g` is. A gradient that is quadratic in h has nothing else
//! in its error bar.

use bokashi_core::Tensor;

use super::adjoint::{direction, is_smooth, rounding};
use super::differences::{Quotient, noise, on_stencil, richardson};
use crate::failure::{Broken, differentiated, entry};
use crate::run::{Point, along, dot, largest, run};
use crate::trial::{NEGLIGIBLE, ROUNDINGS, Tally, Trial};

/// As for the gradient, but along one direction, and the differences are of gradients.
const STEPS: [f64; 3] = [1e-3, 1e-4, 1e-5];
const SHARP: f64 = 1e-6;
const VAGUE: f64 = 1e-3;

pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    let directions = [direction(trial, 201), direction(trial, 301)];
    if !directions.iter().all(|direction| is_smooth(trial, direction)) {
        tally.left_out += 1;
        return Ok(tally);
    }
    let [along_v, along_w] = directions.each_ref().map(|v| products(trial, v));
    let (along_v, along_w) = (along_v?, along_w?);
    let present = |tensors: &[Option<Tensor<f64>>]| tensors.iter().flatten().cloned().collect();
    let inputs: Vec<usize> = trial.gradients().map(|(i, _)| i).collect();
    let [v, w] = directions.each_ref().map(|v| inputs.iter().map(|&i| &v[i]));
    let (hv, hw): (Vec<_>, Vec<_>) = (present(&along_v), present(&along_w));
    let (left, left_size) = dot(&hv, w);
    let (right, right_size) = dot(v, &hw);
    let bound = rounding(trial) * (left_size + right_size + gradient_size(trial));
    tally.compare((left, right), bound, || "<H v, w> against <v, H w>".to_owned())?;

    for (&i, hv) in inputs.iter().zip(&hv) {
        let gradient = trial.nominal.gradients[i].as_ref().expect("a differentiable input");
        // The gradient's own rounding, also where the Hessian is zero.
        let size = largest(gradient).max(NEGLIGIBLE * trial.size());
        let quotients = quotients(trial, &directions[0], i, size);
        let Some(quotients) = quotients else {
            tally.left_out += 1;
            continue;
        };
        let values = quotients.iter().map(|quotient| quotient.value.abs());
        let scale = values.fold(largest(hv).max(NEGLIGIBLE * size), f64::max);
        for (k, (&got, Quotient { value, bar })) in hv.data().iter().zip(quotients).enumerate() {
            if bar > VAGUE * scale {
                tally.left_out += 1;
                continue;
            }
            let bound = bar + ROUNDINGS * f64::EPSILON * (scale + size);
            tally.compare((got, value), bound, || {
                let entry_name = entry(&format!("in{i}"), hv.shape(), k);
                format!(
                    "derivative along v of d {} / d {entry_name}",
                    differentiated(&trial.upstream)
                )
            })?;
        }
    }
    Ok(tally)
}

fn gradient_size(trial: &Trial) -> f64 {
    trial.gradients().map(|(_, gradient)| largest(gradient)).fold(0.0, f64::max)
}

/// `H v` per input.
fn products(trial: &Trial, v: &[Tensor<f64>]) -> Result<Vec<Option<Tensor<f64>>>, Broken> {
    let run = along(&trial.case, &trial.upstream, v);
    let run =
        run.map_err(|error| Broken::from_message(format!("refused over dual numbers: {error}")))?;
    Ok(run.gradients.iter().map(|gradient| gradient.as_ref().map(Tensor::tangents)).collect())
}

/// The gradient's quotients along `v`, for every entry of input `i`, with the first step that will
/// do, or else the one with the smallest bar.
fn quotients(trial: &Trial, v: &[Tensor<f64>], i: usize, size: f64) -> Option<Vec<Quotient>> {
    let gradient_at = |h: f64| -> Option<Tensor<f64>> {
        let along = |((x, needs), v): (&(Tensor<f64>, bool), &Tensor<f64>)| {
            (Tensor::from_flat_fn(x.shape(), |k| x.data()[k] + h * v.data()[k]), *needs)
        };
        let point: Point<f64> = trial.point.iter().zip(v).map(along).collect();
        let run = run(&*trial.case.subject, &point, &trial.upstream).ok()?;
        if run.state == trial.nominal.state { run.gradients.into_iter().nth(i)? } else { None }
    };
    let largest = |numbers: &[Quotient], number: fn(&Quotient) -> f64| {
        numbers.iter().fold(0.0, |largest: f64, quotient| largest.max(number(quotient).abs()))
    };
    let noise = noise(|h| Some(gradient_at(h)?.data().to_vec()));
    let rounding = (ROUNDINGS * f64::EPSILON * size).max(noise);
    let mut best: Option<(f64, Vec<Quotient>)> = None;
    for step in STEPS {
        let Some(gradients) = on_stencil(step, gradient_at) else { continue };
        let entry = |k: usize| gradients.each_ref().map(|gradient| gradient.data()[k]);
        let new: Vec<_> =
            (0..gradients[0].size()).map(|k| richardson(step, rounding, entry(k))).collect();
        let bar = largest(&new, |quotient| quotient.bar);
        let is_sharp =
            bar <= SHARP * largest(&new, |q| q.value) || bar <= SHARP * NEGLIGIBLE * size;
        if best.as_ref().is_none_or(|&(best, _)| bar < best) {
            best = Some((bar, new));
        }
        if is_sharp {
            break;
        }
    }
    best.map(|(_, quotients)| quotients)
}
