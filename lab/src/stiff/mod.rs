//! Optimizers against stiff problems: error against time and against gradient evaluations.
//!
//! [`study()`] runs every optimizer on every problem; [`markdown`] and [`page()`] show what it found.

mod conditioning;
mod evaluator;
mod ledger;
mod optimizers;
mod page;
mod problem;
mod profile;
mod study;
mod table;

pub mod problems;

pub use conditioning::{Conditioning, conditioning};
pub use ledger::{Budget, Counts, Halt, LEVELS, Moment, TARGET};
pub use optimizers::{Method, Outcome, RATES, Run, run};
pub use page::{FILES, markdown, page};
pub use problem::{Family, Problem, Residuals};
pub use profile::{Cost, Solver, profiles, share_within, shares, solvers};
pub use study::{Study, StudySettings, study};
