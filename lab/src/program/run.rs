//! Doing what was asked, after a look at where it is to be written.

use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::{Writing, end_when_interrupted};
use bokashi_cli::places::Places;
use bokashi_cli::threads::{start_threads, start_threads_apart};

use super::arguments::{Command, Request};
use super::{bench, models, stability, stiff};

/// Does all that `request` asks for.
pub(crate) fn run(request: &Request) -> Result<(), Failure> {
    let report: &[&str] = match &request.command {
        Command::Stability(_) => &["stability.html"],
        Command::Stiff(_) => &["stiff.html", "stiff-conditions.csv", "stiff-runs.csv"],
        Command::Bench(bench) if bench.command.is_none() => &["bench.html"],
        Command::Bench(_) => &["elision.html", "elision-rows.csv"],
        Command::Models(_) => &[],
    };
    let files = request.files();
    Places {
        out: files.out.as_deref(),
        is_out_named: true,
        report,
        files: files.json.as_deref().map(|file| ("--json", file)).into_iter().collect(),
        read: request.read(),
    }
    .check()?;
    let writing = Writing::default();
    end_when_interrupted(&writing, None)?;
    match &request.command {
        Command::Stability(_) => {
            // Its cases run in threads of their own.
            start_threads_apart(request.threads())?;
            stability::run(&files, &writing)
        }
        Command::Stiff(arguments) => {
            start_threads(request.threads())?;
            stiff::run(arguments, &writing)
        }
        Command::Bench(arguments) => {
            start_threads(request.threads())?;
            bench::run(arguments, &writing)
        }
        Command::Models(arguments) => models::run(arguments, &files, &writing),
    }
}
