//! The program `bokashi`: fits of scenes and of the paper's experiments from the command line.
//!
//! `cargo install --path crates/cli --locked` installs it from a clone, and `bokashi --help` lists its commands.
//! This library is for the other programs of the workspace, which share arguments, signals and output with it. It
//! promises no stable interface.

pub mod about;
pub mod arguments;
mod digits;
pub mod failure;
mod inspect;
pub mod interrupt;
pub mod live;
mod manual;
mod new;
pub mod output;
pub mod panics;
pub mod places;
mod plain;
pub mod plan;
mod progress;
pub mod run;
mod samples;
mod scene;
pub mod threads;
