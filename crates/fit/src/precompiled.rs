//! What a step of a fit does beside its pipeline, compiled for `f32` and for `f64`: see
//! `bokashi_core::precompiled`. Nobody calls these functions.

use bokashi_core::{Scalar, Tape};

use crate::error::FitError;
use crate::optimizer::Optimizer;
use crate::parameter::Parameters;

macro_rules! for_each_precision {
    ($($name:ident: $t:ty),*) => {
        $(pub fn $name(parameters: &mut Parameters<$t>) -> Result<(), FitError> {
            update(parameters, &Tape::new())
        })*
    };
}

for_each_precision!(f32_update: f32, f64_update: f64);

fn update<T: Scalar>(parameters: &mut Parameters<T>, tape: &Tape<T>) -> Result<(), FitError> {
    let variables = parameters.record(tape);
    let gradients = variables.get("")?.backward()?;
    Optimizer::default().update(parameters, &variables, &gradients, 1.0)
}
