//! The JSON text in the metadata of a saved fit, which has all but its numbers.

use bokashi_core::Scalar;
use serde::{Deserialize, Serialize};

use crate::error::FitError;
use crate::fit::{FitSettings, LoopState};
use crate::optimizer::Optimizer;
use crate::parameter::{Mapping, Parameter, Parameters};
use crate::preconditioner::Preconditioner;
use crate::schedule::Schedule;
use crate::stopping::Losses;

/// The version of what follows.
const VERSION: u64 = 2;
/// The largest number of updates in a file, so that counts cannot overflow later.
const MOST_UPDATES: u64 = 1 << 63;

/// The fields with which every version begins.
#[derive(Debug, Deserialize)]
struct Head {
    version: u64,
    precision: String,
}

/// The text, field by field. Numbers are finite and come back to the bit.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Contents {
    /// The checksum, first in the text, of the text after it and of all tensors.
    pub(super) checksum: String,
    version: u64,
    pub(super) precision: String,
    settings: Settings,
    /// The number of updates done.
    step: u64,
    /// The least loss of a run that has not ended, and its step.
    least_loss: Option<f64>,
    least_loss_step: u64,
    /// The number of updates that the parameters had.
    pub(super) updates: u64,
    pub(super) parameters: Vec<Described>,
}

/// A parameter without its numbers.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Described {
    pub(super) name: String,
    pub(super) rate: f64,
    pub(super) mapping: Mapping,
    pub(super) frozen: bool,
    pub(super) updates: u64,
    /// Left out where it is false, so that files without it have not changed.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(super) uniform: bool,
    /// The fingerprint of the preconditioner.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) preconditioner: Option<String>,
}

/// [`FitSettings`]; limits, which may be infinite, as text.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {
    steps: u64,
    optimizer: Optimizer,
    schedule: Schedule,
    loss_below: Option<String>,
    patience: Option<u64>,
    gradient_below: Option<String>,
}

impl Contents {
    /// The contents for a fit of numbers of type `precision`, without the checksum.
    pub(super) fn new<T: Scalar>(
        precision: &str,
        loop_state: &LoopState<'_>,
        parameters: &Parameters<T>,
    ) -> Self {
        let Losses { least, waited, .. } = loop_state.losses;
        // The last loss is that of the step before.
        let least_loss_step = least.map_or(loop_state.step, |_| loop_state.step - 1 - waited);
        let described = |parameter: &Parameter<T>| Described {
            name: parameter.name().to_owned(),
            rate: parameter.rate,
            mapping: parameter.mapping,
            frozen: parameter.frozen,
            updates: parameter.updates,
            uniform: parameter.is_uniform,
            preconditioner: parameter.preconditioner.as_ref().map(fingerprint),
        };
        let FitSettings { steps, optimizer, schedule, loss_below, patience, gradient_below } =
            loop_state.settings;
        let text = |limit: Option<f64>| limit.map(|limit| limit.to_string());
        Self {
            checksum: "00000000".to_owned(),
            version: VERSION,
            precision: precision.to_owned(),
            settings: Settings {
                steps,
                optimizer,
                schedule,
                loss_below: text(loss_below),
                patience,
                gradient_below: text(gradient_below),
            },
            step: loop_state.step,
            least_loss: least,
            least_loss_step,
            updates: parameters.updates,
            parameters: parameters.list.iter().map(described).collect(),
        }
    }

    /// Reads the contents of `text`.
    pub(super) fn from_text(text: &str) -> Result<Self, FitError> {
        let unreadable =
            |error: serde_json::Error| FitError::saved("contents that are those of a fit", error);
        // First of all whether it is ours to read.
        let head: Head = serde_json::from_str(text).map_err(unreadable)?;
        if head.version != VERSION {
            let rule = format!("version {VERSION}");
            return Err(FitError::saved(rule, format!("version {}", head.version)));
        }
        if !matches!(&*head.precision, "f32" | "f64") {
            return Err(FitError::saved("numbers in f32 or f64", head.precision));
        }
        serde_json::from_str(text).map_err(unreadable)
    }

    /// The state of the loop, with the state of the pipeline, which has a tensor of its own.
    pub(super) fn loop_state<'a>(
        &self,
        pipeline: Option<&'a [u8]>,
    ) -> Result<LoopState<'a>, FitError> {
        check_updates([self.step, self.updates].into_iter())?;
        if self.least_loss_step > self.step {
            let (least_step, step) = (self.least_loss_step, self.step);
            let least = self.least_loss.unwrap_or(f64::INFINITY);
            let given = format!("{least} of step {least_step} of {step}");
            return Err(FitError::saved("a least loss of a step that was done", given));
        }
        let Settings { steps, optimizer, schedule, loss_below, patience, gradient_below } =
            &self.settings;
        optimizer.check()?;
        schedule.check()?;
        let settings = FitSettings {
            steps: *steps,
            optimizer: *optimizer,
            schedule: *schedule,
            loss_below: limit(loss_below)?,
            patience: *patience,
            gradient_below: limit(gradient_below)?,
        };
        settings.check()?;
        let (least, waited) = match self.least_loss {
            Some(least) => (Some(least), (self.step - self.least_loss_step).saturating_sub(1)),
            None => (None, 0),
        };
        let losses = Losses { last: None, least, waited };
        Ok(LoopState { settings, step: self.step, losses, pipeline })
    }
}

/// The fingerprint of a preconditioner: its lambda and a checksum of the edges.
pub(super) fn fingerprint(preconditioner: &Preconditioner) -> String {
    let topology = preconditioner.topology();
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&(topology.vertex_count() as u64).to_le_bytes());
    for edge in topology.edges() {
        edge.iter().for_each(|vertex| hasher.update(&vertex.to_le_bytes()));
    }
    let (lambda, checksum) = (preconditioner.lambda(), hasher.finalize());
    format!("lambda {lambda:?}, edges {checksum:08x}")
}

/// A limit from its text.
fn limit(text: &Option<String>) -> Result<Option<f64>, FitError> {
    let number = |text: &String| {
        let refused = |_| FitError::saved("numbers as limits", format!("{text:?}"));
        text.parse().map_err(refused)
    };
    text.as_ref().map(number).transpose()
}

/// Checks that all `counts` are so small that they cannot overflow later.
pub(super) fn check_updates(mut counts: impl Iterator<Item = u64>) -> Result<(), FitError> {
    match counts.find(|&count| count > MOST_UPDATES) {
        Some(count) => Err(FitError::saved("at most 2^63 updates", count)),
        None => Ok(()),
    }
}
