//! Laws of calls that a panic ended.

use std::panic::{AssertUnwindSafe, catch_unwind};

use bokashi_core::{
    Accumulators, Inputs, Keep, Kept, Op, Outputs, Tape, TapeReport, Tensor, TensorError, Var,
};

/// Where an operation breaks off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum At {
    Forward,
    Look,
    Keeps,
    SavedBytes,
    Backward,
    /// It passes an input on that it does not have.
    Passing,
    /// It renames an input that it does not have.
    Renaming,
    /// It renames its input to a shape of more entries.
    Reshaping,
    /// It has more outputs than its caller takes.
    Applying,
}

const ALL: [At; 9] = [
    At::Forward,
    At::Look,
    At::Keeps,
    At::SavedBytes,
    At::Backward,
    At::Passing,
    At::Renaming,
    At::Reshaping,
    At::Applying,
];

/// `[x, 2 x, x]`, of which the first and the last are `x` itself.
struct Breaks(At);

impl Breaks {
    fn break_at(&self, at: At) {
        assert!(self.0 != at, "broken off");
    }
}

impl Op<f64> for Breaks {
    type Saved = Vec<f64>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "breaks"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, f64>,
        outputs: &mut Outputs<'_, f64>,
        saved: &mut Vec<f64>,
    ) -> Result<(), TensorError> {
        if self.0 == At::Passing {
            outputs.pass(1, "a mistake");
            return Ok(());
        }
        saved.push(7.0);
        let shape = inputs.shape(0);
        outputs.push_renamed(shape.clone(), 0);
        outputs.push(shape).fill(5.0);
        match self.0 {
            At::Renaming => outputs.push_renamed(shape.clone(), 1),
            At::Reshaping => outputs.push_renamed([shape.size() + 1], 0),
            _ => outputs.push_renamed(shape.clone(), 0),
        }
        self.break_at(At::Forward);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, f64>) -> Keep {
        self.break_at(At::Keeps);
        Keep::NOTHING
    }

    fn backward(
        &self,
        _kept: &Kept<'_, f64>,
        saved: &mut Vec<f64>,
        gradients: &mut Accumulators<'_, f64>,
    ) {
        saved.clear();
        if let Some(x_bar) = gradients.get(0) {
            x_bar.add_each(|_| 1e3);
        }
        self.break_at(At::Backward);
    }

    fn saved_bytes(&self, _saved: &Vec<f64>) -> usize {
        self.break_at(At::SavedBytes);
        0
    }
}

/// Runs an operation on `x` that breaks off at `at`; `false` where nothing broke.
fn breaks_off(tape: &Tape<f64>, x: Var<'_, f64>, at: At) -> bool {
    let broken = catch_unwind(AssertUnwindSafe(|| {
        if at == At::Applying {
            let _ = tape.apply(Breaks(at), &[x]);
            return;
        }
        let look = |_: &Vec<f64>| assert!(at != At::Look, "broken off");
        let (outputs, ()) = tape.record_with(Breaks(at), &[x], look).unwrap();
        let _ = (outputs[0] * outputs[1] + outputs[2].exp()).sum().backward();
    }));
    broken.is_err()
}

/// What one step shows: loss, gradients, values on the tape, and the report.
type Shown = (Vec<Tensor<f64>>, String, TapeReport);

/// The rest of a step on `x`, by operations of all kinds.
fn finish(tape: &Tape<f64>, x: Var<'_, f64>) -> Shown {
    let y = x.exp();
    let renamed = y.reshape([6]).unwrap();
    let saved = tape.record_with(Breaks(At::Backward), &[x], Vec::clone).unwrap().1;
    let pieces = x.slice(0, 0..1).unwrap().sin().sum() + renamed.mean().unwrap();
    let loss = (y * x + x.square()).sum() + pieces;
    let gradients = loss.backward_to(&[x, y, renamed]).unwrap();
    let mut all = vec![loss.value(), Tensor::new([saved.len()], saved).unwrap()];
    all.extend([x, y, renamed].map(|variable| gradients.get_or_zeros(variable)));
    all.push(loss.backward().unwrap().get_or_zeros(x));
    // In the order of names: which operation the tape met first is not of this step alone.
    let mut report = tape.take_report();
    report.operations.sort_by_key(|of| of.name);
    (all, format!("{tape:?}"), report)
}

fn start(tape: &Tape<f64>) -> Var<'_, f64> {
    tape.leaf(&Tensor::from_flat_fn([2, 3], |k| 0.3 * k as f64 - 0.7))
}

#[test]
fn what_a_panic_ended_leaves_nothing_to_the_rest_of_the_step() {
    for at in ALL {
        // A backward pass breaks off after what it starts from was recorded.
        if at == At::Backward {
            continue;
        }
        let [tape, untouched] = [Tape::new(), Tape::new()];
        let [x, same] = [start(&tape), start(&untouched)];
        for _ in 0..2 {
            assert!(breaks_off(&tape, x, at), "{at:?}");
            assert_eq!(tape.len(), 1, "{at:?}");
        }
        assert_eq!(finish(&tape, x), finish(&untouched, same), "{at:?}");
    }
}

#[test]
fn what_a_panic_ended_leaves_nothing_to_the_next_step() {
    for at in ALL {
        let [mut tape, mut untouched] = [Tape::new(), Tape::new()];
        for _ in 0..3 {
            let x = start(&tape);
            assert!(breaks_off(&tape, x, at), "{at:?}");
            tape.reset();
            untouched.reset();
            let _ = tape.take_report();
            assert_eq!(
                finish(&tape, start(&tape)),
                finish(&untouched, start(&untouched)),
                "{at:?}"
            );
            tape.reset();
            untouched = Tape::new();
        }
    }
}

#[test]
fn a_backward_pass_that_broke_off_leaves_nothing_to_the_next_pass() {
    let pass = |breaks: bool| {
        let tape = Tape::new();
        let x = start(&tape);
        let other = tape.record(Breaks(At::Backward), &[x.sin()]).unwrap()[1];
        let loss = (x.exp() * x).sum();
        let upstream = Tensor::full([2, 3], 0.5);
        let first = loss.backward().unwrap().get_or_zeros(x);
        if breaks {
            let both =
                || drop(tape.vjp_to(&[(other, &upstream), (loss, &Tensor::scalar(2.0))], &[x]));
            assert!(catch_unwind(AssertUnwindSafe(both)).is_err());
        }
        let _ = tape.take_report();
        let second = loss.backward().unwrap().get_or_zeros(x);
        assert_eq!(first, second);
        let to_loss = loss.backward_to(&[loss]).unwrap().get_or_zeros(x);
        (second, to_loss, tape.take_report(), tape.len())
    };
    assert_eq!(pass(true), pass(false));
}
