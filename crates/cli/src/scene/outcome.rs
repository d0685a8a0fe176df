//! What came out of a fit of a scene, as JSON.

use std::time::Duration;

use bokashi_scene::Tensor;
use bokashi_scene::{SceneFit, ViewScore};
use serde_json::{Map, Value, json};

/// Of views that are held out, where something is learnt of each view.
pub(crate) const HELD_OUT: &str = "What is learnt of each view, as its camera, is fitted to the images of held-out views \
     at the end, with everything else still, before they are scored.";

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
    /// The share by which the loss still fell at the end, if it did: see [`fall`].
    pub(super) fell: Option<f64>,
}

/// So many views are named that are matched worst.
const WORST: usize = 3;
/// A quarter of the last stage has at least so many steps, or nothing is said of it.
const LEAST_STEPS: usize = 10;
/// A loss that fell by less is at its end.
const LEAST_FALL: f64 = 0.02;

/// The share by which a loss still fell from the third to the last quarter of `losses`, those of the last stage.
/// `None` where it did not, or where views that differ from step to step hide it: both means are known to their
/// standard errors.
pub(super) fn fall(losses: &[f64]) -> Option<f64> {
    let quarter = losses.len() / 4;
    if quarter < LEAST_STEPS {
        return None;
    }
    let mean_and_error = |losses: &[f64]| {
        let count = losses.len() as f64;
        let mean = losses.iter().sum::<f64>() / count;
        let squares = losses.iter().map(|loss| (loss - mean).powi(2)).sum::<f64>();
        (mean, squares / (count * (count - 1.0)))
    };
    let late = &losses[losses.len() - 2 * quarter..];
    let (before, before_error) = mean_and_error(&late[..quarter]);
    let (last, last_error) = mean_and_error(&late[quarter..]);
    let is_sure = before - last > 3.0 * (before_error + last_error).sqrt();
    Some(1.0 - last / before).filter(|&share| is_sure && share > LEAST_FALL)
}

/// Below this share of both, silhouettes and their masks are not of one shape.
const FAR_OFF: f64 = 0.8;

