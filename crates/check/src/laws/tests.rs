//! Every law turns red for the mistake it is there for.

use bokashi_core::{
    Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Tape, Tensor, TensorError, Var,
};
use proptest::strategy::{Just, Strategy};

use crate::strategy::{number, shape, tensor};
use crate::{Case, Check, Failure, Input, Law, Mutation, Outcome, Refusal, Subject, subject};

/// A mistake that an operation can have.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    Gradient,
    ReadsWhatItDidNotKeep,
    ForgetsTheTangent,
    BackwardForgetsTheTangent,
    NeedsBoth,
    Overwrites,
    Threshold,
    RemembersTheLastStep,
    CountsThreads,
    Cancels,
    TakesAnything,
    Panics,
}

/// `x y` for two inputs of one shape, with a mistake.
#[derive(Debug, Clone, Copy)]
struct Product(Fault);

impl<T: Scalar> Op<T> for Product {
    type Saved = Vec<T>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "product"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Vec<T>,
    ) -> Result<(), TensorError> {
        let (x, y) = (inputs.data(0), inputs.data(1));
        let (x_shape, y_shape) = (inputs.shape(0), inputs.shape(1));
        if x_shape != y_shape && self.0 != Fault::TakesAnything {
            assert!(self.0 != Fault::Panics, "shapes differ");
            return Err(TensorError::NotScalar { shape: y_shape.clone() });
        }
        if self.0 != Fault::RemembersTheLastStep || saved.len() != x.len() {
            saved.clear();
            saved.extend(y);
        }
        let out = outputs.push(x_shape);
        for (out, (&x, &y)) in out.iter_mut().zip(x.iter().zip(y)) {
            let million = T::from_f64(1e6);
            *out = match self.0 {
                Fault::ForgetsTheTangent => T::from_f64(x.to_f64()) * y,
                Fault::CountsThreads => x * y * T::from_f64(threads()),
                Fault::Cancels => (x * y + million) - million,
                _ => x * y,
            };
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        match self.0 {
            Fault::ReadsWhatItDidNotKeep => Keep::NOTHING,
            _ => Keep::NOTHING.input(0),
        }
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Vec<T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let upstream = kept.only_upstream();
        let both = gradients.needs(0) && gradients.needs(1);
        let factor = match self.0 {
            Fault::Gradient => T::from_f64(1.0 + 1e-5),
            Fault::NeedsBoth if !both => T::from_f64(0.5),
            Fault::CountsThreads => T::from_f64(threads()),
            _ => T::ONE,
        };
        let small = |g: T| self.0 == Fault::Threshold && g.abs() < T::from_f64(1e-9);
        if let Some(x_bar) = gradients.get(0) {
            let entry = |k: usize| {
                let y = match self.0 {
                    Fault::BackwardForgetsTheTangent => T::from_f64(saved[k].to_f64()),
                    _ => saved[k],
                };
                if small(upstream[k]) { T::ZERO } else { upstream[k] * y * factor }
            };
            if self.0 == Fault::Overwrites {
                let sum = x_bar.entries();
                sum.iter_mut().enumerate().for_each(|(k, sum)| *sum = entry(k));
            } else {
                x_bar.add_each(entry);
            }
        }
        if let Some(y_bar) = gradients.get(1) {
            let x = kept.input(0);
            let factor = if self.0 == Fault::CountsThreads { factor } else { T::ONE };
            y_bar.add_each(|k| upstream[k] * x[k] * factor);
        }
    }
}

fn threads() -> f64 {
    rayon::current_num_threads() as f64
}

impl Subject for Product {
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(tape.apply(*self, inputs)?.into())
    }
}

fn pairs() -> impl Strategy<Value = Vec<Input>> {
    let pair = |shape| (tensor(shape, number()), tensor([0], number()));
    shape().prop_flat_map(move |shape| {
        let (x, _) = pair(shape.clone());
        (x, tensor(shape, number())).prop_map(|(x, y)| vec![Input::leaf(x), Input::leaf(y)])
    })
}

fn check(fault: Fault) -> Result<crate::CheckReport, Box<Failure>> {
    let apart = [Input::leaf(Tensor::zeros([2])), Input::leaf(Tensor::zeros([3]))];
    let product = Product(fault);
    let message = "a backward pass without an upstream gradient needs a scalar, got shape [3]";
    Check::new("product", product, pairs()).refuses(message, Case::new(product, apart)).run()
}

#[test]
fn a_right_operation_keeps_every_law() {
    let report = check(Fault::None).unwrap_or_else(|failure| panic!("{failure}"));
    for law in Law::ALL {
        assert!(report.tally(law).compared > 0, "{law}");
    }
    assert!(report.tally(Law::Differences).worst < 1.0);
    assert!(report.tally(Law::Differences).share_left_out() < 0.02, "{report}");
}

#[test]
fn each_mistake_breaks_the_law_that_is_there_for_it() {
    for (fault, law) in [
        (Fault::Gradient, Law::Differences),
        (Fault::ReadsWhatItDidNotKeep, Law::Defined),
        (Fault::ForgetsTheTangent, Law::Adjoint),
        (Fault::BackwardForgetsTheTangent, Law::Curvature),
        (Fault::NeedsBoth, Law::Masks),
        (Fault::Overwrites, Law::Accumulation),
        (Fault::Threshold, Law::Linearity),
        (Fault::RemembersTheLastStep, Law::Recycling),
        (Fault::CountsThreads, Law::Threads),
        (Fault::Cancels, Law::Precision),
        (Fault::TakesAnything, Law::Refusals),
        (Fault::Panics, Law::Refusals),
    ] {
        let failure = check(fault).err().unwrap_or_else(|| panic!("{fault:?} was not seen"));
        assert_eq!(failure.law, law, "{fault:?}: {failure}");
    }
}

