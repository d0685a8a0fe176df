//! The command `stiff`: optimizers against stiff problems.

use std::sync::PoisonError;

use bokashi_cli::about::about;
use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Writing;
use bokashi_cli::output::{is_standard_output, say, say_json};
use bokashi_report::escaped;
use indicatif::{ProgressBar, ProgressStyle};

use super::arguments::StiffArguments;
use crate::stiff::{StudySettings, study, table, write_page};

/// Does the trial and writes what was asked for.
pub(crate) fn run(arguments: &StiffArguments, writing: &Writing) -> Result<(), Failure> {
    let bar = if arguments.quiet { ProgressBar::hidden() } else { ProgressBar::new(0) };
    if let Ok(style) = ProgressStyle::with_template("{pos}/{len}  {msg}") {
        bar.set_style(style);
    }
    let settings = StudySettings { seeds: arguments.seeds, ..StudySettings::default() };
    let found = study(&settings, &mut |run, done, count| {
        bar.set_length(count as u64);
        bar.set_position(done as u64);
        bar.set_message(format!("{}, {}", run.problem, run.optimizer));
    });
    bar.finish_and_clear();
    let failed = |error: &dyn std::fmt::Display| Failure::Work(error.to_string());
    let found = found.map_err(|error| failed(&error))?;

    let held = writing.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(file) = &arguments.json {
        say_json(file, &serde_json::to_string(&found.runs).map_err(|error| failed(&error))?)?;
    }
    let mut page = String::new();
    if let Some(out) = &arguments.out {
        let about = about("bokashi-lab");
        let footer = format!(
            "Made by {}: <code>{}</code>, {} threads. Beside this page: <code>stiff.csv</code>.",
            escaped(&about.program),
            escaped(&about.command),
            about.threads
        );
        let path = write_page(&found, &footer, out).map_err(|error| failed(&error))?;
        page = format!("\nPage: {}\n", path.display());
    }
    drop(held);
    let only_json = arguments.json.as_ref().is_some_and(|file| is_standard_output(file));
    if arguments.quiet || only_json { Ok(()) } else { say(&format!("{}{page}", table(&found))) }
}