/// How much silhouettes overlap with masks, in words, and what is wrong where it is little. Of each view whether it is
/// held out, and the overlap: those that are held out count, or all where none is.
fn overlap_in_words(views: &[(bool, f64)]) -> Option<String> {
    let some_are = views.iter().any(|view| view.0);
    let counted: Vec<_> =
        views.iter().filter(|view| view.0 == some_are).map(|view| view.1).collect();
    if counted.is_empty() {
        return None;
    }
    let share = counted.iter().sum::<f64>() / counted.len() as f64;
    let far_off = match share < FAR_OFF {
        true => ": the start is too far off, or masks or cameras are wrong",
        false => "",
    };
    Some(format!("Silhouettes overlap with their masks by {:.1} %{far_off}.", 100.0 * share))
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
    pub(super) fn message(&self) -> String {
        let Self { steps, steps_before, .. } = self;
        let Some(ms) = self.ms_per_step() else { return format!("{steps} steps, done before") };
        let now = match steps_before {
            0 => String::new(),
            before => format!(", {} of them now,", steps - before),
        };
        format!("{steps} steps{now} in {:.1} s, {ms:.2} ms each", self.time.as_secs_f64())
    }

    /// That the loss still fell, in words, and what to do about it.
    fn fell_in_words(&self) -> Option<String> {
        let percent = 100.0 * self.fell?;
        Some(format!(
            "The loss still fell by {percent:.0} % in the last quarter: more steps make it smaller."
        ))
    }

    /// The views that are matched worst, in words; nothing where there are no more than these.
    fn worst_in_words(&self, fit: &SceneFit) -> Option<String> {
        let score = |score: &ViewScore| score.psnr.map(|psnr| (psnr, score.view));
        let mut all: Vec<_> = self.scores.iter().filter_map(score).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0));
        let named = all.iter().take(WORST).map(|&(psnr, view)| {
            let view = &fit.scene().views[view];
            format!("{}{} {psnr:.1} dB", view.name, if view.held_out { ", held out," } else { "" })
        });
        let named = named.collect::<Vec<_>>().join("; ");
        (all.len() > WORST).then(|| format!("Worst views: {named}."))
    }

    /// That views were aligned, in words, and what it did to their scores.
    fn aligned_in_words(&self) -> Option<String> {
        let aligned: Vec<_> = self
            .scores
            .iter()
            .filter_map(|score| Some([score.psnr_before?, score.psnr?]))
            .collect();
        if aligned.is_empty() {
            return None;
        }
        let count = aligned.len();
        let [before, after] =
            [0, 1].map(|k| aligned.iter().map(|psnr| psnr[k]).sum::<f64>() / count as f64);
        let views = if count == 1 { "1 held-out view was" } else { "held-out views were" };
        let views = if count == 1 { views.to_owned() } else { format!("{count} {views}") };
        Some(format!(
            "{views} aligned with the images before scores were made: {before:.1} dB before, {after:.1} dB after."
        ))
    }

    /// What else to know of the fit, in sentences.
    pub(super) fn remarks(&self, fit: &SceneFit) -> impl Iterator<Item = String> {
        let shortened = fit.shortened_stages().map(|(stage, [done, steps])| {
            format!(
                "Stage {} ended by a rule of `[stop]`, after {done} of {steps} steps.",
                stage + 1
            )
        });
        let shortened: Vec<_> = shortened.collect();
        let ended = fit.ended().map(|rule| format!("It ended by a rule: {rule}."));
        let overlaps: Vec<_> = self
            .scores
            .iter()
            .filter_map(|score| {
                Some((fit.scene().views[score.view].held_out, score.silhouette_iou?))
            })
            .collect();
        let overlap = overlap_in_words(&overlaps);
        let all = [
            ended,
            self.fell_in_words(),
            overlap,
            self.worst_in_words(fit),
            self.aligned_in_words(),
        ];
        shortened.into_iter().chain(all.into_iter().flatten())
    }

    pub(super) fn json(&self, fit: &SceneFit) -> Value {
        let last = values(fit);
        let parameters = self.first.iter().zip(&last).map(|((name, first), (_, last))| {
            let shape: Vec<usize> = last.shape().to_vec();
            let mut value = match last.size() {
                0..=MOST_LISTED => json!({"first": first.data(), "last": last.data()}),
                _ => json!({"first_norm": norm(first), "last_norm": norm(last)}),
            };
            value["shape"] = json!(shape);
            (name.clone(), value)
        });
        let views = self.scores.iter().map(|score| {
            let view = &fit.scene().views[score.view];
            json!({
                "name": view.name,
                "held_out": view.held_out,
                "psnr": score.psnr.filter(|psnr| psnr.is_finite()),
                "ssim": score.ssim,
                "silhouette_iou": score.silhouette_iou,
                "psnr_before_alignment": score.psnr_before.filter(|psnr| psnr.is_finite()),
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
            "loss_fell_at_end": self.fell,
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
    fn an_overlap_is_that_of_views_that_are_held_out_and_is_blamed_where_it_is_little() {
        let said = |views: &[(bool, f64)]| overlap_in_words(views).unwrap_or_default();
        let good = "Silhouettes overlap with their masks by 95.0 %.";
        assert_eq!(said(&[(true, 0.96), (false, 0.1), (true, 0.94)]), good);
        assert_eq!(said(&[(false, 0.96), (false, 0.94)]), good);
        let rule = "the start is too far off, or masks or cameras are wrong.";
        assert_eq!(
            said(&[(true, 0.7), (false, 1.0)]),
            format!("Silhouettes overlap with their masks by 70.0 %: {rule}")
        );
        assert_eq!(said(&[]), "");
    }

    #[test]
    fn a_loss_that_still_falls_is_told_from_one_that_does_not() {
        let noise = |k: usize| 1.0 + 0.3 * (12.9898 * k as f64).sin();
        let of = |loss: &dyn Fn(usize) -> f64| fall(&(0..400).map(loss).collect::<Vec<_>>());
        // Over a quarter, 100 steps, it falls by this share.
        let share = 1.0 - (-0.5_f64).exp();
        let fell = of(&|k| (-0.005 * k as f64).exp()).unwrap();
        assert!((fell - share).abs() < 1e-9, "{fell}");
        let fell = of(&|k| noise(k) * (-0.005 * k as f64).exp()).unwrap();
        assert!((fell - share).abs() < 0.1, "{fell}");
        assert_eq!(of(&noise), None);
        assert_eq!(of(&|_| 1.0), None);
        assert_eq!(of(&|k| 1.0 + (-0.05 * k as f64).exp()), None);
        assert_eq!(of(&|k| k as f64), None);
        assert_eq!(fall(&[2.0, 1.0]), None);
    }

    #[test]
    fn the_hash_is_of_all_bits() {
        let of = |x: f32| hash(&[("a".to_owned(), Tensor::from([1.0, x]))]);
        assert_eq!(of(2.0), of(2.0));
        assert_ne!(of(2.0), of(2.0_f32.next_up()));
        assert_ne!(of(0.0), of(-0.0));
        assert_eq!(hash(&[]), "cbf29ce484222325");
    }
}
