//! The adjoint identity `<J v, u> = <v, J^T u>`: the backward pass against a forward-mode run.
//!
//! Both sides are exact but for rounding, so the bound is rounding alone, and no entry is too small
//! to count. The run over dual numbers takes the same branches: its values have the same bits.

use bokashi_core::Tensor;

use crate::failure::Broken;
use crate::run::{along, dot, forward, noise};
use crate::trial::{ROUNDINGS, Tally, Trial};

/// Closer to a kink than this, in units of `max(1, |x|)`, a direction tells nothing.
const BESIDE: f64 = 1e-7;

pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    let direction = direction(trial, 101);
    if !is_smooth(trial, &direction) {
        tally.left_out += 1;
        return Ok(tally);
    }
    let run = along(&trial.case, &trial.upstream, &direction);
    let run =
        run.map_err(|error| Broken::from_message(format!("refused over dual numbers: {error}")))?;
    let parts = run.outputs.iter().map(|output| (output.values(), output.tangents()));
    let (values, tangents): (Vec<_>, Vec<_>) = parts.unzip();
    for (j, (value, expected)) in values.iter().zip(&trial.nominal.outputs).enumerate() {
        tally.same_bits(value, expected, || format!("out{j} over dual numbers"))?;
    }
    let gradients = || trial.gradients().map(|(_, gradient)| gradient);
    let directions = trial.gradients().map(|(i, _)| &direction[i]);
    let (forward, forward_size) = dot(&tangents, &trial.upstream);
    let (backward, backward_size) = dot(directions, gradients());
    let bound = rounding(trial) * (forward_size + backward_size);
    tally.compare((backward, forward), bound, || "<v, J^T u> against <J v, u>".to_owned())?;
    Ok(tally)
}

/// The relative rounding of sums over all inputs and outputs.
pub(super) fn rounding(trial: &Trial) -> f64 {
    let entries: usize = trial.nominal.outputs.iter().map(Tensor::size).sum();
    let entries = entries + trial.gradients().map(|(_, gradient)| gradient.size()).sum::<usize>();
    (ROUNDINGS + entries as f64) * f64::EPSILON
}

/// A direction with a component along every differentiable input.
pub(super) fn direction(trial: &Trial, stream: u64) -> Vec<Tensor<f64>> {
    let inputs = trial.case.inputs.iter().zip(stream..);
    inputs
        .map(|(input, stream)| {
            if input.differentiable {
                noise(&input.tensor, stream)
            } else {
                Tensor::zeros(input.tensor.shape())
            }
        })
        .collect()
}

/// The point moved by `h` along `direction`.
pub(super) fn moved(trial: &Trial, direction: &[Tensor<f64>], h: f64) -> crate::run::Point<f64> {
    let moved = |((x, needs), v): (&(Tensor<f64>, bool), &Tensor<f64>)| {
        let entry = |k: usize| x.data()[k] + h * v.data()[k] * x.data()[k].abs().max(1.0);
        (Tensor::from_flat_fn(x.shape(), entry), *needs)
    };
    trial.point.iter().zip(direction).map(moved).collect()
}

/// Whether the subject is on one smooth piece close to the point, on both sides.
pub(super) fn is_smooth(trial: &Trial, direction: &[Tensor<f64>]) -> bool {
    [BESIDE, -BESIDE].into_iter().all(|h| {
        let nearby = forward(&*trial.case.subject, &moved(trial, direction, h));
        nearby.is_ok_and(|(_, state)| state == trial.nominal.state)
    })
}
