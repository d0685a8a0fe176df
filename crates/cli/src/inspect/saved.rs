//! Saved fits.

use std::path::Path;

use bokashi_fit::{FitError, saved};
use bokashi_scene::{Location, SceneError};
use serde_json::{Value, json};

use super::findings::{Findings, Section};
use crate::digits::number;

/// What comes before a parameter's name, for its numbers.
const RAW: &str = "raw/";

/// What is in the saved fit `file`. All of it is checked by who reads fits; what is told stands in the header,
/// which is then known to be that of a fit.
pub(super) fn inspect(file: &Path) -> Result<Findings, SceneError> {
    let refused = |error: FitError| match error {
        // It says which file it is.
        error @ FitError::File { .. } => SceneError::Fit(error),
        error => SceneError::Content { location: Location::new(file), message: error.to_string() },
    };
    let bytes = saved::read(file).map_err(refused)?;
    let (precision, state) = saved::precision_and_state(&bytes).map_err(refused)?;
    let header = header(&bytes).unwrap_or_default();
    let text = header["__metadata__"]["bokashi_fit"].as_str().unwrap_or_default();
    let contents: Value = serde_json::from_str(text).unwrap_or_default();
    let mut findings = Findings::new("a saved fit");
    let mut whole = Section::default();
    let bytes_long = bytes.len();
    whole.fact("bytes", bytes_long, bytes_long);
    whole.plain("precision", precision);
    for (label, key) in [("steps done", "step"), ("updates", "updates")] {
        whole.fact(label, &contents[key], contents[key].clone());
    }
    let steps = &contents["settings"]["steps"];
    whole.fact("of steps", steps, steps.clone());
    if let Some(loss) = contents["least_loss"].as_f64() {
        let step = &contents["least_loss_step"];
        let value = json!({ "loss": loss, "step": step });
        whole.fact("least loss", format!("{} in step {step}", number(loss)), value);
    }
    let state = state.map(<[u8]>::len);
    let text = state.map_or("none: it has not begun".to_owned(), |state| format!("{state} bytes"));
    whole.fact("state", text, state);
    findings.whole(whole);
    for parameter in contents["parameters"].as_array().into_iter().flatten() {
        let name = parameter["name"].as_str().unwrap_or_default();
        let mut section = Section::new(format!("parameter {name:?}"));
        section.silent("name", name);
        let shape = &header[format!("{RAW}{name}")]["shape"];
        section.fact("shape", shape, shape.clone());
        let rate = parameter["rate"].as_f64().unwrap_or_default();
        section.fact("rate", number(rate), rate);
        section.fact("updates", &parameter["updates"], parameter["updates"].clone());
        let mapping = match &parameter["mapping"] {
            Value::String(word) => word.clone(),
            other => other.to_string(),
        };
        section.fact("mapping", mapping, parameter["mapping"].clone());
        if parameter["frozen"] == true {
            section.fact("frozen", "yes", true);
        }
        if !parameter["preconditioner"].is_null() {
            section.fact("steps are", "smooth", parameter["preconditioner"].clone());
        }
        findings.part("parameters", section);
    }
    Ok(findings)
}

/// The JSON before the tensors of a safetensors file.
fn header(bytes: &[u8]) -> Option<Value> {
    let (length, rest) = bytes.split_first_chunk()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    serde_json::from_slice(rest.get(..length)?).ok()
}
