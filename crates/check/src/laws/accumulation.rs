//! Gradients add up: to what is already there, over two uses of a variable, over outputs.

use bokashi_core::{Tape, Tensor};

use crate::failure::{Broken, entry};
use crate::run::{largest, noise, record, run, step};
use crate::trial::{ROUNDINGS, Tally, Trial};

pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    begun_sums(trial, &mut tally)?;
    one_variable_as_two_inputs(trial, &mut tally)?;
    unused_outputs(trial, &mut tally)?;
    Ok(tally)
}

/// `got = a + b`, to the rounding of a sum whose terms are not known, only the order of their size.
fn compare_sums(
    tally: &mut Tally,
    got: &Tensor<f64>,
    terms: [&Tensor<f64>; 2],
    what: &str,
) -> Result<(), Broken> {
    let size = terms.iter().fold(largest(got), |size, term| size.max(largest(term)));
    let bound = (ROUNDINGS + got.size() as f64) * f64::EPSILON * size;
    for (k, &got_entry) in got.data().iter().enumerate() {
        let expected = terms[0].data()[k] + terms[1].data()[k];
        let entry_name = || format!("{what}{}", entry("", got.shape(), k));
        tally.compare((got_entry, expected), bound, entry_name)?;
    }
    Ok(())
}

/// An upstream gradient at the inputs themselves is a sum already begun when the subject's backward
/// pass comes to it.
fn begun_sums(trial: &Trial, tally: &mut Tally) -> Result<(), Broken> {
    let refused = |error: &dyn std::fmt::Display| Broken::from_message(error.to_string());
    let tape = Tape::new();
    let inputs = record(&tape, &trial.point);
    let outcome = trial.case.subject.apply_f64(&tape, &inputs).map_err(|error| refused(&error))?;
    let begun: Vec<_> = trial.gradients().map(|(i, gradient)| (i, noise(gradient, 401))).collect();
    let mut seeds: Vec<_> = outcome.outputs.iter().copied().zip(&trial.upstream).collect();
    seeds.extend(begun.iter().map(|(i, begun)| (inputs[*i], begun)));
    let gradients = tape.vjp(&seeds).map_err(|error| refused(&error))?;
    for ((i, gradient), (_, begun)) in trial.gradients().zip(&begun) {
        let sum = gradients.get_or_zeros(inputs[i]);
        let what = format!("added to a sum already begun: the gradient of in{i}");
        compare_sums(tally, &sum, [gradient, begun], &what)?;
    }
    Ok(())
}

/// One variable as two inputs of the same shape gets a sum: of the gradients that two variables of
/// the same value get.
fn one_variable_as_two_inputs(trial: &Trial, tally: &mut Tally) -> Result<(), Broken> {
    let inputs: Vec<usize> = trial.gradients().map(|(i, _)| i).collect();
    for (index, &i) in inputs.iter().enumerate() {
        for &k in &inputs[index + 1..] {
            if trial.point[i].0.shape() != trial.point[k].0.shape() {
                continue;
            }
            let mut point = trial.point.clone();
            point[k] = point[i].clone();
            // Not every value of one input is one of the other: 0 as a divisor, say.
            let Ok(apart) = run(&*trial.case.subject, &point, &trial.upstream) else { continue };
            if !apart.gradients.iter().flatten().all(Tensor::is_finite) {
                continue;
            }
            let tape = Tape::new();
            let mut variables = record(&tape, &point);
            variables[k] = variables[i];
            let outcome = trial.case.subject.apply_f64(&tape, &variables);
            let outcome = outcome.map_err(|error| {
                Broken::from_message(format!("refuses one variable as in{i} and in{k}: {error}"))
            })?;
            let seeds: Vec<_> = outcome.outputs.iter().copied().zip(&trial.upstream).collect();
            let gradients =
                tape.vjp(&seeds).map_err(|error| Broken::from_message(error.to_string()))?;
            let sum = gradients.get_or_zeros(variables[i]);
            let [Some(first), Some(second)] = [&apart.gradients[i], &apart.gradients[k]] else {
                continue;
            };
            let what = format!("the gradient of one variable as in{i} and in{k}");
            compare_sums(tally, &sum, [first, second], &what)?;
        }
    }
    Ok(())
}

/// An output alone gives the same gradient whether the others are unused or have an upstream
/// gradient of zeros; and the sum over outputs is the gradient.
fn unused_outputs(trial: &Trial, tally: &mut Tally) -> Result<(), Broken> {
    let outputs = trial.upstream.len();
    if outputs < 2 {
        return Ok(());
    }
    let refused = |error: crate::Refusal| Broken::from_message(error.to_string());
    let mut sums: Vec<Option<Tensor<f64>>> = vec![None; trial.point.len()];
    for j in 0..outputs {
        let alone = |k: usize| (k == j).then(|| trial.upstream[k].clone());
        let alone: Vec<_> = (0..outputs).map(alone).collect();
        let zeros = |(k, u): (usize, &Tensor<f64>)| if k == j { u.clone() } else { u.map(|_| 0.0) };
        let zeros: Vec<_> = trial.upstream.iter().enumerate().map(zeros).collect();
        let unused = step(&Tape::new(), &*trial.case.subject, &trial.point, &alone);
        let unused = unused.map_err(refused)?;
        let zeros = run(&*trial.case.subject, &trial.point, &zeros).map_err(refused)?;
        for (i, (unused, zeros)) in unused.gradients.iter().zip(&zeros.gradients).enumerate() {
            let (Some(unused), Some(zeros)) = (unused, zeros) else { continue };
            compare_sums(
                tally,
                unused,
                [zeros, &zeros.map(|_| 0.0)],
                &format!("only out{j} used: the gradient of in{i}"),
            )?;
            let sum = sums[i].get_or_insert_with(|| unused.map(|_| 0.0));
            let entries = sum.data_mut().iter_mut().zip(unused.data());
            entries.for_each(|(sum, entry)| *sum += entry);
        }
    }
    for (i, gradient) in trial.gradients() {
        let Some(sum) = &sums[i] else { continue };
        let what = format!("sum over outputs: the gradient of in{i}");
        compare_sums(tally, sum, [gradient, &gradient.map(|_| 0.0)], &what)?;
    }
    Ok(())
}
