//! Pipelines: compositions of operations that end in a loss.

use std::marker::PhantomData;

use bokashi_core::{Scalar, Tape, Var};

use crate::communicator::{Alone, Communicator};
use crate::error::FitError;
use crate::parameter::{Parameters, Variables};

/// A computation from parameters to a loss. Generic over `T`, it runs in `f32` and in `f64`.
///
/// A pipeline without inputs that change is a function: see [`from_fn`].
pub trait Pipeline<T: Scalar> {
    /// The errors of the parameters against the truth; `()` where it is unknown.
    type Measure: Clone + Default;

    /// Sets inputs that change from step to step and are not learnt: a pose, a reference image. It is called once per
    /// step, before [`Pipeline::loss`], and timed apart.
    ///
    /// # Errors
    /// Whatever the operations refuse.
    fn prepare(&mut self, step: u64) -> Result<(), FitError> {
        let _ = step;
        Ok(())
    }

    /// [`Pipeline::prepare`] with the tape of the step; a fit calls this one. To compute a reference image,
    /// [`Tape::aside`] uses memory of the tape that the step needs later.
    ///
    /// # Errors
    /// As [`Pipeline::prepare`].
    fn prepare_on(&mut self, step: u64, tape: &Tape<T>) -> Result<(), FitError> {
        let _ = tape;
        self.prepare(step)
    }

    /// Appends to `state` what a resumed pipeline needs beside the number of the step, such as the state of a
    /// generator. It is called before each [`Pipeline::prepare`], in case the fit is saved in that step.
    #[cfg(feature = "save")]
    fn save_state(&self, state: &mut Vec<u8>) {
        let _ = state;
    }

    /// Restores the `state` of a saved fit, before the first step.
    ///
    /// # Errors
    /// Those of the state; [`FitError::Saved`] for any state, where the pipeline saves none.
    #[cfg(feature = "save")]
    fn restore_state(&mut self, state: &[u8]) -> Result<(), FitError> {
        match state {
            [] => Ok(()),
            _ => Err(FitError::saved("a pipeline that takes its state back", "one that has none")),
        }
    }

    /// Records the loss of the parameters `variables`, a scalar, on `tape`.
    ///
    /// # Errors
    /// Whatever the operations refuse.
    fn loss<'t>(
        &mut self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError>;

    /// The ranks that share the pipeline's steps.
    fn ranks(&self) -> &dyn Communicator<T> {
        &Alone
    }

    /// Measures the parameters against the truth.
    fn measure(&self, parameters: &Parameters<T>) -> Self::Measure {
        let _ = parameters;
        Self::Measure::default()
    }
}

/// A function from parameters to a loss as a [`Pipeline`].
#[derive(Debug, Clone, Copy)]
pub struct FromFn<T, F> {
    loss: F,
    numbers: PhantomData<fn(T)>,
}

/// Makes a [`Pipeline`] of a function from parameters to a loss.
///
/// ```
/// use bokashi_core::Tensor;
/// use bokashi_fit::{Fit, FitSettings, Parameter, Parameters, from_fn};
///
/// let x = Parameter::new("x", Tensor::new([2], vec![3.0, -4.0])?).rate(0.1);
/// let mut bowl = from_fn(|_tape, variables| {
///     let x = variables.get("x")?;
///     Ok((x * x).sum())
/// });
/// let mut fit = Fit::<f64>::new(Parameters::new().with(x)?, FitSettings::default())?;
/// let history = fit.run(&mut bowl)?;
/// assert!(history.last().loss < 1e-6 * history.initial().loss);
/// # Ok::<(), bokashi_fit::FitError>(())
/// ```
///
/// The function may change variables that it captures, for instance to return its last picture.
///
/// ```
/// # use bokashi_core::Tensor;
/// # use bokashi_fit::{Fit, FitSettings, Parameter, Parameters, from_fn};
/// # let x = Parameter::new("x", Tensor::new([2], vec![3.0, -4.0])?);
/// let mut picture = Tensor::zeros([2]);
/// let mut pipeline = from_fn(|_tape, variables| {
///     let image = variables.get("x")?.exp();
///     picture = image.value();
///     Ok(image.sum())
/// });
/// Fit::<f64>::new(Parameters::new().with(x)?, FitSettings::default())?.step(&mut pipeline)?;
/// assert_eq!(picture.data(), [3_f64.exp(), (-4_f64).exp()]);
/// # Ok::<(), bokashi_fit::FitError>(())
/// ```
pub fn from_fn<T, F>(loss: F) -> FromFn<T, F>
where
    T: Scalar,
    F: for<'t> FnMut(&'t Tape<T>, &Variables<'t, T>) -> Result<Var<'t, T>, FitError>,
{
    FromFn { loss, numbers: PhantomData }
}

impl<T, F> Pipeline<T> for FromFn<T, F>
where
    T: Scalar,
    F: for<'t> FnMut(&'t Tape<T>, &Variables<'t, T>) -> Result<Var<'t, T>, FitError>,
{
    type Measure = ();

    fn loss<'t>(
        &mut self,
        tape: &'t Tape<T>,
        variables: &Variables<'t, T>,
    ) -> Result<Var<'t, T>, FitError> {
        (self.loss)(tape, variables)
    }
}
