//! The paper's experiments from the command line.

use std::process::ExitCode;

use bokashi_cli::failure::ended;
use bokashi_cli::{arguments, output, panics, run};

fn main() -> ExitCode {
    panics::leave_guarded_out();
    let result = match arguments::parse(std::env::args_os()) {
        Ok(request) => run::run(&request),
        Err(arguments::Stopped::Shown(text)) => output::say(&text),
        Err(arguments::Stopped::Wrong(failure)) => Err(failure),
    };
    ended("bokashi", result)
}
