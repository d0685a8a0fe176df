//! The laboratory: its program, stiff problems, what is left out, and what fuzzing kept.

mod elision;
mod fuzz_corpus;
mod program;
mod stiff;
