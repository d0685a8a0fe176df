//! What a fit of the cube gives back.

use bokashi_core::Tensor;

use bokashi_render_ops::{Kernel, Silhouettes};

use super::settings::{Experiment, Precision, Preset};

/// A fit with a larger vertex error at its end has not found the cube. Between a fit that
/// converges (1e-2 at worst) and one that is stuck (0.1 at least) lies a gap.
pub const STUCK: f64 = 0.05;

/// One fit from start to end. Values that do not apply to the experiment are `None`.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "page", derive(serde::Serialize))]
pub struct Outcome {
    /// What was learnt.
    pub experiment: Experiment,
    /// Learning rates and schedule.
    pub preset: Preset,
    /// Width and height of the images, in pixels.
    pub resolution: usize,
    /// Of the start and the poses.
    pub seed: u64,
    /// How many updates were done.
    pub steps: u64,
    /// How silhouettes looked, in the learnt image and in the target.
    pub silhouettes: Silhouettes,
    /// The numbers computed with.
    pub precision: Precision,
    /// The weights of the blur.
    pub kernel: Option<Kernel>,
    /// Blur of the target, in pixels.
    pub sigma_target: Option<f64>,
    /// Blur that was learnt, in pixels.
    pub sigma_final: Option<f64>,
    /// Mean distance of the vertices from the truth at the start, the least over automorphisms.
    pub vertex_error_initial: Option<f64>,
    /// The same at the end.
    pub vertex_error_final: Option<f64>,
    /// Mean distance of each vertex from its own truth at the end.
    pub vertex_error_plain: Option<f64>,
    /// The largest vertex error (over automorphisms) of the last tenth of the run.
    pub vertex_error_tail: Option<f64>,
    /// Mean distance of the colours at the end, under the automorphism of the vertices.
    pub color_error_final: Option<f64>,
    /// The loss of the first step's image.
    pub loss_initial: f64,
    /// The loss of the last state's image.
    pub loss_final: f64,
    /// Median milliseconds of an update: forward, backward and optimizer.
    pub ms_per_step_median: Option<f64>,
    /// Median milliseconds of a step's pose and target image.
    pub target_ms_per_step_median: Option<f64>,
    /// Seconds from the start to the end, all included.
    pub wall_seconds: f64,
    /// Every step, before its update; the last one is the final state.
    pub history: Vec<Record>,
    /// The learnt cube along the way: at steps 0, 10, 100, 1000, ..., at the last one, and at about
    /// 50 that are evenly spaced in the logarithm. In increasing order.
    #[cfg_attr(feature = "page", serde(skip))]
    pub snapshots: Vec<Snapshot>,
}

impl Outcome {
    /// Whether the fit ended far from the cube, more than [`STUCK`]. An error that is NaN is far.
    pub fn is_stuck(&self) -> bool {
        self.vertex_error_final.is_some_and(|error| error.is_nan() || error > STUCK)
    }
}

/// One step of an [`Outcome`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "page", derive(serde::Serialize))]
pub struct Record {
    /// How many updates came before.
    pub step: u64,
    /// Wall-clock seconds since the start of the fit.
    pub seconds: f64,
    /// The loss.
    pub loss: f64,
    /// Mean distance of the vertices from the truth, the least over automorphisms.
    pub vertex_error: Option<f64>,
    /// Blur, in pixels.
    pub sigma: Option<f64>,
    /// Mean distance of the colours, under the automorphism of the vertices.
    pub color_error: Option<f64>,
}

/// A cube with colours and a blur: the learnt one at some step, or the truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// How many updates came before.
    pub step: u64,
    /// Positions, `[8, 3]`.
    pub vertices: Tensor<f64>,
    /// Colours, `[8, 3]`, red, green and blue.
    pub colors: Tensor<f64>,
    /// Blur, in pixels of the fit's resolution; `None` without a blur.
    pub sigma: Option<f64>,
}

/// What a callback sees of a running fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// How many updates are done.
    pub step: u64,
    /// How many there will be.
    pub steps: u64,
    /// Wall-clock seconds since the start of the fit.
    pub seconds: f64,
    /// The loss.
    pub loss: f64,
    /// Mean distance of the vertices from the truth, the least over automorphisms.
    pub vertex_error: Option<f64>,
    /// Blur, in pixels.
    pub sigma: Option<f64>,
    /// Milliseconds of the last update; 0 before the first.
    pub ms: f64,
}

/// The steps at which a fit of `steps` updates keeps a [`Snapshot`], in increasing order.
pub(crate) fn snapshot_steps(steps: u64) -> Vec<u64> {
    /// Enough for a smooth animation.
    const SPACED: u32 = 50;
    let powers = (1..=19).map(|exponent| 10_u64.pow(exponent)).filter(|&power| power <= steps);
    let spaced = (0..=SPACED).map(|k| (steps as f64).powf(f64::from(k) / f64::from(SPACED)));
    let spaced = spaced.map(|step| (step as u64).min(steps));
    let mut all: Vec<u64> = powers.chain(spaced).chain([0, steps]).collect();
    all.sort_unstable();
    all.dedup();
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn snapshots_include_the_ends_and_the_powers_of_ten_and_stay_few() {
        for steps in [0, 1, 9, 10, 1_000, 10_000, 123_456_789] {
            let all = snapshot_steps(steps);
            assert!(all.len() <= 62, "{} snapshots of {steps} steps", all.len());
            assert!(all.windows(2).all(|pair| pair[0] < pair[1]));
            assert_eq!((all[0], all[all.len() - 1]), (0, steps));
            for power in [10, 100, 1_000, 10_000] {
                assert_eq!(all.contains(&power), power <= steps);
            }
        }
    }
}
