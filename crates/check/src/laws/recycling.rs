//! A tape that was used before is as good as a new one: after a step, and after a refusal.

use bokashi_core::Tape;

use crate::failure::Broken;
use crate::run::{Run, caught, point, record, step};
use crate::subject::Case;
use crate::trial::{Tally, Trial};

/// The same step three times on one tape gives the bits of a new tape. Before each, another step
/// leaves other numbers in the memory.
pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    let upstream: Vec<_> = trial.upstream.iter().cloned().map(Some).collect();
    let mut other = trial.point.clone();
    for (tensor, _) in &mut other {
        tensor.data_mut().iter_mut().for_each(|entry| *entry *= 0.5);
    }
    let mut tape = Tape::new();
    for k in 0..3 {
        // Half of the values need not be values that the subject takes.
        let _ = step(&tape, &*trial.case.subject, &other, &upstream);
        tape.reset();
        let run = step(&tape, &*trial.case.subject, &trial.point, &upstream);
        let run = run.map_err(|error| Broken::from_message(format!("step {k}: {error}")))?;
        compare(&mut tally, &run, &trial.nominal, &format!("step {k} on one tape"))?;
        tape.reset();
    }
    Ok(tally)
}

/// Outputs and gradients of two runs, bit by bit.
pub(super) fn compare<T: bokashi_core::Scalar>(
    tally: &mut Tally,
    run: &Run<T>,
    expected: &Run<T>,
    when: &str,
) -> Result<(), Broken> {
    for (j, (y, expected)) in run.outputs.iter().zip(&expected.outputs).enumerate() {
        tally.same_bits(y, expected, || format!("{when}: out{j}"))?;
    }
    for (i, (x, expected)) in run.gradients.iter().zip(&expected.gradients).enumerate() {
        let (Some(x), Some(expected)) = (x, expected) else { continue };
        tally.same_bits(x, expected, || format!("{when}: gradient of in{i}"))?;
    }
    if run.state != expected.state {
        return Err(Broken::from_message(format!("{when}: another discrete state")));
    }
    Ok(())
}

/// Wrong inputs are an error with this message, and leave the tape as it was. The tape is no longer than before,
/// except for the first operations of a pipeline, and a step that was recorded before gives `right`
/// its gradients to the same bits.
pub(crate) fn refuses(
    wrong: &Case,
    message: &str,
    is_pipeline: bool,
    right: &Trial,
) -> Result<Tally, Broken> {
    let refused = |error: &dyn std::fmt::Display| Broken::from_message(error.to_string());
    let mut tally = Tally::default();
    let tape = Tape::<f64>::new();
    let inputs = record(&tape, &right.point);
    let outcome = right.case.subject.apply_f64(&tape, &inputs).map_err(|error| refused(&error))?;

    let wrong_inputs = record(&tape, &point(&wrong.inputs));
    let before = tape.len();
    match caught(|| wrong.subject.apply_f64(&tape, &wrong_inputs).map(|_| ())) {
        Ok(Err(error)) if error.to_string() == message => tally.compared += 1,
        Ok(Err(error)) => {
            return Err(Broken::from_message(format!(
                "the error is \"{error}\", not \"{message}\""
            )));
        }
        Ok(Ok(())) => {
            return Err(Broken::from_message(format!("it was taken, without \"{message}\"")));
        }
        Err(panic) => {
            return Err(Broken::from_message(format!(
                "it panicked, without \"{message}\": {panic}"
            )));
        }
    }
    let after = tape.len();
    if after != before && !is_pipeline {
        let what = format!("the refusal left {after} values on a tape of {before}");
        return Err(Broken::from_message(what));
    }

    let seeds: Vec<_> = outcome.outputs.iter().copied().zip(&right.upstream).collect();
    let gradients = tape.vjp(&seeds).map_err(|error| refused(&error))?;
    for (j, (&(y, _), expected)) in seeds.iter().zip(&right.nominal.outputs).enumerate() {
        tally.same_bits(&y.value(), expected, || format!("after the refusal: out{j}"))?;
    }
    for (i, expected) in right.gradients() {
        let gradient = gradients.get_or_zeros(inputs[i]);
        let what = || format!("after the refusal: gradient of in{i}");
        tally.same_bits(&gradient, expected, what)?;
    }
    Ok(tally)
}
