//! The laws, one file each.

mod accumulation;
mod adjoint;
mod curvature;
mod differences;
mod linearity;
mod masks;
mod precision;
mod recycling;
mod threads;

#[cfg(test)]
mod tests;

use crate::failure::{Broken, Law};
use crate::trial::{Tally, Trial};

pub(crate) use recycling::refuses;

/// Checks one law on one case. [`Law::Defined`] holds where there is a trial at all;
/// [`Law::Refusals`] has cases of its own.
pub(crate) fn check(law: Law, trial: &Trial) -> Result<Tally, Broken> {
    match law {
        Law::Defined => Ok(Tally { compared: 1, ..Tally::default() }),
        Law::Differences => differences::check(trial),
        Law::Adjoint => adjoint::check(trial),
        Law::Curvature => curvature::check(trial),
        Law::Masks => masks::check(trial),
        Law::Accumulation => accumulation::check(trial),
        Law::Linearity => linearity::check(trial),
        Law::Recycling => recycling::check(trial),
        Law::Threads => threads::check(trial),
        Law::Precision => precision::check(trial),
        Law::Refusals => Ok(Tally::default()),
    }
}
