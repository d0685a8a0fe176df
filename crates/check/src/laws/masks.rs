//! A gradient has the same bits whichever other gradients are left out.
//!
//! For every subset of the differentiable inputs there are a backward pass to the subset alone, and
//! a recording in which the other inputs are constants. Both give the subset the gradients of the
//! full pass, and the other inputs none.

use bokashi_core::Tape;

use crate::failure::Broken;
use crate::run::{record, step};
use crate::trial::{Tally, Trial};

/// Up to this many inputs all subsets are tried; beyond, each input alone and all others.
const ALL_SUBSETS: usize = 6;

pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    let inputs: Vec<usize> = trial.gradients().map(|(i, _)| i).collect();
    let subsets: Vec<Vec<usize>> = if inputs.len() <= ALL_SUBSETS {
        let chosen = |bits: u32| {
            let chosen = inputs.iter().enumerate().filter(move |(k, _)| bits >> k & 1 == 1);
            chosen.map(|(_, &i)| i).collect()
        };
        (0..1_u32 << inputs.len()).map(chosen).collect()
    } else {
        let without = |out: usize| inputs.iter().copied().filter(|&i| i != out).collect();
        inputs.iter().flat_map(|&i| [vec![i], without(i)]).collect()
    };
    for subset in subsets {
        pass_to(trial, &subset, &mut tally)?;
        recording_with(trial, &subset, &mut tally)?;
    }
    Ok(tally)
}

/// A pass to `subset` over a recording that could give all gradients.
fn pass_to(trial: &Trial, subset: &[usize], tally: &mut Tally) -> Result<(), Broken> {
    let refused = |error: &dyn std::fmt::Display| Broken::from_message(error.to_string());
    let tape = Tape::new();
    let inputs = record(&tape, &trial.point);
    let outcome = trial.case.subject.apply_f64(&tape, &inputs).map_err(|error| refused(&error))?;
    let seeds: Vec<_> = outcome.outputs.iter().copied().zip(&trial.upstream).collect();
    let wrt: Vec<_> = subset.iter().map(|&i| inputs[i]).collect();
    let gradients = tape.vjp_to(&seeds, &wrt).map_err(|error| refused(&error))?;
    for (i, gradient) in trial.gradients() {
        if subset.contains(&i) {
            let alone = gradients.get_or_zeros(inputs[i]);
            tally.same_bits(&alone, gradient, || {
                format!("a pass to inputs {subset:?} alone: the gradient of in{i}")
            })?;
        } else if gradients.get(inputs[i]).is_some() {
            let what = format!("a pass to inputs {subset:?} alone gave in{i} a gradient");
            return Err(Broken::from_message(what));
        }
    }
    Ok(())
}

/// A recording in which all inputs but `subset` are constants.
fn recording_with(trial: &Trial, subset: &[usize], tally: &mut Tally) -> Result<(), Broken> {
    let mut point = trial.point.clone();
    for (i, (_, needs)) in point.iter_mut().enumerate() {
        *needs = subset.contains(&i);
    }
    let upstream: Vec<_> = trial.upstream.iter().cloned().map(Some).collect();
    let run = step(&Tape::new(), &*trial.case.subject, &point, &upstream);
    let run = run.map_err(|error| Broken::from_message(error.to_string()))?;
    for (j, (y, expected)) in run.outputs.iter().zip(&trial.nominal.outputs).enumerate() {
        let what = || format!("with a gradient for inputs {subset:?} alone: out{j}");
        tally.same_bits(y, expected, what)?;
    }
    for (i, gradient) in run.gradients.iter().enumerate() {
        match (gradient, &trial.nominal.gradients[i]) {
            (Some(gradient), Some(expected)) if subset.contains(&i) => {
                tally.same_bits(gradient, expected, || {
                    format!("with a gradient for inputs {subset:?} alone: that of in{i}")
                })?;
            }
            (Some(_), _) => {
                return Err(Broken::from_message(format!(
                    "in{i} is a constant and got a gradient"
                )));
            }
            (None, _) => {}
        }
    }
    Ok(())
}
