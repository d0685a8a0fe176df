//! One image over another.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::over;
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("over");
    let channels = select(&[1_usize, 2, 4][..]);
    let cases = channels.prop_flat_map(|channels| {
        let shape = (1..5_usize, 1..5_usize).prop_map(move |(h, w)| [h, w, channels]);
        shape.prop_flat_map(|shape| {
            [tensor(shape, number()), tensor(shape, number())]
                .prop_map(|images| Case::new(Over, images.map(Input::leaf)))
        })
    });
    let large = [3, 9].map(|by| Tensor::from_flat_fn([120, 90, 4], |k| motley(by * k)));
    entry.check(
        Check::from_cases("over", cases)
            .large(1, Just(Case::new(Over, large.map(Input::leaf))))
            .refuses(
                "over needs an image behind of shape [2, 3, 4], got shape [3, 2, 4]",
                Case::new(Over, [leaf([2, 3, 4], 0.5), leaf([3, 2, 4], 0.5)]),
            )
            .refuses(
                "over needs images of shape [.., C], C > 0, got shape [2, 0]",
                Case::new(Over, [leaf([2, 0], 0.5), leaf([2, 0], 0.5)]),
            ),
    );
    benchmark!(entry, "over", |s| [s.image, s.aliased], |x| over(x[0], x[1])?);
    entry
}

#[derive(Debug)]
struct Over;

impl Subject for Over {
    /// Two images.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(over(inputs[0], inputs[1])?.into())
    }
}
