use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Tape, Tensor, TensorError};

/// `[x, 2 x]`; keeps its input only if told to, and reads it in any case.
struct Doubles {
    keeps_input: bool,
    refuses: bool,
}

const HONEST: Doubles = Doubles { keeps_input: true, refuses: false };

impl Op<f64> for Doubles {
    type Saved = Vec<f64>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "doubles"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, f64>,
        outputs: &mut Outputs<'_, f64>,
        saved: &mut Vec<f64>,
    ) -> Result<(), TensorError> {
        saved.clear();
        saved.extend(inputs.data(0));
        let shape = inputs.shape(0);
        let [once, twice] = outputs.push_all([shape.clone(), shape.clone()]);
        for (k, &x) in inputs.data(0).iter().enumerate() {
            (once[k], twice[k]) = (x, 2.0 * x);
        }
        if self.refuses {
            return Err(TensorError::NotScalar { shape: shape.clone() });
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, f64>) -> Keep {
        if self.keeps_input { Keep::NOTHING.input(0) } else { Keep::NOTHING }
    }

    fn backward(
        &self,
        kept: &Kept<'_, f64>,
        saved: &mut Vec<f64>,
        gradients: &mut Accumulators<'_, f64>,
    ) {
        assert_eq!(kept.input(0), saved);
        let Some(x_bar) = gradients.get(0) else { return };
        for (j, factor) in [(0, 1.0), (1, 2.0)] {
            if let Some(y_bar) = kept.upstream(j) {
                x_bar.add_zipped([y_bar], |[y_bar]| factor * y_bar);
            }
        }
    }

    fn saved_bytes(&self, saved: &Vec<f64>) -> usize {
        std::mem::size_of_val(&saved[..])
    }
}

#[test]
fn an_output_that_nothing_uses_has_no_upstream_gradient() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::full([3], 1.5));
    let outputs = tape.record(HONEST, &[x]).unwrap();
    let (once, twice) = (outputs[0], outputs[1]);
    for (loss, expected) in [(once, 1.0), (twice, 2.0), (once + twice, 3.0)] {
        let gradients = loss.sum().backward().unwrap();
        assert_eq!(gradients.get(x), Some(&Tensor::full([3], expected)));
    }
    let left_out = tape.take_report().left_out.into_iter();
    let left_out = left_out.filter(|of| of.name == "doubles");
    let left_out: Vec<_> = left_out.map(|of| (of.reason.into_owned(), of.count)).collect();
    let unused = [0, 1].map(|j| (format!("gradient of output {j}: nothing depends on it"), 1));
    assert_eq!(left_out, unused);
}

#[test]
#[should_panic(expected = "doubles did not keep its input 0")]
fn what_was_not_kept_cannot_be_read() {
    let tape = Tape::new();
    let op = Doubles { keeps_input: false, refuses: false };
    let outputs = tape.record(op, &[tape.leaf_scalar(1.0)]).unwrap();
    let _ = outputs[0].backward();
}

#[test]
#[should_panic(expected = "`apply` is for operations of one output")]
fn several_outputs_need_record() {
    let tape = Tape::new();
    let _ = tape.apply(HONEST, &[tape.leaf_scalar(1.0)]);
}

#[test]
fn a_refusal_leaves_the_tape_as_it_was() {
    let run = |refusals: usize| {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn([3], |k| k as f64));
        let y = x.square();
        for _ in 0..refusals {
            assert!(tape.record(Doubles { refuses: true, ..HONEST }, &[y]).is_err());
            assert_eq!(tape.len(), 2);
        }
        let z = (y.exp() * x).sum();
        (z.value(), z.backward().unwrap().get_or_zeros(x), tape.take_report())
    };
    assert_eq!(run(0), run(2));
}

#[test]
fn what_is_saved_is_counted_and_shown() {
    let tape = Tape::new();
    let x = tape.constant(&Tensor::full([3], 1.0));
    let (_, seen) = tape.record_with(HONEST, &[x], |saved| saved.clone()).unwrap();
    assert_eq!(seen, [1.0; 3]);
    // Two outputs and what was saved, three numbers each.
    assert_eq!(tape.take_report().operations[0].bytes, 9 * 8);
}
