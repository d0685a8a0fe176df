//! Fits of any differentiable pipeline on the Bokashi tape.
//!
//! [`Parameters`] are what changes, a [`Pipeline`] says how a loss follows from them, and a [`Fit`]
//! steps until a rule says stop; its [`History`] holds the loss and the error of every step:
//!
//! ```
//! use bokashi_core::{Tensor, Tape};
//! use bokashi_fit::{Fit, FitSettings, Mapping, Parameter, Parameters, from_fn, squared_error};
//!
//! // y = a exp(-k t), with k > 0, from four samples.
//! let times = Tensor::from_flat_fn([4], |n| n as f64);
//! let samples = times.map(|t: f64| 3.0 * (-0.5 * t).exp());
//! let parameters = Parameters::new()
//!     .with(Parameter::new("a", Tensor::scalar(1.0)).rate(0.1))?
//!     .with(Parameter::new("k", Tensor::scalar(1.0)).rate(0.05).mapping(Mapping::Softplus))?;
//! let mut decay = from_fn(|tape: &Tape<f64>, variables| {
//!     let t = tape.constant(&times);
//!     let curve = variables.get("a")? * (-variables.get("k")? * t).exp();
//!     Ok(squared_error(curve, tape.constant(&samples))?)
//! });
//! let mut fit = Fit::new(parameters, FitSettings::default())?;
//! fit.run(&mut decay)?;
//! assert!((fit.parameters().value("k")?.item() - 0.5).abs() < 1e-6);
//! # Ok::<(), bokashi_fit::FitError>(())
//! ```
//!
//! # What there is
//!
//! | topic | what |
//! |---|---|
//! | what is learnt | [`Parameters`], [`Parameter`] with a rate, a [`Mapping`] and perhaps a [`Preconditioner`]; [`Variables`] of a step |
//! | what is fitted | [`Pipeline`]; [`from_fn`] makes one of a closure, [`views()`] one of many views |
//! | the loop | [`Fit`], [`FitSettings`], [`Optimizer`] (gradient descent, Adam, AMSGrad), [`Schedule`] of rates, [`History`]; [`drive`] with [`Rules`] and [`Listener`]s |
//! | losses | [`squared_error`], [`mean_squared_error`]; [`mean_error`], [`masked_error`] and [`weighted_error`] of a [`Penalty`]; [`ssim_error`], [`multiscale_ssim_error`], [`silhouette_error`], [`depth_error`], [`pyramid_error`] |
//! | measures without a gradient | [`psnr`], [`ssim`], [`iou`] |
//! | regularizers | [`laplacian_error`], [`edge_length_error`], [`normal_error`], [`Rigidity`] on a [`Topology`]; [`total_variation`] |
//! | many machines | [`Communicator`]: what the ranks of a job say to each other |
//!
//! `docs/rates.md` says how to choose rates.
//!
//! # Features
//!
//! `parallel` and `render` are on by default. With `render` a [`FitError`] can be made of an error of a rendering
//! operation; with `save` a fit can be saved to a file and resumed from it, to the same bits; with `precondition`
//! `Preconditioner::new` makes steps smooth.

mod best_rotation;
mod communicator;
mod error;
mod fit;
mod given;
mod history;
mod in_memory;
mod losses;
mod optimizer;
mod parameter;
mod pipeline;
// Unit tests compile what they call.
#[cfg(all(feature = "precompiled", not(test)))]
#[doc(hidden)]
pub mod precompiled;
mod preconditioner;
mod reduction;
mod regularizers;
#[cfg(feature = "save")]
pub mod saved;
mod schedule;
mod sign;
mod stopping;
mod topology;
mod views;

pub use bokashi_core::{mean_squared_error, squared_error};
pub use communicator::{Alone, Communicator, Ranks, agree, agreed, block, check_alike, check_same};
pub use error::{FitError, OperationError, Origin, Quantity};
pub use fit::{
    AfterStep, Answer, BeforeUpdate, Every, Fit, FitSettings, Fitting, Listener, Observer, Rules,
    StepState, Stepped, Steps, after_step, before_update, drive, every,
};
pub use given::{Difference, Given, described, differences};
pub use history::{History, Step, Vanished};
pub use in_memory::on_ranks;
pub use losses::{
    DepthAlignment, Penalty, depth_error, halved, iou, masked_error, mean_error,
    multiscale_ssim_error, psnr, pyramid_error, silhouette_error, ssim, ssim_error, weighted_error,
};
pub use optimizer::Optimizer;
pub use parameter::{Mapping, Parameter, Parameters, Variables};
pub use pipeline::{FromFn, Pipeline, from_fn};
pub use preconditioner::Preconditioner;
pub use reduction::sum_over_ranks;
pub use regularizers::{
    RigidWeights, Rigidity, edge_length_error, laplacian_error, normal_error, total_variation,
};
#[cfg(feature = "save")]
pub use saved::Stored;
pub use schedule::Schedule;
pub use stopping::{LossRules, Losses, Stop};
pub use topology::Topology;
pub use views::{View, Views, views};
