//! `bokashi fit scene.toml` on several machines: `mpirun -n 4 bokashi-mpi fit scene.toml`. And many fits
//! as one job: `mpirun -n 4 bokashi-mpi sweep sweep.toml --out DIR`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use bokashi_cli::arguments::{self, Stopped, seeds};
use bokashi_cli::failure::{Failure, ended};
use bokashi_cli::interrupt::{Interrupt, Writing, end_when_interrupted};
use bokashi_cli::{output, panics, run};
use bokashi_fit::{Ranks, agreed};
use bokashi_mpi::{job, sweep};
use clap::{CommandFactory as _, Parser, Subcommand};

/// Fits on many machines, as ranks of an MPI job. docs/cluster.md says how to start one.
#[derive(Debug, Parser)]
#[command(name = "bokashi-mpi", version)]
struct Request {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// One fit of a scene, which all ranks share: the options of `bokashi fit`, and its results.
    #[command(disable_help_flag = true)]
    Fit {
        /// See `bokashi fit --help`
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        arguments: Vec<OsString>,
    },
    /// Many fits, of which each rank takes the next: `[[fit]]` with `name` and `arguments`.
    Sweep {
        /// The list of fits
        #[arg(value_name = "SWEEP.TOML")]
        file: PathBuf,
        /// Folder for the results, one folder in it for each fit
        #[arg(long, value_name = "DIR", default_value = "out")]
        out: PathBuf,
    },
    /// The paper's experiments 5.1, 5.2 and 5.3 as a sweep.
    Reproduce {
        /// Seeds per experiment and setting, counted from 0
        #[arg(long, value_name = "N", default_value_t = 20, value_parser = seeds)]
        seeds: u64,
        /// Updates per fit
        #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
        steps: u64,
        /// Folder for the results, one folder in it for each fit
        #[arg(long, value_name = "DIR", default_value = "out")]
        out: PathBuf,
    },
}

fn main() -> ExitCode {
    panics::leave_guarded_out();
    let mut words = std::env::args_os();
    let program = words.next().unwrap_or_default();
    // A fit of a sweep: it knows nothing of the other ranks.
    if std::env::args_os().nth(1).is_some_and(|word| word == sweep::ALONE) {
        let result = match arguments::parse(std::iter::once(program).chain(words.skip(1))) {
            Ok(request) => run::run(&request),
            Err(stopped) => shown(stopped, true),
        };
        return ended("bokashi-mpi", result);
    }
    job::as_rank(work)
}

/// What one rank does.
fn work(ranks: &Ranks<f32>) -> Result<(), Failure> {
    let is_first = ranks.rank() == 0;
    let request = match Request::try_parse() {
        Ok(request) => request,
        Err(error) => return shown(arguments::stopped(error, &Request::command()), is_first),
    };
    match request.command {
        Command::Fit { arguments } => {
            let words = ["bokashi-mpi".into(), "fit".into()].into_iter().chain(arguments);
            match arguments::parse(words) {
                Ok(request) => run::run_among(&request, ranks),
                Err(stopped) => shown(stopped, is_first),
            }
        }
        Command::Sweep { file, out } => all(sweep::read(&file), &out, ranks),
        Command::Reproduce { seeds, steps, out } => {
            all(Ok(sweep::of_paper(seeds, steps)), &out, ranks)
        }
    }
}

/// Does a sweep, where all ranks are ready for it.
fn all(
    fits: Result<Vec<sweep::Fit>, Failure>,
    out: &Path,
    ranks: &Ranks<f32>,
) -> Result<(), Failure> {
    let interrupt = Interrupt::default();
    let begin = |fits| {
        end_when_interrupted(&Writing::default(), Some(&interrupt))?;
        Ok::<Vec<sweep::Fit>, Failure>(fits)
    };
    let fits = agreed(&**ranks, fits.and_then(begin))?;
    let ended = sweep::run(&fits, out, ranks, &interrupt);
    // The others wait for the first, which writes the table.
    if ranks.rank() == 0 {
        interrupt.no_more_fits();
    }
    ended
}

/// What comes of a command line without a request.
fn shown(stopped: Stopped, is_first: bool) -> Result<(), Failure> {
    match stopped {
        Stopped::Shown(text) if is_first => output::say(&text),
        Stopped::Shown(_) => Ok(()),
        Stopped::Wrong(failure) => Err(failure),
    }
}
