//! Doing what was asked, after a look at where it is to be written.

use bokashi_cli::failure::Failure;
use bokashi_cli::run::{
    Writing, check_file, check_folder_of_out, end_when_interrupted, is_standard_output, pool,
};

use crate::arguments::{Command, Request};
use crate::{bench, stability, stiff};

/// Does all that `request` asks for.
pub(crate) fn run(request: &Request) -> Result<(), Failure> {
    if let Some(out) = request.out() {
        check_folder_of_out(out)?;
    }
    if let Some(file) = request.json().filter(|file| !is_standard_output(file)) {
        check_file(file, "--json")?;
    }
    let writing = Writing::default();
    end_when_interrupted(&writing, None)?;
    let work = || match &request.command {
        Command::Stability(arguments) => stability::run(arguments, &writing),
        Command::Stiff(arguments) => stiff::run(arguments, &writing),
        Command::Bench(arguments) => bench::run(arguments, &writing),
    };
    let Some(threads) = request.threads() else { return work() };
    if let Command::Stability(_) = request.command {
        // Its cases run in threads of their own, which see the global pool alone.
        pool(threads, rayon::ThreadPoolBuilder::build_global)?;
        return work();
    }
    pool(threads, rayon::ThreadPoolBuilder::build)?.install(work)
}
