//! Images out of focus, by their depths and the lens.

mod extremes;

use std::ops::Range;

use bokashi_check::strategy::number;
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{DepthImage, Iris, Lens, LensOptions, Radius, depth_of_field};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, wide, with_one};
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("depth_of_field").with_extremes(extremes::EXTREMES);
    // Windows that are smaller and larger than the image, and caps that some pixels reach.
    let gaussian = LensOptions::default();
    for (radius, largest_sigma) in
        [(Radius::Fixed(3), 32.0), (Radius::Fixed(12), 2.0), (Radius::Tolerance(1e-13), 1.5)]
    {
        let options = LensOptions { radius, largest_sigma, ..gaussian };
        entry.check(check(&format!("{radius:?}"), options, 0.5..3.0));
    }
    // Circles of a few pixels, and such as are drawn at half the size.
    for (name, iris, largest_sigma, apertures) in [
        ("through a disc", Iris::Disc, 7.0, 3.0..8.0),
        ("through blades", Iris::Polygon { blades: 5, rotation: 0.3 }, 1.0, 0.3..1.5),
    ] {
        let options = LensOptions { largest_sigma, iris: Some(iris), ..gaussian };
        entry.check(check(name, options, apertures));
    }
    benchmark!(
        entry,
        "depth_of_field",
        |s| [s.image, s.distances[0], Tensor::scalar(2.0), Tensor::scalar(1.25)],
        |x| {
            let lens = Lens { aperture: x[2], focus: x[3] };
            let distances = DepthImage::from_distances(x[1]);
            depth_of_field(x[0], distances, lens, &LensOptions::default())?.image
        }
    );
    entry
}

/// What the operation keeps with these options, for lenses of some apertures.
fn check(name: &str, options: LensOptions, apertures: Range<f64>) -> Check {
    let sizes = (1..6_usize, 2..7_usize);
    let lenses = (apertures, 1.8..2.2);
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
    let check = Check::from_cases(format!("depth_of_field, {name}"), cases);
    refusing(check.large(1, Just(large_view(options))), options)
}

fn refusing(check: Check, options: LensOptions) -> Check {
    let right = [leaf([3, 3, 1], 0.5), leaf([3, 3], 1.0), leaf([], 1.0), leaf([], 2.0)];
    let with = |k: usize, input: Input| {
        let mut inputs = right.clone();
        inputs[k] = input;
        Case::new(DepthOfField { options }, inputs)
    };
    let by = |options| Case::new(DepthOfField { options }, right.clone());
    let endless = LensOptions { largest_sigma: f64::INFINITY, ..options };
    let wide = LensOptions { radius: Radius::Fixed(20_000), ..options };
    let through = |iris| LensOptions { iris: Some(iris), ..options };
    let blades = |blades, rotation| by(through(Iris::Polygon { blades, rotation }));
    let rows = [
        (
            "an image of shape [H, W, C] with at least one entry, got shape [3, 3]",
            with(0, leaf([3, 3], 0.5)),
        ),
        ("a depth image of shape [3, 3], got shape [3, 3, 1]", with(1, leaf([3, 3, 1], 1.0))),
        ("a single number for the aperture, got shape [3, 3]", with(2, leaf([3, 3], 1.0))),
        ("a single number for the focus, got shape [3, 3]", with(3, leaf([3, 3], 1.0))),
        ("a finite aperture of at least 0, got -1", with(2, leaf([], -1.0))),
        ("a finite and positive focus, got 0", with(3, leaf([], 0.0))),
        ("depths from 0 up, got -0.5 at pixel 7", with(1, with_one([3, 3], 7, -0.5))),
        ("depths from 0 up, got NaN at pixel 7", with(1, with_one([3, 3], 7, f64::NAN))),
        ("a finite largest sigma of at least 0, got inf", by(endless)),
        (
            "a largest sigma of at most 512 pixels with an iris, got 513",
            by(LensOptions { largest_sigma: 513.0, ..through(Iris::Disc) }),
        ),
        ("an iris of 3 to 16 blades, got 2", blades(2, 0.0)),
        ("a finite rotation of the iris, got inf", blades(3, f64::INFINITY)),
    ];
    let check = check.refuses(
        "gaussian_blur needs a window radius of at most 16384 pixels, got 20000",
        by(wide),
    );
    rows.into_iter().fold(check, |check, (rule, case)| {
        check.refuses(format!("depth_of_field needs {rule}"), case)
    })
}

#[derive(Debug)]
struct DepthOfField {
    options: LensOptions,
}

impl Subject for DepthOfField {
    /// An image, its depths, an aperture and a focus.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let lens = Lens { aperture: inputs[2], focus: inputs[3] };
        let distances = DepthImage::from_distances(inputs[1]);
        let focused = depth_of_field(inputs[0], distances, lens, &self.options)?;
        let (aperture, focus) = (wide(inputs[2]).item(), wide(inputs[3]).item());
        let LensOptions { largest_sigma, iris, .. } = self.options;
        // Through an iris, slopes step at rungs of the radii 3 sinh(0.08 m).
        let piece = |z: &f64| match aperture * (1.0 - focus / z) {
            sigma if sigma.abs() > largest_sigma => None,
            sigma if iris.is_some() => Some(((sigma / 1.5).asinh() / 0.08).floor() as i32),
            _ => Some(0),
        };
        let pieces: Vec<_> = wide(inputs[1]).data().iter().map(piece).collect();
        Ok(Outcome::from(focused.image).with_state(pieces))
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
