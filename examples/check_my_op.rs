//! Are the gradients of an operation of one's own right, also where it is hard?
//!
//! The length of each row of `x: [N, D]` is checked against every law of `bokashi-check`: difference
//! quotients, the adjoint identity, masks, accumulation, threads, precision, wrong input. Then the
//! same operation with a mistake in it.

use bokashi::core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Tensor, TensorError};
use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Scalar, Subject, Tape, Var, sides};
use proptest::strategy::Strategy;

/// `y_k = |x_k|_2` per row of `x: [N, D]`, shape `[N]`; `x_bar_k += y_bar_k x_k / y_k`, and 0 where
/// the row is 0.
#[derive(Debug, Clone, Copy)]
struct RowNorm {
    /// Forgets to divide by the norm.
    is_wrong: bool,
}

impl<T: Scalar> Op<T> for RowNorm {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "row norm"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        (): &mut (),
    ) -> Result<(), TensorError> {
        let &[rows, columns] = &inputs.shape(0)[..] else {
            let (operation, shape) = ("row norm", inputs.shape(0).clone());
            return Err(TensorError::Shape { operation, rule: "a matrix".into(), shape });
        };
        let norms = outputs.push([rows]);
        for (norm, row) in norms.iter_mut().zip(inputs.data(0).chunks(columns.max(1))) {
            *norm = row.iter().map(|&x| x * x).sum::<T>().sqrt();
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).output(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, (): &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let (x, norms, upstream) = (kept.input(0), kept.output(0), kept.only_upstream());
        let columns = kept.input_shape(0)[1];
        x_bar.add_each(|k| {
            let row = k / columns;
            match norms[row] {
                norm if norm == T::ZERO => T::ZERO,
                _ if self.is_wrong => upstream[row] * x[k],
                norm => upstream[row] * x[k] / norm,
            }
        });
    }
}

impl Subject for RowNorm {
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let norms = tape.apply(*self, inputs)?;
        // A norm has a kink at 0.
        Ok(Outcome::from(norms).with_state(sides(norms, &[0.0])))
    }
}

fn main() {
    let inputs = || {
        let rows = (1..5_usize, 1..4_usize).prop_flat_map(|(n, d)| tensor([n, d], number()));
        rows.prop_map(|x| vec![Input::leaf(x)])
    };
    let vector = [Input::leaf(Tensor::full([3], 1.0))];
    let right = RowNorm { is_wrong: false };
    let check = Check::new("row norm", right, inputs())
        .refuses("row norm needs a matrix, got shape [3]", Case::new(right, vector));
    check.assert();
    println!("{}", check.kills().expect("no law is broken"));

    let wrong = Check::new("a wrong row norm", RowNorm { is_wrong: true }, inputs());
    match wrong.run() {
        Err(failure) => println!("\n{failure}"),
        Ok(report) => panic!("a mistake was not seen: {report}"),
    }
}
