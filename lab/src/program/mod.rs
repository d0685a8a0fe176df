//! The command line of the program `bokashi-lab`.

mod arguments;
mod bench;
mod files;
mod models;
mod run;
mod stability;
mod stiff;

use std::process::ExitCode;

use bokashi_cli::arguments::Stopped;
use bokashi_cli::failure::ended;
use bokashi_cli::output::say;
use bokashi_cli::panics;

/// Does what the command line asks for, and returns the status.
pub fn main() -> ExitCode {
    panics::leave_guarded_out();
    let result = match arguments::parse(std::env::args_os()) {
        Ok(request) => run::run(&request),
        Err(Stopped::Shown(text)) => say(&text),
        Err(Stopped::Wrong(failure)) => Err(failure),
    };
    ended("bokashi-lab", result)
}