/// The gradient of the factor is 0, and moves by the rounding of the inputs all the same.
#[test]
fn a_gradient_that_cancels_is_as_rough_as_the_inputs() {
    subject!(Steps: |x| (x[0].slice(0, 1..9)? - x[0].slice(0, 0..8)?) * x[1]);
    let constant = (0.5..2.0).prop_map(|level| {
        vec![Input::leaf(Tensor::full([9], level)), Input::leaf(Tensor::scalar(0.3))]
    });
    let report = Check::new("steps", Steps, constant).run();
    let report = report.unwrap_or_else(|failure| panic!("{failure}"));
    assert_eq!(report.tally(Law::Curvature).left_out, 0, "{report}");
}

/// The gradient is left of terms that are a million times as large, and is as rough as these.
#[test]
fn a_gradient_that_is_left_of_large_terms_is_linear_to_their_rounding() {
    subject!(Rest: |x| x[0] * x[1] - x[0] * x[2]);
    let numbers = (0.5..2.0).prop_map(|level: f64| {
        let row = |start: f64| {
            Input::constant(Tensor::from_flat_fn([9], |k| 1e6 + start + (k as f64 + level).sin()))
        };
        vec![Input::leaf(Tensor::full([9], level)), row(0.7), row(0.0)]
    });
    let others = [Law::Precision, Law::Adjoint, Law::Accumulation];
    let check = others.into_iter().fold(Check::new("rest", Rest, numbers), Check::except);
    let report = check.run().unwrap_or_else(|failure| panic!("{failure}"));
    assert!(report.tally(Law::Linearity).compared > 0, "{report}");
}

#[test]
fn a_failure_is_shrunk_to_one_entry() {
    let failure = check(Fault::Gradient).expect_err("a mistake");
    let message = failure.to_string();
    assert!(failure.broken.what.starts_with("d out"), "{message}");
    assert!(failure.broken.what.contains("/ d in0"), "{message}");
    let numbers = failure.broken.numbers.expect("two numbers");
    assert!((numbers.got / numbers.expected - 1.0 - 1e-5).abs() < 1e-8, "{message}");
    // One entry of each input, simple numbers.
    assert_eq!(numbers.expected.abs(), 1.0, "{message}");
    for text in ["product breaks the law of differences", "got 1.00001, expected 1 +- "] {
        assert!(message.contains(text), "{message}");
    }
}

#[test]
fn what_an_operation_did_not_keep_is_named() {
    let failure = check(Fault::ReadsWhatItDidNotKeep).expect_err("a mistake");
    assert!(failure.to_string().contains("product did not keep its input 0"), "{failure}");
}

#[test]
fn too_many_points_left_out_are_a_failure() {
    // Each value a piece of its own.
    subject!(Rough: |x| Outcome::from(x[0].square()).with_state(x[0].value().data()[0].to_f64().to_bits()));
    let inputs = tensor([1], number()).prop_map(|x| vec![Input::leaf(x)]);
    let failure = Check::new("rough", Rough, inputs).run().expect_err("nothing was compared");
    assert_eq!(failure.law, Law::Differences);
    assert!(failure.to_string().contains("32 points left out and 0 compared"), "{failure}");
}

#[test]
fn numbers_that_are_not_finite_are_a_failure() {
    subject!(Logarithm: |x| x[0].ln());
    let inputs = Just(vec![Input::leaf(Tensor::zeros([1]))]);
    let failure = Check::new("logarithm", Logarithm, inputs).run().expect_err("ln 0");
    assert_eq!((failure.law, &*failure.broken.what), (Law::Defined, "out0 is not finite"));
}

#[test]
fn a_law_can_be_excepted_and_the_report_says_so() {
    let inputs = pairs();
    let check = Check::new("product", Product(Fault::Cancels), inputs).except(Law::Precision);
    let report = check.run().unwrap_or_else(|failure| panic!("{failure}"));
    assert!(report.to_string().ends_with("; not checked: precision"), "{report}");
}

fn kills(check: Check) -> crate::Kills {
    check.kills().unwrap_or_else(|failure| panic!("{failure}"))
}

#[test]
fn every_wrong_adjoint_is_caught() {
    let kills = kills(Check::new("product", Product(Fault::None), pairs()));
    assert_eq!(kills.tried, 2 * Mutation::ALL.len());
    assert_eq!(kills.to_string(), "product: 10 of 10 wrong adjoints caught (100 %)");
}

#[test]
fn without_the_laws_that_see_them_wrong_adjoints_live() {
    let blind = Check::new("product", Product(Fault::None), pairs())
        .except(Law::Differences)
        .except(Law::Adjoint)
        .except(Law::Curvature);
    let kills = kills(blind);
    // A gradient that overwrites breaks the law of accumulation.
    assert_eq!((kills.tried, kills.rate()), (10, Some(0.2)));
    let text = "product: 2 of 10 wrong adjoints caught (20 %); not caught: Sign for in0";
    assert!(kills.to_string().starts_with(text), "{kills}");
}

#[test]
fn what_changes_nothing_is_no_wrong_adjoint() {
    // One entry that reads the same backwards: nothing is transposed.
    let inputs = Just(vec![Input::leaf(Tensor::full([1], 0.5)); 2]);
    assert_eq!(kills(Check::new("product", Product(Fault::None), inputs)).tried, 8);
}

#[test]
fn nothing_is_said_of_an_operation_that_is_wrong_itself() {
    let check = Check::new("product", Product(Fault::Gradient), pairs());
    assert_eq!(check.kills().expect_err("a mistake").law, Law::Differences);
    let nothing = Check::new("product", Product(Fault::None), pairs()).cases(0);
    assert_eq!(nothing.run().expect_err("no case").law, Law::Defined);
}
