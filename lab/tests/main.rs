//! The laboratory: its program, stiff problems, what is left out, and what fuzzing kept.

mod elision;
mod fuzz_corpus;
mod program;
#[path = "../../crates/cli/tests/program/run.rs"]
mod run;
mod stiff;
