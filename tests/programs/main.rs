//! Whole programs: fits, stiff problems, what is left out, and what fuzzing kept.

mod elision;
mod fits;
mod fuzz_corpus;
mod stiff;
