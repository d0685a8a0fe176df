//! Images out of focus, by their depths and the lens.

use bokashi_check::strategy::number;
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{DepthImage, Lens, LensOptions, Radius, depth_of_field};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::{leaf, wide};
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("depth_of_field");
    // Windows that are smaller and larger than the image, and caps that some pixels reach.
    for (radius, largest_sigma) in
        [(Radius::Fixed(3), 32.0), (Radius::Fixed(12), 2.0), (Radius::Tolerance(1e-13), 1.5)]
    {
        let options = LensOptions { radius, largest_sigma };
        let sizes = (1..6_usize, 2..7_usize);
        let lenses = (0.5..3.0, 1.8..2.2);
        // Depths from far before the focus to far behind it, some of them near it.
        let depth = prop_oneof![4 => 0.7..6.0, 1 => 1.9..2.1];
        let cases = (sizes, vec(number(), 72), vec(depth, 36), lenses).prop_map(
            move |((height, width), colors, depths, (aperture, focus))| {
                let inputs = [
                    Tensor::from_flat_fn([height, width, 2], |k| colors[k]),
                    Tensor::from_flat_fn([height, width], |k| depths[k]),
                    Tensor::scalar(aperture),
                    Tensor::scalar(focus),
                ];
                Case::new(DepthOfField { options }, inputs.map(Input::leaf))
            },
        );
        let by = |depth: Input, aperture: f64, focus: f64| {
            let inputs = [leaf([3, 3, 1], 0.5), depth, leaf([], aperture), leaf([], focus)];
            Case::new(DepthOfField { options }, inputs)
        };
        entry.check(
            Check::of_cases(format!("depth_of_field, {radius:?}"), cases)
                .large(1, Just(large_view(options)))
                .refuses("a negative depth", by(leaf([3, 3], -1.0), 1.0, 2.0))
                .refuses("a negative aperture", by(leaf([3, 3], 1.0), -1.0, 2.0))
                .refuses("a focus of 0", by(leaf([3, 3], 1.0), 1.0, 0.0))
                .refuses("depths of another size", by(leaf([3, 2], 1.0), 1.0, 2.0)),
        );
    }
    entry
}

#[derive(Debug)]
struct DepthOfField {
    options: LensOptions,
}

impl Subject for DepthOfField {
    /// An image, its depths, an aperture and a focus.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let lens = Lens { aperture: inputs[2], focus: inputs[3] };
        let distances = DepthImage::of_distances(inputs[1]);
        let focused = depth_of_field(inputs[0], distances, lens, &self.options)?;
        let (aperture, focus) = (wide(inputs[2]).item(), wide(inputs[3]).item());
        let is_capped = |z: &f64| aperture * (1.0 - focus / z).abs() > self.options.largest_sigma;
        let capped: Vec<_> = wide(inputs[1]).data().iter().map(is_capped).collect();
        Ok(Outcome::from(focused.image).with_state(capped))
    }
}

/// An image that is gathered in several pieces.
fn large_view(options: LensOptions) -> Case {
    let inputs = [
        Tensor::from_flat_fn([31, 27, 2], motley),
        Tensor::from_flat_fn([31, 27], |k| 2.0 + 0.9 * motley(3 * k)),
        Tensor::scalar(1.1),
        Tensor::scalar(2.0),
    ];
    Case::new(DepthOfField { options }, inputs.map(Input::leaf))
}
