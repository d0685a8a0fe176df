use std::sync::Arc;

use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, Tape, Tensor, TensorError, Var};

/// `y = a x`, the identity where `a` is 1; shares a list with the caller.
struct Scales {
    a: f64,
    list: Arc<[u32]>,
}

impl Op<f64> for Scales {
    type Saved = Vec<f64>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "scales"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, f64>,
        outputs: &mut Outputs<'_, f64>,
        saved: &mut Vec<f64>,
    ) -> Result<(), TensorError> {
        saved.resize(100, self.a);
        if self.a == 1.0 {
            outputs.pass(0, "a is 1");
            return Ok(());
        }
        let y = outputs.push(inputs.shape(0));
        y.iter_mut().zip(inputs.data(0)).for_each(|(y, x)| *y = self.a * x);
        if self.list.is_empty() {
            outputs.pass(0, "a mistake");
        }
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, f64>,
        _saved: &mut Vec<f64>,
        gradients: &mut Accumulators<'_, f64>,
    ) {
        let Some(x_bar) = gradients.get(0) else { return };
        x_bar.add_zipped([kept.only_upstream()], |[y_bar]| self.a * y_bar);
    }
}

fn scales(a: f64, list: &Arc<[u32]>) -> Scales {
    Scales { a, list: Arc::clone(list) }
}

fn left_out(tape: &Tape<f64>) -> Vec<(&'static str, String, u64)> {
    let entries = tape.take_report().left_out.into_iter();
    entries.map(|entry| (entry.name, entry.reason.into_owned(), entry.count)).collect()
}

/// Whether both are the same value of a tape, which has a number.
fn is_same(x: Var<'_, f64>, y: Var<'_, f64>) -> bool {
    format!("{x:?}") == format!("{y:?}")
}

#[test]
fn what_needs_no_gradient_leaves_values_but_no_node() {
    let tape = Tape::new();
    let x = tape.constant(&Tensor::full([3], 2.0));
    let list = Arc::from([7]);
    let y = tape.apply(scales(4.0, &list), &[x]).unwrap().exp();
    assert_eq!((y.value()[[2]], tape.len()), (8.0_f64.exp(), 3));
    assert_eq!(format!("{tape:?}"), "Tape { values: 3, nodes: [] }");
    assert_eq!(Arc::strong_count(&list), 1, "the operation is let go at once");
    let reason = "recording: no input needs a gradient";
    let expected = ["scales", "exp"].map(|name| (name, reason.to_owned(), 1));
    assert_eq!(left_out(&tape), expected);
    assert!(left_out(&tape).is_empty(), "counted from zero again");
}

#[test]
fn values_with_and_without_a_gradient_are_the_same_bits() {
    let of = |is_leaf: bool| {
        let tape = Tape::new();
        let x = Tensor::from_flat_fn([5, 2], |k| 0.3 * k as f64 - 1.0);
        let x = if is_leaf { tape.leaf(&x) } else { tape.constant(&x) };
        let y = (x.sin() * x + 1.0).sum_axis(0).unwrap().mean().unwrap();
        (format!("{tape:?}"), y.value())
    };
    let ((nodes, value), (none, frozen)) = (of(true), of(false));
    let expected = r#"Tape { values: 6, nodes: ["sin", "mul", "affine", "sum", "mean"] }"#;
    assert_eq!((nodes.as_str(), none.as_str()), (expected, "Tape { values: 6, nodes: [] }"));
    assert_eq!(value, frozen);
}

#[test]
fn memory_of_what_was_saved_waits_for_the_next_step_whether_recorded_or_not() {
    let mut tape = Tape::new();
    let list = Arc::from([7]);
    for k in 0..6 {
        // Frozen, recorded, and passed on, by turns.
        let (frozen, a) = (k % 3 == 0, if k % 3 == 1 { 1.0 } else { 2.0 });
        let x = Tensor::full([1], 1.0);
        let x = if frozen { tape.constant(&x) } else { tape.leaf(&x) };
        let saved = |saved: &Vec<f64>| (saved.as_ptr(), saved.len());
        let (_, first) = tape.record_with(scales(a, &list), &[x], saved).unwrap();
        tape.reset();
        let x = tape.leaf(&Tensor::full([1], 1.0));
        let (_, second) = tape.record_with(scales(3.0, &list), &[x], saved).unwrap();
        assert_eq!(first, second);
        tape.reset();
    }
}

#[test]
fn an_input_that_is_passed_on_is_the_output_itself() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::full([3], 2.0));
    let list = Arc::from([7]);
    let y = tape.apply(scales(1.0, &list), &[x]).unwrap();
    assert!(is_same(y, x));
    assert_eq!(Arc::strong_count(&list), 1);
    assert_eq!(format!("{tape:?}"), "Tape { values: 1, nodes: [] }");
    let z = tape.record(scales(1.0, &list), &[x.square()]).unwrap()[0];
    let gradients = z.sum().backward().unwrap();
    assert_eq!(gradients.get(x), Some(&Tensor::full([3], 4.0)));
    assert_eq!(left_out(&tape), [("scales", "a is 1".to_owned(), 2)]);
}

#[test]
#[should_panic(expected = "scales passes an input on and has outputs as well")]
fn who_passes_an_input_on_has_no_other_output() {
    let tape = Tape::new();
    let _ = tape.apply(scales(2.0, &Arc::from([])), &[tape.leaf_scalar(1.0)]);
}

#[test]
fn operations_that_are_the_identity_give_their_input_back() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::from_flat_fn([2, 3], |k| k as f64));
    let same = [
        x.reshape([2, 3]).unwrap(),
        x.permute(&[0, 1]).unwrap(),
        x.slice(1, 0..3).unwrap(),
        Var::concat(&[x], 0).unwrap(),
        x.powi(1),
    ];
    assert!(same.iter().all(|&y| is_same(y, x)) && tape.len() == 1);
    let names: Vec<_> = left_out(&tape).into_iter().map(|(name, ..)| name).collect();
    assert_eq!(names, ["reshape", "permute", "slice", "concat", "powi"]);
    // What is wrong is refused all the same.
    assert!(x.slice(2, 0..3).is_err() && Var::concat(&[x], 2).is_err());
}
