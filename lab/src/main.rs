//! What examines Bokashi, from the command line: for those who work on it.

use std::process::ExitCode;

fn main() -> ExitCode {
    bokashi_lab::program::main()
}
