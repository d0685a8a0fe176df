//! The program `bokashi`: the paper's experiments from the command line. What other programs of ours
//! share with it is public.

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
pub mod summary;
pub mod threads;
