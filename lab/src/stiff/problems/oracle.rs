//! Our problems against those of the `mgh` crate: an implementation by others of the same paper.

use bokashi_core::{Tape, Tensor};

use super::super::problem::Problem;

/// The objective, the start, and a minimiser where the crate has one.
pub(super) type Oracle = (fn(&[f64]) -> f64, Vec<f64>, Option<Vec<f64>>);

/// Checks starts, values along a crooked path away from the start, gradients against difference
/// quotients of the oracle, and minima.
pub(super) fn agrees<const N: usize>(problems: &[Problem], oracle: [Oracle; N]) {
    assert_eq!(problems.len(), N);
    for (problem, (objective, start, minimiser)) in problems.iter().zip(oracle) {
        let name = problem.name();
        assert_eq!(problem.start(), start, "{name}");
        for step in 0..4 {
            let shift = |k: usize| 0.01 * (step * (1 + k)) as f64 * (1.0 + start[k].abs());
            let x: Vec<f64> = start.iter().enumerate().map(|(k, x)| x + shift(k)).collect();
            let (ours, theirs) = (problem.objective(&x).unwrap(), objective(&x));
            assert!((ours - theirs).abs() <= 1e-12 * theirs, "{name} {ours} {theirs}");
            gradient_agrees(problem, objective, &x);
        }
        if let Some(known) = problem.minimiser() {
            // As many digits as the minimiser is known to.
            let (value, least) = (objective(known), problem.least());
            let scale = objective(&start) - least;
            assert!((value - least).abs() <= 1e-9 * scale, "{name} {value} {least}");
        }
        if let (Some(ours), Some(theirs)) = (problem.minimiser(), minimiser) {
            for (ours, theirs) in ours.iter().zip(&theirs) {
                let scale = theirs.abs().max(1e-6);
                assert!((ours - theirs).abs() <= 6e-3 * scale, "{name} {ours} {theirs}");
            }
        }
    }
}

/// Checks the tape's gradient at `x` against central differences of the oracle at two widths,
/// within the error that their difference shows.
fn gradient_agrees(problem: &Problem, objective: fn(&[f64]) -> f64, x: &[f64]) {
    let tape = Tape::new();
    let leaf = tape.leaf(&Tensor::new([x.len()], x.to_vec()).unwrap());
    let loss = problem.record(leaf).unwrap().square().sum();
    let gradient = loss.backward().unwrap().get_or_zeros(leaf);
    let quotient = |k: usize, h: f64| {
        let value_at = |step: f64| {
            let mut moved = x.to_vec();
            moved[k] += step;
            objective(&moved)
        };
        (value_at(h) - value_at(-h)) / (2.0 * h)
    };
    for k in 0..x.len() {
        let h = 6e-6 * x[k].abs().max(1e-2);
        let (near, far) = (quotient(k, h), quotient(k, 2.0 * h));
        let richardson = near + (near - far) / 3.0;
        // Truncation as the two differ; rounding of residuals, differences of numbers near 1 or
        // above, over the width.
        let size = objective(x);
        let bar = (near - far).abs() + 8.0 * f64::EPSILON * (size + size.sqrt()) / h;
        let got = gradient.data()[k];
        let name = problem.name();
        assert!((got - richardson).abs() <= bar, "{name} {k}: {got}, {richardson} +- {bar}");
    }
}
