//! Smaller images, by every filter.

use bokashi_check::strategy::image_of;
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Border, Filter, downsample};
use proptest::prelude::*;
use proptest::sample::select;

use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("downsample");
    let filters = [
        Filter::Box,
        Filter::Triangle,
        Filter::Mitchell,
        Filter::Lanczos(2),
        Filter::custom(0.8, |x| 1.0 + x),
    ];
    for filter in filters {
        let borders = select(&[Border::Zero, Border::Mirror, Border::Clamp][..]);
        let of = filter.clone();
        // From one block, narrower than its window, up.
        let cases = (borders, 1..=3_usize, [1..=3_usize, 1..=3_usize], 1..=4_usize).prop_flat_map(
            move |(border, k, [rows, columns], channels)| {
                let subject = Downsample { k, filter: of.clone(), border };
                image_of([rows * k, columns * k, channels])
                    .prop_map(move |image| Case::new(subject.clone(), [Input::leaf(image)]))
            },
        );
        let by = |k: usize, image: Input| {
            Case::new(Downsample { k, filter: filter.clone(), border: Border::Mirror }, [image])
        };
        let large = Input::leaf(Tensor::from_flat_fn([300, 201, 3], motley));
        entry.check(
            Check::of_cases(format!("downsample, {filter:?}"), cases)
                .large(1, Just(by(3, large)))
                .refuses("a factor of 0", by(0, leaf([4, 4, 1], 0.5)))
                .refuses("rows that are left over", by(2, leaf([5, 4, 1], 0.5)))
                .refuses("an image without channels", by(2, leaf([4, 4], 0.5))),
        );
    }
    entry
}

#[derive(Debug, Clone)]
struct Downsample {
    k: usize,
    filter: Filter,
    border: Border,
}

impl Subject for Downsample {
    /// An image.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(downsample(inputs[0], self.k, &self.filter, self.border)?.into())
    }
}
