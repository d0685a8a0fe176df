//! Property-based gradient tests for anyone's operations on the Bokashi tape.

mod check;
mod dual;
mod failure;
mod laws;
mod mutation;
mod run;
mod shrink;
mod subject;
mod trial;

pub mod strategy;

pub use bokashi_core::{Scalar, Tape, Var};
pub use check::{Check, Report};
pub use dual::Dual;
pub use failure::{Broken, Failure, Law, Numbers};
pub use mutation::{Kills, Mutation};
pub use subject::{Case, Input, Outcome, Refusal, Subject, sides};
pub use trial::Tally;
