//! Property-based gradient tests for anyone's operations on the Bokashi tape.
//!
//! One call checks an operation, or a whole pipeline, for which you give a strategy of inputs:
//!
//! ```
//! use bokashi_check::{Check, Input, strategy, subject};
//! use proptest::strategy::Strategy;
//!
//! subject!(Product: |x| x[0].try_mul(x[1])?);
//!
//! let factor = || strategy::tensor([2, 3], strategy::number()).prop_map(Input::leaf);
//! let inputs = (factor(), factor()).prop_map(|(x, y)| vec![x, y]);
//! let check = Check::new("product", Product, inputs).cases(8);
//! check.assert();
//! assert_eq!(check.kills()?.rate(), Some(1.0));
//! # Ok::<(), Box<bokashi_check::Failure>>(())
//! ```
//!
//! # What is checked
//!
//! Every [`Law`] on every case: the gradient against difference quotients with an error bar of their
//! own, against a forward-mode run over [dual numbers](Dual), Hessian-vector products, every subset
//! of the inputs that need a gradient, accumulation, linearity, recycled memory, any number of
//! threads, `f32` against `f64`, and wrong input. Tolerances are not chosen: each is the measured
//! error bar of what it is compared with.
//!
//! A failure is made small: first the shapes, then the upstream gradient, down to one entry, then the
//! values. It reads
//! `row norm breaks the law of differences: d out[0] / d in0[0,0]: got 2, expected 1 +- 1e-11`.
//!
//! Cases are always the same ones: the same check gives the same result.
//!
//! # Where an operation is not smooth
//!
//! It declares its discrete state ([`Outcome::with_state`]): ids, edge choices, sides of a kink.
//! Points where that changes within the stencil are left out and counted, and too many of them are
//! a failure. So is a kink that was not declared.
//!
//! # Is the check able to fail?
//!
//! [`Check::kills`] makes wrong adjoints from the right one (a sign, a percent, a dropped input, a
//! gradient written over another, a transposed one) and counts how many of them the check catches.
//!
//! # What cannot be seen
//!
//! A gradient of a value that no case comes near; a mistake that is smaller than the error bar of
//! every law; discrete state that is declared to change everywhere. The tape itself refuses what an
//! operation must not do: to read what it did not ask to keep, or a gradient that is not needed.

mod check;
mod failure;
mod laws;
mod mutation;
mod run;
mod shrink;
mod subject;
mod trial;

pub mod strategy;

pub use bokashi_core::{Dual, Scalar, Tape, Var};
pub use check::{Check, CheckReport};
pub use failure::{Broken, Failure, Law, Numbers};
pub use mutation::{Kills, Mutation};
pub use subject::{Case, Input, Outcome, Refusal, Subject, sides};
pub use trial::Tally;
