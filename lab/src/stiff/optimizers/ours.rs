//! Our own first-order methods, through the fit loop.

use bokashi_core::Tensor;
use bokashi_fit::{Fit, FitSettings, Optimizer, Parameter, Parameters, from_fn};

use crate::stiff::evaluator::Evaluator;
use crate::stiff::ledger::Halt;

/// Steps of `optimizer` at a constant rate until the evaluator says stop.
pub(super) fn descend(
    evaluator: &Evaluator<'_>,
    optimizer: Optimizer,
    rate: f64,
) -> Result<(), String> {
    let problem = evaluator.problem();
    let start = Tensor::from_flat_fn([problem.size()], |k| problem.start()[k]);
    let parameter = Parameter::new("x", start).rate(rate);
    let parameters = Parameters::new().with(parameter).map_err(|error| error.to_string())?;
    let settings = FitSettings { optimizer, ..FitSettings::default() };
    let mut fit = Fit::new(parameters, settings).map_err(|error| error.to_string())?;
    let mut pipeline =
        from_fn(|_, variables| Ok(problem.record(variables.get("x")?)?.square().sum()));
    let mut before = problem.start().to_vec();
    loop {
        let [parameter] = fit.parameters().iter().collect::<Vec<_>>()[..] else {
            return Err("there is one parameter".to_owned());
        };
        before.copy_from_slice(parameter.raw().data());
        match fit.step(&mut pipeline) {
            Ok(stepped) => {
                if evaluator.account(stepped.loss, &before).is_err() {
                    return Ok(());
                }
            }
            Err(error) => return Err(evaluator.stop(Halt::Broken(error.to_string())).to_string()),
        }
    }
}
