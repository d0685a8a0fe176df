//! The backward pass is linear in the upstream gradient `u`: exactly so for a power of two, and
//! to rounding for a sum; no gradient comes from no upstream gradient.
//!
//! Rounding is that of the largest entry. An entry that is a small difference of large terms has more: as much as
//! it is rough close to u, on the way to u + v, but no more than that of terms as large as an input times an
//! upstream gradient.

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
    let v: Vec<_> = trial.upstream.iter().zip(501..).map(|(u, j)| noise(u, j)).collect();
    let plus = |t: f64| -> Vec<_> {
        let pairs = trial.upstream.iter().zip(&v);
        let add = |(u, v): (&Tensor<f64>, &Tensor<f64>)| {
            Tensor::from_flat_fn(u.shape(), |k| u.data()[k] + t * v.data()[k])
        };
        pairs.map(add).collect()
    };
    let upstreams = [v.clone(), plus(1.0), times(trial, 0.0)];
    let [of_v, of_sum, of_zero] = upstreams.map(|upstream| run_with(trial, &upstream));
    let (of_v, of_sum, of_zero) = (of_v?, of_sum?, of_zero?);
    let most =
        |tensors: &mut dyn Iterator<Item = &Tensor<f64>>| tensors.map(largest).fold(0.0, f64::max);
    let upstream = most(&mut trial.upstream.iter().chain(&v));
    let input = most(&mut trial.point.iter().map(|(x, _)| x)).max(1.0);
    for (i, gradient) in trial.gradients() {
        let gradient_of =
            |run: &Run<f64>| run.gradients[i].clone().expect("a differentiable input");
        let [v, both, none] = [&of_v, &of_sum, &of_zero].map(gradient_of);
        let roundings = (ROUNDINGS + gradient.size() as f64) * f64::EPSILON;
        let bound = roundings * largest(gradient).max(largest(&v)).max(largest(&both));
        let sum = |k: usize| gradient.data()[k] + v.data()[k];
        let is_off = |k: &usize| (both.data()[*k] - sum(*k)).abs() > bound;
        let off: Vec<usize> = (0..gradient.size()).filter(is_off).collect();
        let mut more = 0.0;
        if !off.is_empty() {
            let rough = roughness(|t| {
                let close = gradient_of(&run_with(trial, &plus(t)).ok()?);
                Some(off.iter().map(|&k| close.data()[k]).collect())
            });
            more = rough.min(roundings * upstream * input);
        }
        for k in 0..gradient.size() {
            let entry_name = || entry(&format!("in{i}"), gradient.shape(), k);
            let bound = if is_off(&k) { bound + more } else { bound };
            tally.compare((both.data()[k], sum(k)), bound, || {
                format!("upstream u + v: gradient of {}", entry_name())
            })?;
            tally.compare((none.data()[k], 0.0), 0.0, || {
                format!("upstream 0: gradient of {}", entry_name())
            })?;
        }
    }
    Ok(())
}
