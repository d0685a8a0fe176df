//! `f32` against the same subject in `f64`, on inputs that both can represent.
//!
//! No operation can do better than the rounding of its inputs allows. So the bound is measured: in
//! `f64`, the inputs and upstream gradients are moved by a unit roundoff of `f32` in random
//! directions. The largest change of each number, plus a roundoff of its tensor's largest entry, is
//! the size of one rounding. `SLACK` such roundings are allowed.
//!
//! Cases whose discrete state differs between the precisions, or under the random moves, are left
//! out.

use bokashi_core::Tensor;

use crate::failure::{Broken, entry};
use crate::run::{Point, Run, largest, noise, run};
use crate::trial::{Tally, Trial};

/// Random moves of the inputs.
const MOVES: u64 = 6;
/// Operations round, too, and each rounding can be as large as that of an input. And six random
/// moves don't find the worst direction.
const SLACK: f64 = 16.0;

pub(super) fn check(trial: &Trial) -> Result<Tally, Broken> {
    let mut tally = Tally::default();
    let left_out = Ok(Tally { left_out: 1, ..Tally::default() });
    let subject = &*trial.case.subject;
    let narrow_point: Point<f32> =
        trial.point.iter().map(|(x, needs)| (x.cast(), *needs)).collect();
    let narrow_upstream: Vec<Tensor<f32>> = trial.upstream.iter().map(Tensor::cast).collect();
    let point: Point<f64> = narrow_point.iter().map(|(x, needs)| (x.cast(), *needs)).collect();
    let upstream: Vec<Tensor<f64>> = narrow_upstream.iter().map(Tensor::cast).collect();

    let shapes =
        |run: &Run<f64>| -> Vec<_> { run.outputs.iter().map(|y| y.shape().clone()).collect() };
    let Ok(wide) = run(subject, &point, &upstream) else { return left_out };
    let mut moved_runs = Vec::new();
    for stream in 0..MOVES {
        let moved = |x: &Tensor<f64>, i: u64| {
            let signs = noise(x, 600 + 100 * stream + i);
            let unit = f64::from(f32::EPSILON) / 2.0;
            let factor = |k: usize| 1.0 + unit * signs.data()[k].signum();
            Tensor::from_flat_fn(x.shape(), |k| x.data()[k] * factor(k))
        };
        let point = point.iter().zip(0..).map(|((x, needs), i)| (moved(x, i), *needs)).collect();
        let upstream: Vec<_> = upstream.iter().zip(50..).map(|(u, j)| moved(u, j)).collect();
        match run(subject, &point, &upstream) {
            Ok(run) if run.state == wide.state => moved_runs.push(run),
            _ => return left_out,
        }
    }
    let narrow = match run(subject, &narrow_point, &narrow_upstream) {
        Ok(narrow) if narrow.state == wide.state => narrow,
        Ok(_) => return left_out,
        Err(error) => return Err(Broken::from_message(format!("refused in f32 alone: {error}"))),
    };
    let narrow = Run {
        outputs: narrow.outputs.iter().map(Tensor::cast).collect(),
        gradients: narrow.gradients.iter().map(|g| g.as_ref().map(Tensor::cast)).collect(),
        state: narrow.state,
    };
    if shapes(&narrow) != shapes(&wide) {
        return left_out;
    }

    for (j, wide_output) in wide.outputs.iter().enumerate() {
        let moved: Vec<_> = moved_runs.iter().map(|run| &run.outputs[j]).collect();
        let what = |entry_name: String| format!("f32: out{j}{entry_name}");
        compare(&mut tally, &narrow.outputs[j], wide_output, &moved, what)?;
    }
    for (i, wide_gradient) in wide.gradients.iter().enumerate() {
        let Some(wide_gradient) = wide_gradient else { continue };
        let moved: Vec<_> = moved_runs.iter().filter_map(|run| run.gradients[i].as_ref()).collect();
        let Some(narrow) = &narrow.gradients[i] else { continue };
        let what = |entry_name: String| format!("f32: the gradient of in{i}{entry_name}");
        compare(&mut tally, narrow, wide_gradient, &moved, what)?;
    }
    Ok(tally)
}

fn compare(
    tally: &mut Tally,
    narrow: &Tensor<f64>,
    wide: &Tensor<f64>,
    moved: &[&Tensor<f64>],
    what: impl Fn(String) -> String,
) -> Result<(), Broken> {
    let floor = f64::from(f32::EPSILON) * largest(wide) + f64::from(f32::MIN_POSITIVE);
    for (k, (&narrow, &wide)) in narrow.data().iter().zip(wide.data()).enumerate() {
        let change = |run: &&Tensor<f64>| (run.data()[k] - wide).abs();
        let sensitivity = moved.iter().map(change).fold(0.0, f64::max);
        let entry_name = || what(entry("", moved[0].shape(), k));
        tally.compare((narrow, wide), SLACK * (sensitivity + floor), entry_name)?;
    }
    Ok(())
}
