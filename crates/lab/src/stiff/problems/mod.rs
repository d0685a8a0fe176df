//! The problems: the literature's, and our scenes.
//!
//! | file | problems |
//! |---|---|
//! | `valleys` | curved valleys and bad scales, in closed form |
//! | `samples` | curves through measured or made-up samples |
//! | `many` | problems of any number of parameters |
//! | `systems` | systems of equations, linear problems, Chebyquad |
//! | `turn` | the angle of Helical valley, an operation of its own |
//! | `quadratic` | the rotated quadratic of condition 1e8 |
//! | `cube` | the paper's cube over a fixed set of poses |
//!
//! `numbers` has what they take apart and put together.
//!
//! # Source
//! More, Garbow and Hillstrom, *Testing unconstrained optimization software*, ACM Transactions on
//! Mathematical Software 7(1), 1981; the numbers in the comments are theirs. Minima that they
//! print to six digits stand here to the digits that Levenberg-Marquardt from several starts
//! agrees on.

mod cube;
mod many;
mod numbers;
#[cfg(test)]
mod oracle;
mod quadratic;
mod samples;
mod systems;
mod turn;
mod valleys;

use super::problem::Problem;

pub use cube::{SceneSettings, SigmaAs, scene};
pub use quadratic::rotated_quadratic;

/// The 35 problems of More, Garbow and Hillstrom.
pub fn literature() -> Vec<Problem> {
    let mut all = valleys::problems();
    all.extend(samples::problems());
    all.extend(many::problems());
    all.extend(systems::problems());
    all
}
