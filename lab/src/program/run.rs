//! Doing what was asked, after a look at where it is to be written.

use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::{Writing, end_when_interrupted};
use bokashi_cli::places::Places;
use bokashi_cli::threads::{start_threads, start_threads_apart};

use super::arguments::{BenchArguments, BenchCommand, Command, Request};
use super::{bench, models, stability, stiff};
use crate::bench::{ELISION_FILES, files as bench_files};
use crate::stability::FILES as STABILITY_FILES;
use crate::stiff::FILES as STIFF_FILES;

/// Does all that `request` asks for.
pub(crate) fn run(request: &Request) -> Result<(), Failure> {
    let report = list_files(&request.command);
    let report: Vec<&str> = report.iter().map(|name| &**name).collect();
    let files = request.files();
    Places {
        out: files.out.as_deref(),
        is_out_named: true,
        report: &report,
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

/// The files of the page that a command adds to a report.
fn list_files(command: &Command) -> Vec<String> {
    let named = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    match command {
        Command::Stability(_) => named(&STABILITY_FILES),
        Command::Stiff(_) => named(&STIFF_FILES),
        Command::Bench(BenchArguments { command: Some(BenchCommand::Elision(_)), .. }) => {
            named(&ELISION_FILES)
        }
        Command::Bench(BenchArguments { options, only, mesh, .. }) => {
            bench_files(options.effort(), only, !mesh.is_empty())
        }
        Command::Models(_) => Vec::new(),
    }
}
