//! What came out of a fit of a scene, as JSON.

use std::time::Duration;

use bokashi_scene::Tensor;
use bokashi_scene::{SceneFit, ViewScore};
use serde_json::{Map, Value, json};

/// A parameter's numbers are listed up to so many; of more, their norm.
const MOST_LISTED: usize = 16;

/// What a fit was and became.
#[derive(Debug)]
pub(super) struct Outcome {
    pub(super) loss_initial: f64,
    pub(super) loss_final: f64,
    pub(super) steps: u64,
    /// Of these, those that were done before the fit was resumed.
    pub(super) steps_before: u64,
    pub(super) time: Duration,
    /// Of each step, in milliseconds.
    pub(super) step_ms: Vec<f64>,
    /// Each parameter before the first step.
    pub(super) first: Vec<(String, Tensor<f32>)>,
    pub(super) scores: Vec<ViewScore>,
    pub(super) left_out: Vec<(&'static str, String)>,
}

/// The parameters of a fit by name.
pub(super) fn values(fit: &SceneFit) -> Vec<(String, Tensor<f32>)> {
    let all = fit.parameters().iter();
    all.map(|parameter| (parameter.name().to_owned(), parameter.value())).collect()
}

impl Outcome {
    /// The mean PSNR of the views that are held out.
    pub(super) fn psnr_held_out(&self, fit: &SceneFit) -> Option<f64> {
        mean_held_out(fit, &self.scores)
    }

    pub(super) fn ms_per_step(&self) -> Option<f64> {
        let mut sorted = self.step_ms.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }

    /// How many steps there were, and how long they took, in words.
    pub(super) fn said(&self) -> String {
        let Self { steps, steps_before, .. } = self;
        let Some(ms) = self.ms_per_step() else { return format!("{steps} steps, done before") };
        let now = match steps_before {
            0 => String::new(),
            before => format!(", {} of them now,", steps - before),
        };
        format!("{steps} steps{now} in {:.1} s, {ms:.2} ms each", self.time.as_secs_f64())
    }

    pub(super) fn json(&self, fit: &SceneFit) -> Value {
        let last = values(fit);
        let parameters = self.first.iter().zip(&last).map(|((name, first), (_, last))| {
            let shape: Vec<usize> = last.shape().to_vec();
            let own = match last.size() {
                0..=MOST_LISTED => json!({"first": first.data(), "last": last.data()}),
                _ => json!({"first_norm": norm(first), "last_norm": norm(last)}),
            };
            let mut own = own;
            own["shape"] = json!(shape);
            (name.clone(), own)
        });
        let views = self.scores.iter().map(|score| {
            let view = &fit.scene().views[score.view];
            json!({
                "name": view.name,
                "held_out": view.held_out,
                "psnr": score.psnr.filter(|psnr| psnr.is_finite()),
                "ssim": score.ssim,
                "silhouette_iou": score.silhouette_iou,
            })
        });
        let left_out = self
            .left_out
            .iter()
            .map(|(operation, reason)| json!({"operation": operation, "reason": reason}));
        json!({
            "loss_initial": self.loss_initial,
            "loss_final": self.loss_final,
            "steps": self.steps,
            "seconds": self.time.as_secs_f64(),
            "ms_per_step_median": self.ms_per_step(),
            "threads": rayon::current_num_threads(),
            "parameters": Value::Object(parameters.collect::<Map<_, _>>()),
            "views": views.collect::<Value>(),
            "psnr_held_out": self.psnr_held_out(fit),
            "parameters_hash": hash(&last),
            "left_out": left_out.collect::<Value>(),
            "changed": fit.changed(),
        })
    }
}

/// The mean PSNR of the views that are held out.
pub(super) fn mean_held_out(fit: &SceneFit, scores: &[ViewScore]) -> Option<f64> {
    let held_out = scores.iter().filter(|score| fit.scene().views[score.view].held_out);
    let ratios: Vec<_> = held_out.filter_map(|score| score.psnr).collect();
    (!ratios.is_empty()).then(|| ratios.iter().sum::<f64>() / ratios.len() as f64)
}

fn norm(tensor: &Tensor<f32>) -> f64 {
    tensor.data().iter().map(|&x| f64::from(x).powi(2)).sum::<f64>().sqrt()
}

/// 64 bits of the names and of all bits of the values, by FNV-1a: the same for the same parameters, on any
/// machine.
fn hash(values: &[(String, Tensor<f32>)]) -> String {
    let bytes = values.iter().flat_map(|(name, value)| {
        let numbers = value.data().iter().flat_map(|x| x.to_bits().to_le_bytes());
        name.bytes().chain(numbers)
    });
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_of_all_bits() {
        let of = |x: f32| hash(&[("a".to_owned(), Tensor::from([1.0, x]))]);
        assert_eq!(of(2.0), of(2.0));
        assert_ne!(of(2.0), of(2.0_f32.next_up()));
        assert_ne!(of(0.0), of(-0.0));
        assert_eq!(hash(&[]), "cbf29ce484222325");
    }
}
