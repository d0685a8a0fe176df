//! Tone curves: `srgb_encode`, `srgb_decode` and `exposure`.

mod extremes;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{exposure, srgb_decode, srgb_encode};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, wide};
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("tone").with_extremes(extremes::EXTREMES);
    for tone in [Tone::Encode, Tone::Decode] {
        let numbers = prop_oneof![4 => -0.2..1.5_f64, 1 => -0.004..0.004_f64, 1 => 0.03..0.05_f64];
        let cases = vec(numbers, 6).prop_map(move |entries| {
            Case::new(tone, [Input::leaf(Tensor::new([2, 3], entries).unwrap())])
        });
        let many = Tensor::from_flat_fn([90_000], |k| motley(k) + 0.2);
        let check_of = Check::from_cases(format!("{tone:?}"), cases);
        entry.check(check_of.large(1, Just(Case::new(tone, [Input::leaf(many)]))));
    }
    let stops = select(&[true, false][..])
        .prop_flat_map(|one| vec(-2.0..2.0_f64, if one { 1 } else { 3 }))
        .prop_map(|entries| match entries.len() {
            1 => Tensor::scalar(entries[0]),
            _ => Tensor::new([3], entries).unwrap(),
        });
    let cases = (tensor([2, 3], number()), stops)
        .prop_map(|(x, stops)| Case::new(Tone::Exposure, [x, stops].map(Input::leaf)));
    let wrong = Case::new(Tone::Exposure, [leaf([2, 3], 1.0), leaf([2], 1.0)]);
    entry.check(
        Check::from_cases("exposure", cases)
            .refuses_midway("mul needs shapes that broadcast, got [2, 3] and [2]", wrong),
    );
    benchmark!(entry, "srgb_encode", |s| [s.material[0]], |x| srgb_encode(x[0])?);
    benchmark!(entry, "srgb_decode", |s| [s.material[0]], |x| srgb_decode(x[0])?);
    entry
}

/// A tone curve.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Tone {
    Encode,
    Decode,
    Exposure,
}

impl Subject for Tone {
    /// Light, and stops.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let (out, seam) = match self {
            Self::Encode => (srgb_encode(inputs[0])?, 0.0031308),
            Self::Decode => (srgb_decode(inputs[0])?, 0.04045),
            Self::Exposure => (exposure(inputs[0], inputs[1])?, 0.0),
        };
        let side = |x: &f64| *self != Self::Exposure && x.abs() > seam;
        let sides: Vec<_> = wide(inputs[0]).data().iter().map(side).collect();
        Ok(Outcome::from(out).with_state(sides))
    }
}
