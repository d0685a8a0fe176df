//! What examines Bokashi, from the command line: for those who work on it.

mod arguments;
mod bench;
mod models;
mod run;
mod stability;
mod stiff;

use std::process::ExitCode;

use bokashi_cli::arguments::Stopped;
use bokashi_cli::failure::ended;
use bokashi_cli::output::say;
use bokashi_cli::panics;

fn main() -> ExitCode {
    panics::leave_guarded_out();
    let result = match arguments::parse(std::env::args_os()) {
        Ok(request) => run::run(&request),
        Err(Stopped::Shown(text)) => say(&text),
        Err(Stopped::Wrong(failure)) => Err(failure),
    };
    ended("bokashi-lab", result)
}
