//! What a step of a fit does beside its pipeline, and every loss and regularizer, compiled for `f32` and for `f64`: see
//! `bokashi_core::precompiled`. Nobody calls these functions.

use bokashi_core::{Scalar, Tape, Tensor, Var};

use crate::error::FitError;
use crate::losses::{
    DepthAlignment, Penalty, depth_error, mean_error, multiscale_ssim_error, silhouette_error,
    ssim_error,
};
use crate::optimizer::Optimizer;
use crate::parameter::Parameters;
use crate::regularizers::{
    RigidWeights, Rigidity, edge_length_error, laplacian_error, normal_error, total_variation,
};
use crate::topology::Topology;

macro_rules! for_each_precision {
    ($($name:ident: $t:ty),*) => {
        $(pub fn $name(parameters: &mut Parameters<$t>) -> Result<(), FitError> {
            update(parameters, &Tape::new())
        })*
    };
}

for_each_precision!(f32_update: f32, f64_update: f64);

macro_rules! losses_for_each_precision {
    ($($name:ident: $t:ty),*) => {
        $(pub fn $name(tape: &Tape<$t>) -> Result<(), FitError> {
            every_loss(tape.constant(&Tensor::zeros([])))
        })*
    };
}

losses_for_each_precision!(f32_losses: f32);
#[cfg(feature = "precompiled-f64")]
losses_for_each_precision!(f64_losses: f64);

fn every_loss<T: Scalar>(x: Var<'_, T>) -> Result<(), FitError> {
    let topology = Topology::new(&[], 0)?;
    let rigidity = Rigidity::new(&topology, &x.value(), RigidWeights::Uniform)?;
    let losses = [
        mean_error(x, x, Penalty::Squared)?,
        silhouette_error(x, x)?,
        total_variation(x, Penalty::Squared)?,
        multiscale_ssim_error(x, x, 1.0, None)?,
        ssim_error(x, x, 1.0)?,
        depth_error(x, x, None, DepthAlignment::None)?,
        laplacian_error(x, &topology.uniform_laplacian())?,
        laplacian_error(x, &topology.cotangent_laplacian(&x.value())?)?,
        edge_length_error(x, &topology, 0.0)?,
        normal_error(x, &topology)?,
        rigidity.error(x)?,
    ];
    losses[0].backward()?;
    Ok(())
}

fn update<T: Scalar>(parameters: &mut Parameters<T>, tape: &Tape<T>) -> Result<(), FitError> {
    let variables = parameters.record(tape);
    let gradients = variables.get("")?.backward()?;
    Optimizer::default().update(parameters, &variables, &gradients, 1.0)
}
