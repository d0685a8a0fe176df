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
//! A check tries every [`Law`] on every case. It compares the gradient with difference quotients,
//! which have an error bar of their own, and with a forward-mode run over [dual numbers](Dual). It
//! looks at Hessian-vector products, every subset of the inputs that need a gradient, accumulation,
//! linearity, recycled memory, numbers of threads, `f32` against `f64`, and wrong input. Nobody
//! chooses tolerances: each is the measured error bar of the reference.
//!
//! A failure is made small: first the shapes, then the upstream gradient, down to one entry, then
//! the values. It reads
//! `row norm breaks the law of differences: d out[0] / d in0[0,0]: got 2, expected 1 +- 1e-11`.
//!
//! Cases are always the same: the same check gives the same result.
//!
//! # Where an operation is not smooth
//!
//! It declares its discrete state ([`Outcome::with_state`]): ids, edge choices, sides of a kink.
//! Points where that changes within the stencil are left out and counted, and too many of them are
//! a failure.
//!
//! A kink that was not declared is seen only where a case comes close to it, within some 1e-5 of
//! `max(1, |x|)`. Inputs on a regular grid may never do so: [`strategy::around`] draws numbers
//! beside a kink and on it.
//!
//! # Is the check able to fail?
//!
//! [`Check::kills`] makes wrong adjoints from the right one (a sign, a percent, a dropped input, a
//! gradient written over another, a transposed one) and counts how many of them the check catches.
//!
//! # What cannot be seen
//!
//! A wrong gradient at values that no case comes near; a mistake that is smaller than the error bar
//! of every law; discrete state that is declared to change everywhere. The tape itself refuses two
//! things: to read a value that the operation did not ask to keep, and to touch a gradient that is
//! not needed.

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
pub use subject::{Applied, Case, Input, Number, Outcome, Refusal, Subject, sides};
pub use trial::Tally;
