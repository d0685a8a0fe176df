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
    let study_done = study(&settings, &mut |run, done, count| {
        bar.set_length(count as u64);
        bar.set_position(done as u64);
        bar.set_message(format!("{}, {}", run.problem, run.optimizer));
    });
    bar.finish_and_clear();
    let study_done = study_done.map_err(failed)?;
    let text = if arguments.quiet { String::new() } else { markdown(&study_done) };
    arguments.files.write(&study_done.runs, &text, |about| page(&study_done, about), writing)
}
