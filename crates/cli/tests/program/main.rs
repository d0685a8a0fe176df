//! The program as its users meet it: commands, scenes of their own, files made to do harm.

mod commands;
mod hostile;
mod run;
mod scenes;

const PROGRAM: &str = env!("CARGO_BIN_EXE_bokashi");
