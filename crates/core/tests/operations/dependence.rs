use bokashi_core::{
    Accumulators, Dependence, Inputs, Kept, Op, Outputs, Tape, Tensor, TensorError,
};

/// `image`, whatever `share` is, as an operation gives it where nothing is to be done.
struct Blends;

impl Op<f64> for Blends {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "blends"
    }
    fn forward(
        &self,
        _inputs: &Inputs<'_, f64>,
        outputs: &mut Outputs<'_, f64>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        outputs.pass(0, "no pixel is blended");
        Ok(())
    }
    fn backward(&self, _: &Kept<'_, f64>, _saved: &mut (), _: &mut Accumulators<'_, f64>) {}
}

fn none(end: Option<&'static str>, is_detached: bool) -> Dependence {
    Dependence::None { end, is_detached }
}

#[test]
fn a_way_is_what_was_recorded_even_where_the_gradient_is_zero() {
    let tape = Tape::new();
    let [x, y] = [2.0, 3.0].map(|number| tape.leaf_scalar(number));
    let loss = (x.sin() * 0.0).exp() + y;
    for variable in [x, y, loss] {
        assert_eq!(loss.dependence_on(variable), Ok(Dependence::Recorded));
    }
    assert_eq!(x.dependence_on(loss), Ok(none(None, false)));
    assert_eq!(y.dependence_on(x), Ok(none(Some("add"), false)));
    assert!(loss.dependence_on(Tape::new().leaf_scalar(1.0)).is_err());
}

#[test]
fn a_way_that_ends_is_named_by_its_last_operation() {
    let tape = Tape::new();
    let [x, y] = [2.0, 3.0].map(|number| tape.leaf_scalar(number));
    let loss = y.square();
    assert_eq!(loss.dependence_on(x), Ok(none(None, false)));
    let (side, _) = (x.exp().sin(), y + 1.0);
    assert_eq!(loss.dependence_on(x), Ok(none(Some("sin"), false)));
    let loss = loss + side.detach();
    assert_eq!(loss.dependence_on(x), Ok(none(Some("sin"), true)));
    // What is computed beside it, to be shown perhaps, does not hide it.
    let _ = x.tanh();
    assert_eq!(loss.dependence_on(x), Ok(none(Some("sin"), true)));
    let raw = tape.leaf_scalar(1.0);
    let loss = loss + raw.detach();
    assert_eq!(loss.dependence_on(raw), Ok(none(None, true)));
    // The only way counts: another one that ends does not matter.
    let loss = loss + raw;
    assert_eq!(loss.dependence_on(raw), Ok(Dependence::Recorded));
}

#[test]
fn an_operation_that_was_the_identity_in_this_step_is_a_way_that_rests() {
    let mut tape = Tape::new();
    for _ in 0..2 {
        let [image, share] = [2.0, 3.0].map(|number| tape.leaf_scalar(number));
        let loss = tape.apply(Blends, &[image, share.exp()]).unwrap().square();
        assert_eq!(loss.dependence_on(image), Ok(Dependence::Recorded));
        assert_eq!(loss.dependence_on(share), Ok(Dependence::Idle { operation: "blends" }));
        // Its mark goes with the step.
        tape.reset();
        let [image, share] = [2.0, 3.0].map(|number| tape.leaf_scalar(number));
        let (loss, _) = (image.square(), share.exp());
        assert_eq!(loss.dependence_on(share), Ok(none(Some("exp"), false)));
        tape.reset();
    }
}

#[test]
fn inputs_are_those_of_the_operation_that_computed_the_value() {
    let tape = Tape::new();
    let (x, frozen) = (tape.leaf_scalar(2.0), tape.constant_scalar(1.0));
    let y = frozen * x;
    let inputs = y.inputs();
    assert!(inputs.len() == 2 && inputs[0].is(frozen) && inputs[1].is(x) && !y.is(x));
    assert!(x.inputs().is_empty() && frozen.exp().inputs().is_empty());
    assert!(!x.is(Tape::new().leaf_scalar(2.0)));
}

#[test]
fn the_first_value_that_is_not_finite_is_found_wherever_it_stands() {
    let tape = Tape::new();
    let x = tape.leaf(&Tensor::new([2], vec![1.0, -1.0]).unwrap());
    assert!(tape.first_not_finite().is_none());
    let logarithm = (x * 2.0).ln();
    let _ = (logarithm.exp() / 0.0).sum();
    assert!(tape.first_not_finite().unwrap().is(logarithm));
    let tape = Tape::new();
    let frozen = tape.constant_full([3], f64::INFINITY);
    assert!((frozen.tape().first_not_finite().unwrap()).is(frozen));
}

#[test]
fn the_first_gradient_that_is_not_finite_is_laid_to_the_operation_that_made_it() {
    let tape = Tape::new();
    let [x, y] = [0.0, 3.0].map(|number| tape.leaf_scalar(number));
    let root = x.sqrt();
    // `x` collects a finite gradient of the sine, recorded later, and an infinite one.
    let loss = (root + y).exp() + x.sin();
    assert!(loss.first_gradient_not_finite().unwrap().unwrap().is(root));
    assert!(y.square().first_gradient_not_finite().unwrap().is_none());
    // An input of the sum lies below the other one.
    let root = (x * 0.0).sqrt();
    assert!((x + root).first_gradient_not_finite().unwrap().unwrap().is(root));
    // Each share is finite.
    let (left, right) = (y * 1e308, y * 1e308);
    assert!((left + right).first_gradient_not_finite().unwrap().unwrap().is(right));
    assert!(tape.constant_full([2], 1.0).first_gradient_not_finite().is_err());
}
