//! What commands write: JSON, and a page with its CSV files.

use std::fmt::Display;
use std::sync::{MutexGuard, PoisonError};

use bokashi_cli::about::about;
use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Writing;
use bokashi_cli::output::{is_standard_output, say, say_json};
use bokashi_report::{About, Document};
use serde::Serialize;

use super::arguments::Files;

/// Something went wrong.
pub(super) fn failed(error: impl Display) -> Failure {
    Failure::Work(error.to_string())
}

impl Files {
    /// Whether JSON stands alone on standard output.
    pub(super) fn is_json_alone(&self) -> bool {
        self.json.as_deref().is_some_and(is_standard_output)
    }

    /// Writes `found` as JSON, where that is asked for, while the lock of what is being written is `held`.
    pub(super) fn write_json(
        &self,
        results: &impl Serialize,
        _held: &MutexGuard<'_, ()>,
    ) -> Result<(), Failure> {
        let Some(file) = &self.json else { return Ok(()) };
        say_json(file, &serde_json::to_string(results).map_err(failed)?)
    }

    /// Writes `found` as JSON and `page`, where they are asked for. Says `text` and where the page
    /// lies, or nothing for an empty text.
    pub(super) fn write(
        &self,
        results: &impl Serialize,
        text: &str,
        page: impl FnOnce(About) -> Document,
        writing: &Writing,
    ) -> Result<(), Failure> {
        let held = writing.lock().unwrap_or_else(PoisonError::into_inner);
        self.write_json(results, &held)?;
        let mut report = String::new();
        if let Some(out) = &self.out {
            let page = page(about("bokashi-lab")).render().and_then(|page| page.write(out));
            report = format!("\nReport: {}\n", page.map_err(failed)?.display());
        }
        drop(held);
        if self.is_json_alone() || text.is_empty() {
            Ok(())
        } else {
            say(&format!("{text}{report}"))
        }
    }
}
