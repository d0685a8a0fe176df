//! The command `models`: mesh files of other people.

use std::sync::PoisonError;

use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Writing;
use bokashi_cli::output::say;
use indicatif::ProgressBar;

use super::arguments::{Files, ModelsArguments};
use crate::models::{markdown, walk, wrong};

/// Loads all of them; a broken one, or counts that nobody expects, are a failure of the program.
pub(crate) fn run(
    arguments: &ModelsArguments,
    files: &Files,
    writing: &Writing,
) -> Result<(), Failure> {
    // Where standard error is no terminal there is no bar.
    let bar = ProgressBar::new_spinner();
    let outcomes = walk(&arguments.folder, &mut |path| {
        bar.set_message(path.display().to_string());
        bar.tick();
    });
    bar.finish_and_clear();
    let outcomes =
        outcomes.map_err(|error| Failure::Use(format!("models needs a folder: {error}")))?;
    files.write_json(&outcomes, &writing.lock().unwrap_or_else(PoisonError::into_inner))?;
    if !files.is_json_alone() {
        say(&markdown(&outcomes))?;
    }
    match wrong(&outcomes, &arguments.expect) {
        wrong if wrong.is_empty() => Ok(()),
        wrong => Err(Failure::Work(wrong.join("; "))),
    }
}
