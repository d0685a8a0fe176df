//! Mean errors by every penalty.

use bokashi_check::strategy::{around, number, tensor};
use bokashi_check::{Case, Input, subject};
use bokashi_fit::{Penalty, mean_error};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::leaf;
use crate::references::{MANY, SMALL, kinked, large, laws, pair};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("mean_error");
    mean_errors(&mut entry);
    relative_error_of_what_is_fixed(&mut entry);
    entry
}

fn mean_errors(entry: &mut Entry) {
    subject!(Squared: |x| mean_error(x[0], x[1], Penalty::Squared)?);
    subject!(Absolute: |x| {
        kinked(mean_error(x[0], x[1], Penalty::Absolute)?, x[0] - x[1], &[0.0])
    });
    subject!(Huber: |x| {
        let penalty = Penalty::Huber { delta: 0.5 };
        kinked(mean_error(x[0], x[1], penalty)?, x[0] - x[1], &[-0.5, 0.0, 0.5])
    });
    let values = || pair(SMALL, around(&[0.5], -2.0..2.0));
    let of = |bad: Vec<Input>| Case::new(Squared, bad);
    entry.check(
        laws("mean squared error", Squared, values(), large(&[MANY; 2]))
            .refuses("shapes that differ", of(vec![leaf([2], 1.0), leaf([3], 1.0)]))
            .refuses("no entries", of(vec![leaf([0], 1.0), leaf([0], 1.0)])),
    );
    entry.check(laws("mean absolute error", Absolute, values(), large(&[MANY; 2])));
    entry.check(laws("mean Huber error", Huber, values(), large(&[MANY; 2])));
    subject!(Charbonnier: |x| mean_error(x[0], x[1], Penalty::Charbonnier { scale: 0.5 })?);
    entry.check(laws("mean Charbonnier error", Charbonnier, values(), large(&[MANY; 2])));
}

/// The relative error takes its denominator as a constant: here it is one.
fn relative_error_of_what_is_fixed(entry: &mut Entry) {
    subject!(Relative: |x| mean_error(x[0], x[1], Penalty::Relative { epsilon: 0.01 })?);
    let values = (tensor(SMALL, number()), tensor(SMALL, number()));
    let values = values.prop_map(|(x, y)| vec![Input::constant(x), Input::leaf(y)]).boxed();
    let many = large(&[MANY; 2]).prop_map(|mut inputs| {
        inputs[0].differentiable = false;
        inputs
    });
    entry.check(laws("mean relative error", Relative, values, many.boxed()));
}
