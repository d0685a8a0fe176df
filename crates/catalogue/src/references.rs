//! Images beside references, which losses compare.

use bokashi_check::strategy::tensor;
use bokashi_check::{Case, Check, Input, Outcome, Subject, sides};
use bokashi_core::{Mask, Scalar, Tensor, Var};
use proptest::prelude::*;

pub(crate) type Inputs = BoxedStrategy<Vec<Input>>;

/// Two leaves of one shape.
pub(crate) fn pair(shape: &'static [usize], entries: BoxedStrategy<f64>) -> Inputs {
    let two = (tensor(shape, entries.clone()), tensor(shape, entries));
    two.prop_map(|(x, y)| vec![Input::leaf(x), Input::leaf(y)]).boxed()
}

/// Leaves of these shapes that are worked on in several pieces.
pub(crate) fn large(shapes: &[&[usize]]) -> Inputs {
    let leaf = |(at, shape): (usize, &&[usize])| {
        let entry = |k: usize| 0.2 + ((k * 7919 + at * 389 + 13) % 1009) as f64 / 1009.0;
        Input::leaf(Tensor::from_flat_fn(*shape, entry))
    };
    Just(shapes.iter().enumerate().map(leaf).collect()).boxed()
}

/// The laws for a subject, on its inputs and on large ones.
pub(crate) fn laws(
    name: &str,
    subject: impl Subject + Copy,
    inputs: Inputs,
    large: Inputs,
) -> Check {
    let case = move |inputs: Vec<Input>| Case::new(subject, inputs);
    Check::new(name, subject, inputs).large(1, large.prop_map(case))
}

/// An error with kinks where `difference` has one of these values.
pub(crate) fn kinked<'t, T: Scalar>(
    error: Var<'t, T>,
    of: Var<'t, T>,
    kinks: &[f64],
) -> Outcome<'t, T> {
    Outcome::from(error).with_state(sides(of, kinks))
}

/// A mask that shows two of three entries.
pub(crate) fn two_of_three(shape: &[usize]) -> Mask {
    Mask::from_flat_fn(shape, |k| k % 3 > 0)
}

pub(crate) const SMALL: &[usize] = &[3, 2, 2];

pub(crate) const MANY: &[usize] = &[60, 61, 5];

pub(crate) const ROWS: &[usize] = &[60, 61];
