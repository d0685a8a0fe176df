//! Smaller images, by every filter.

mod extremes;

use bokashi_check::strategy::image_of;
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Border, Filter, downsample};
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("downsample").with_extremes(extremes::EXTREMES);
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
            Check::from_cases(format!("downsample, {filter:?}"), cases)
                .large(1, Just(by(3, large)))
                .refuses(
                    "downsample needs a factor of at least 1, got 0",
                    by(0, leaf([4, 4, 1], 0.5)),
                ),
        );
    }
    entry.check(refusing());
    benchmark!(entry, "downsample, box", |s| [s.image], |x| {
        downsample(x[0], 4, &Filter::Box, Border::Mirror)?
    });
    benchmark!(entry, "downsample, Lanczos", |s| [s.image], |x| {
        downsample(x[0], 4, &Filter::Lanczos(3), Border::Mirror)?
    });
    entry
}

/// Whatever the filter: shapes; and filters that are none.
fn refusing() -> Check {
    let by = |k: usize, filter: Filter, shape: &[usize]| {
        let image = Input::leaf(Tensor::full(shape, 0.5));
        Case::new(Downsample { k, filter, border: Border::Mirror }, [image])
    };
    let right = image_of([4, 6, 1]).prop_map(move |image| {
        let subject = Downsample { k: 2, filter: Filter::Box, border: Border::Mirror };
        Case::new(subject, [Input::leaf(image)])
    });
    let check = Check::from_cases("downsample", right)
        .refuses(
            "downsample needs a filter radius above 0 and up to 64 output pixels, got 0",
            by(2, Filter::Lanczos(0), &[4, 4, 1]),
        )
        .refuses(
            "downsample needs filter weights with a finite sum other than 0, got 0",
            by(2, Filter::custom(1.0, |x| x), &[4, 4, 1]),
        );
    let shapes: [(&[usize], usize); 7] = [
        (&[4, 6, 1], 4),
        (&[6, 4, 1], 4),
        (&[4, 4], 2),
        (&[0, 4, 1], 2),
        (&[4, 4, 0], 2),
        (&[4, 4, 1], 8),
        (&[4, 4, 1], usize::MAX),
    ];
    shapes.into_iter().fold(check, |check, (shape, k)| {
        let rule = "downsample needs an image of shape [H, W, C] with at least one entry, H and W";
        let message = format!("{rule} multiples of {k}, got shape {shape:?}");
        check.refuses(message, by(k, Filter::Box, shape))
    })
}

#[derive(Debug, Clone)]
struct Downsample {
    k: usize,
    filter: Filter,
    border: Border,
}

impl Subject for Downsample {
    /// An image.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(downsample(inputs[0], self.k, &self.filter, self.border)?.into())
    }
}
