//! The paper's experiments from the command line.

use std::process::ExitCode;

use bokashi_cli::{arguments, run};

fn main() -> ExitCode {
    let result = match arguments::parse(std::env::args_os()) {
        Ok(request) => run::run(&request),
        Err(arguments::Stopped::Shown(text)) => run::say(&text),
        Err(arguments::Stopped::Wrong(failure)) => Err(failure),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("bokashi: {failure}");
            failure.exit_code()
        }
    }
}
