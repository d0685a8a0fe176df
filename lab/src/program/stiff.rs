//! The command `stiff`: optimizers against stiff problems.

use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Writing;
use indicatif::{ProgressBar, ProgressStyle};

use super::arguments::StiffArguments;
use super::files::failed;
use crate::stiff::{StudySettings, markdown, page, study};

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
    let found = found.map_err(failed)?;
    let text = if arguments.quiet { String::new() } else { markdown(&found) };
    arguments.files.write(&found.runs, &text, |about| page(&found, about), writing)
}
