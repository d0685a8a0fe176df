//! The paper's experiments from the command line.

mod arguments;
mod bench;
mod failure;
mod plan;
mod progress;
mod run;
mod stability;
mod stiff;
mod summary;

use std::process::ExitCode;

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
