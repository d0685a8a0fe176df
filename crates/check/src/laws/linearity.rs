//! The backward pass is linear in the upstream gradient `u`: exactly so for a power of two, and
//! to rounding for a sum; no gradient comes from no upstream gradient.
//!
//! Rounding is that of the largest entry. Where a gradient is a small difference of large terms, it is more: how
//! rough the gradient is on the way from u to u + v tells how much.

use bokashi_core::Tensor;

use super::differences::noise as roughness;
use crate::failure::{Broken, entry};
use crate::run::{Run, largest, noise, run};
use crate::trial::{ROUNDINGS, Tally, Trial};

/// Far enough that an absolute threshold hidden in a backward pass shows, and near enough that no
/// product over- or underflows.
const POWERS: [i32; 2] = [-40, 40];

pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    check_powers(trial, &mut tally)?;
    check_sum(trial, &mut tally)?;
    Ok(tally)
}

/// The subject, with other upstream gradients.
fn run_with(trial: &Trial, upstream: &[Tensor<f64>]) -> Result<Run<f64>, Broken> {
    let run = run(&*trial.case.subject, &trial.point, upstream);
    run.map_err(|error| Broken::from_message(error.to_string()))
}

fn times(trial: &Trial, factor: f64) -> Vec<Tensor<f64>> {
    trial.upstream.iter().map(|u| u.map(|u| u * factor)).collect()
}

fn check_powers(trial: &Trial, tally: &mut Tally) -> Result<(), Broken> {
    for power in POWERS {
        let factor = f64::from(power).exp2();
        let run = run_with(trial, &times(trial, factor))?;
        for ((i, gradient), scaled) in trial.gradients().zip(run.gradients.iter().flatten()) {
            for (k, (&scaled, &entry_of)) in scaled.data().iter().zip(gradient.data()).enumerate() {
                let expected = entry_of * factor;
                // A subnormal number has lost digits, and its terms may have.
                if expected.abs() > f64::MIN_POSITIVE / f64::EPSILON || expected == 0.0 {
                    tally.compare((scaled, expected), 0.0, || {
                        let entry_name = entry(&format!("in{i}"), gradient.shape(), k);
                        format!("upstream times 2^{power}: gradient of {entry_name}")
                    })?;
                }
            }
        }
    }
    Ok(())
}

fn check_sum(trial: &Trial, tally: &mut Tally) -> Result<(), Broken> {
    let other: Vec<_> = trial.upstream.iter().zip(501..).map(|(u, j)| noise(u, j)).collect();
    let add = |(u, v): (&Tensor<f64>, &Tensor<f64>)| {
        Tensor::from_flat_fn(u.shape(), |k| u.data()[k] + v.data()[k])
    };
    let both: Vec<_> = trial.upstream.iter().zip(&other).map(add).collect();
    let upstream = other.clone();
    let with = |upstream: &[Tensor<f64>]| run_with(trial, upstream);
    let (other, both, none) = (with(&other)?, with(&both)?, with(&times(trial, 0.0))?);
    for (i, gradient) in trial.gradients() {
        let gradient_of =
            |run: &Run<f64>| run.gradients[i].clone().expect("a differentiable input");
        let (other, both, none) = (gradient_of(&other), gradient_of(&both), gradient_of(&none));
        let size = largest(gradient).max(largest(&other)).max(largest(&both));
        let mut bound = (ROUNDINGS + gradient.size() as f64) * f64::EPSILON * size;
        let is_off =
            |k: usize| (both.data()[k] - gradient.data()[k] - other.data()[k]).abs() > bound;
        if (0..gradient.size()).any(is_off) {
            bound += roughness(|t| {
                let way = trial.upstream.iter().zip(&upstream).map(|(u, v)| {
                    Tensor::from_flat_fn(u.shape(), |k| u.data()[k] + t * v.data()[k])
                });
                let way: Vec<_> = way.collect();
                Some(gradient_of(&with(&way).ok()?).data().to_vec())
            });
        }
        for k in 0..gradient.size() {
            let entry_name = || entry(&format!("in{i}"), gradient.shape(), k);
            let sum = gradient.data()[k] + other.data()[k];
            tally.compare((both.data()[k], sum), bound, || {
                format!("upstream u + v: gradient of {}", entry_name())
            })?;
            tally.compare((none.data()[k], 0.0), 0.0, || {
                format!("upstream 0: gradient of {}", entry_name())
            })?;
        }
    }
    Ok(())
}
