//! The problems: the literature's, and our scenes.
//!
//! | file | problems |
//! |---|---|
//! | `literature` | ten published ones |
//! | `quadratic` | the rotated quadratic of condition 1e8 |
//! | `cube` | the paper's cube over a fixed set of poses |
//!
//! # Source
//! More, Garbow and Hillstrom, *Testing unconstrained optimization software*, ACM Transactions on
//! Mathematical Software 7(1), 1981. Minima that they print to six digits stand here to the digits that
//! Levenberg-Marquardt from several starts agrees on.

mod cube;
mod literature;
#[cfg(test)]
mod oracle;
mod quadratic;

pub use cube::{SceneSettings, SigmaAs, scene};
pub use literature::literature;
pub use quadratic::rotated_quadratic;
