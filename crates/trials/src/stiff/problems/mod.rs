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
//! # Source
//! More, Garbow and Hillstrom, *Testing unconstrained optimization software*, ACM Transactions on
//! Mathematical Software 7(1), 1981; the numbers in the comments are theirs. Minima that they
//! print to six digits stand here to the digits that Levenberg-Marquardt from several starts
//! agrees on.

mod cube;
mod many;
#[cfg(test)]
mod oracle;
mod quadratic;
mod samples;
mod systems;
mod turn;
mod valleys;

use bokashi_core::{Scalar, Tensor, TensorError, Var};
use bokashi_fit::FitError;

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

/// The entry `k` of `x`, of shape `[1]`.
fn entry<'t, T: Scalar>(x: Var<'t, T>, k: usize) -> Result<Var<'t, T>, TensorError> {
    x.slice(0, k..k + 1)
}

/// The entries of `x: [N]`, of shape `[1]` each.
fn entries<'t, T: Scalar, const N: usize>(x: Var<'t, T>) -> Result<[Var<'t, T>; N], TensorError> {
    let mut all = [x; N];
    for (k, one) in all.iter_mut().enumerate() {
        *one = entry(x, k)?;
    }
    Ok(all)
}

/// Given numbers on the tape of `x`, of shape `[m]`.
fn given<'t, T: Scalar>(x: Var<'t, T>, values: &[f64]) -> Var<'t, T> {
    x.tape().constant(&Tensor::from_flat_fn([values.len()], |k| T::from_f64(values[k])))
}

/// Residuals of shape `[1]` each as one `[m]`.
fn stacked<'t, T: Scalar>(residuals: &[Var<'t, T>]) -> Result<Var<'t, T>, FitError> {
    Ok(Var::concat(residuals, 0)?)
}
