//! Fragments that outlive a step.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Background, DepthImage, antialias, composite, eye_depth, interpolate};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::fragments::fixed_fragments;
use crate::inputs::leaf;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("constant_fragments");
    let inputs = (tensor([4, 3], number()), tensor([2, 3], number()));
    let cases = inputs.prop_map(|(colors, distances)| {
        Case::new(OfConstantFragments, [colors, distances].map(Input::leaf))
    });
    let few = [leaf([3, 3], 0.5), Input::leaf(Tensor::from_flat_fn([2, 3], motley))];
    entry.check(Check::from_cases("constant fragments", cases).refuses_midway(
        "interpolate needs attributes of shape [4, C], C > 0, got shape [3, 3]",
        Case::new(OfConstantFragments, few),
    ));
    entry
}

#[derive(Debug, Clone, Copy)]
struct OfConstantFragments;

impl Subject for OfConstantFragments {
    /// Colours, and distances of an image that come from elsewhere.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let elsewhere = Tape::new();
        let fragments = fixed_fragments(&elsewhere, None)?.constant().on(tape);
        let surface = interpolate(inputs[0], &fragments)?;
        let picture = antialias(composite(surface, &fragments, Background::Zero)?)?;
        let distances = DepthImage::from_distances(inputs[1]).distances();
        Ok(vec![picture.image()?, distances * eye_depth(&fragments)?.values().sum()].into())
    }
}
