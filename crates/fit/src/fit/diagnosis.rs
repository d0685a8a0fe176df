//! Diagnosis of a step that fails: a loss that is not finite, or a parameter that no gradient can reach.

use bokashi_core::{Dependence, Gradients, Scalar, Tape, TensorError, Var};

use crate::error::{FitError, Origin, Quantity};
use crate::parameter::{Parameters, Variables};
use crate::pipeline::Pipeline;

/// Records the loss and checks that it is a finite scalar. If a parameter's value is not finite, the error
/// names the parameter.
pub(super) fn record_loss<'t, T: Scalar, P: Pipeline<T>>(
    pipeline: &mut P,
    tape: &'t Tape<T>,
    parameters: &Parameters<T>,
    variables: &Variables<'t, T>,
) -> Result<Var<'t, T>, FitError> {
    let loss = match pipeline.loss(tape, variables) {
        Ok(loss) => loss,
        Err(error) => {
            parameters.check_values()?;
            return Err(error);
        }
    };
    let shape = loss.shape();
    if shape.size() != 1 {
        return Err(TensorError::NotScalar { shape }.into());
    }
    let value = loss.item();
    if !value.is_finite() {
        parameters.check_values()?;
        let origin = variables.origin_on(tape);
        let (value, step) = (value.to_f64(), parameters.updates);
        return Err(FitError::NotFinite { quantity: Quantity::Loss, value, step, origin });
    }
    Ok(loss)
}

/// Checks that the loss depends on every fitted parameter. A dependence without a gradient in this step
/// counts. Without one, no later step of the same pipeline has a gradient either.
pub(super) fn check_ways<'t, T: Scalar>(
    parameters: &Parameters<T>,
    variables: &Variables<'t, T>,
    loss: Var<'t, T>,
) -> Result<(), FitError> {
    for (parameter, variable) in parameters.list.iter().zip(&variables.list) {
        if parameter.is_frozen() || parameter.is_optional {
            continue;
        }
        // The value, not the raw numbers: its mapping is no operation of the pipeline.
        if let Dependence::None { end, is_detached } = loss.dependence_on(variable.value)? {
            let parameter = parameter.name().to_owned();
            return Err(FitError::NoInfluence { parameter, end, is_detached });
        }
    }
    Ok(())
}

/// The error, with the first place where gradients of `loss` are infinite or NaN if it is about a gradient.
pub(super) fn with_origin<T: Scalar>(error: FitError, loss: Var<'_, T>) -> FitError {
    match error {
        FitError::NotFinite { quantity: quantity @ Quantity::Gradient(_), value, step, .. } => {
            let first = loss.first_gradient_not_finite().ok().flatten();
            let operation = first.and_then(Var::operation);
            let origin = operation.map(|operation| Box::new(Origin::Backward { operation }));
            FitError::NotFinite { quantity, value, step, origin }
        }
        error => error,
    }
}

/// Whether every entry of every gradient is smaller than `limit`.
pub(super) fn all_below<'t, T: Scalar>(
    limit: f64,
    variables: &Variables<'t, T>,
    gradients: &Gradients<'t, T>,
) -> bool {
    let mut all = variables.list.iter().filter_map(|variable| gradients.get(variable.raw));
    all.all(|gradient| gradient.data().iter().all(|entry| entry.abs().to_f64() < limit))
}
