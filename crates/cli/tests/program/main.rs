//! The program as its users meet it: commands, scenes of their own, files made to do harm.

mod commands;
mod hostile;
mod scenes;
