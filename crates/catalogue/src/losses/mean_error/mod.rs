//! Mean errors by every penalty.

mod extremes;

use bokashi_check::strategy::{around, number, tensor};
use bokashi_check::{Applied, Case, Input, Subject};
use bokashi_core::{Scalar, Tape, Var};
use bokashi_fit::{Penalty, mean_error};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::references::{MANY, SMALL, kinked, large, laws, pair};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("mean_error").with_extremes(extremes::EXTREMES);
    mean_errors(&mut entry);
    relative_error_of_what_is_fixed(&mut entry);
    benchmark!(entry, "mean_absolute_error", |s| [s.image, s.aliased], |x| {
        mean_error(x[0], x[1], Penalty::Absolute)?
    });
    benchmark!(entry, "mean_huber_error", |s| [s.image, s.aliased], |x| {
        mean_error(x[0], x[1], Penalty::Huber { delta: 0.5 })?
    });
    benchmark!(entry, "mean_charbonnier_error", |s| [s.image, s.aliased], |x| {
        mean_error(x[0], x[1], Penalty::Charbonnier { scale: 0.5 })?
    });
    benchmark!(entry, "mean_relative_error", |s| [s.image, s.aliased], |x| {
        mean_error(x[0], x[1], Penalty::Relative { epsilon: 0.01 })?
    });
    entry
}

fn mean_errors(entry: &mut Entry) {
    let values = || pair(SMALL, around(&[0.5], -2.0..2.0));
    let by = |penalty, bad: [Input; 2]| Case::new(MeanError(penalty), bad);
    let of = |penalty| by(penalty, [leaf([2, 3], 1.0), leaf([2, 3], 1.0)]);
    let name = |name| format!("mean_{name}_error needs");
    let shapes = "an image and a reference of one shape, got shapes [2, 3] and [3, 2]";
    for (kind, penalty) in [
        ("squared", Penalty::Squared),
        ("absolute", Penalty::Absolute),
        ("huber", Penalty::Huber { delta: 0.5 }),
        ("charbonnier", Penalty::Charbonnier { scale: 0.5 }),
    ] {
        let name = name(kind);
        entry.check(
            laws(kind, MeanError(penalty), values(), large(&[MANY; 2]))
                .refuses(
                    format!("{name} {shapes}"),
                    by(penalty, [leaf([2, 3], 1.0), leaf([3, 2], 1.0)]),
                )
                .refuses(
                    format!("{name} at least one entry, got shape [0]"),
                    by(penalty, [leaf([0], 1.0), leaf([0], 1.0)]),
                ),
        );
    }
    let check = laws("constants", MeanError(Penalty::Squared), values(), large(&[MANY; 2]));
    let bad = [0.0, -1.0, f64::NAN, f64::INFINITY].into_iter();
    entry.check(bad.fold(check, |check, bad| {
        let rule = format!("above 0 in the precision of the fit, got {bad}");
        let (huber, relative) = (name("huber"), name("relative"));
        check
            .refuses(format!("{huber} a finite delta {rule}"), of(Penalty::Huber { delta: bad }))
            .refuses(
                format!("{relative} a finite epsilon {rule}"),
                of(Penalty::Relative { epsilon: bad }),
            )
    }));
}

/// A mean error by a penalty.
#[derive(Debug, Clone, Copy)]
struct MeanError(Penalty);

impl Subject for MeanError {
    /// An image and a reference.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let error = mean_error(inputs[0], inputs[1], self.0)?;
        let kinks: &[f64] = match self.0 {
            Penalty::Absolute => &[0.0],
            Penalty::Huber { .. } => &[-0.5, 0.0, 0.5],
            _ => &[],
        };
        Ok(kinked(error, inputs[0] - inputs[1], kinks))
    }
}

/// The relative error takes its denominator as a constant: here it is one.
fn relative_error_of_what_is_fixed(entry: &mut Entry) {
    let relative = MeanError(Penalty::Relative { epsilon: 0.01 });
    let values = (tensor(SMALL, number()), tensor(SMALL, number()));
    let values = values.prop_map(|(x, y)| vec![Input::constant(x), Input::leaf(y)]).boxed();
    let many = large(&[MANY; 2]).prop_map(|mut inputs| {
        inputs[0].differentiable = false;
        inputs
    });
    entry.check(laws("relative", relative, values, many.boxed()));
}
