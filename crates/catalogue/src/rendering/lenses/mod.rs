//! Points before, beside and behind a lens: `distort` and `fisheye`.

mod extremes;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::camera::{distortion_radius, fisheye_limit};
use bokashi_render_ops::{distort, fisheye};
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, wide, with_one};
use crate::scenes::motley;

/// Coefficients of [`distort`].
const BARREL: [f64; 5] = [-0.25, 0.0625, 0.001953125, -0.00390625, 0.0078125];

/// Coefficients of [`fisheye`].
const ANGLES: [f64; 4] = [0.0625, -0.015625, 0.00390625, -0.0009765625];

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("lenses").with_extremes(extremes::EXTREMES);
    distort_points_before_and_behind_a_lens(&mut entry);
    a_fisheye_shows_points_on_all_sides(&mut entry);
    benchmark!(entry, "distort", |s| [s.positions, Tensor::from(BARREL)], |x| distort(x[0], x[1])?);
    benchmark!(entry, "fisheye", |s| [s.positions, Tensor::from(ANGLES)], |x| fisheye(x[0], x[1])?);
    entry
}

#[derive(Debug, Clone, Copy)]
struct Distort;

impl Subject for Distort {
    /// Points and coefficients.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let (points, coefficients) = (wide(inputs[0]), wide(inputs[1]));
        let out = distort(inputs[0], inputs[1])?;
        // What a lens of five lacks is 0.
        let all: [f64; 8] =
            std::array::from_fn(|k| coefficients.data().get(k).copied().unwrap_or_default());
        let limit = distortion_radius(all);
        let is_inside = |p: &[f64]| p[2] > 0.0 && p[0].hypot(p[1]) <= limit * p[2];
        let inside: Vec<_> = points.data().chunks(3).map(is_inside).collect();
        Ok(Outcome::from(out).with_state(inside).with_state(limit < 16.0))
    }
}

/// Coefficients of lenses whose polynomial turns round, and of lenses whose does not.
fn lenses() -> impl Strategy<Value = Tensor<f64>> {
    let turning = [-0.4..-0.1, -0.05..0.0, -0.01..0.01, -0.01..0.01, -0.01..-0.001];
    let growing = [0.01..0.3, 0.001..0.01, -0.01..0.01, -0.01..0.01, 1e-4..1e-3];
    prop_oneof![turning, growing].prop_map(Tensor::from)
}

/// The same with a denominator that stays above 0, and one that falls to 0 at about 2.
fn rational_lenses() -> impl Strategy<Value = Tensor<f64>> {
    let denominator =
        prop_oneof![[0.05..0.3, 0.01..0.05, 1e-3..1e-2], [-0.3..-0.2, -0.01..0.0, -1e-3..0.0],];
    (lenses(), denominator)
        .prop_map(|(five, rest)| Tensor::from([five.data(), &rest[..]].concat().as_slice()))
}

/// Within the limit, beside it, far outside, and behind the camera.
fn any_point() -> impl Strategy<Value = [f64; 3]> {
    let depth = prop_oneof![4 => 1.0..3.0, 1 => 0.05..0.2, 1 => -2.0..-0.1];
    ([-1.5..1.5, -1.5..1.5], depth).prop_map(|([x, y], z)| [x, y, z])
}

fn distort_points_before_and_behind_a_lens(entry: &mut Entry) {
    let cases = (proptest::collection::vec(any_point(), 6), lenses()).prop_map(|(points, lens)| {
        Case::new(Distort, [Tensor::from(points), lens].map(Input::leaf))
    });
    let many = lenses().prop_map(|lens| {
        let point = |k: usize| if k % 3 == 2 { 1.0 + motley(k) } else { 2.0 * motley(k) - 1.0 };
        let points = Tensor::from_flat_fn([20_000, 3], point);
        Case::new(Distort, [points, lens].map(Input::leaf))
    });
    let of = |points, lens| Case::new(Distort, [points, lens]);
    let rational = (proptest::collection::vec(any_point(), 6), rational_lenses());
    let rational = rational.prop_map(|(points, lens)| {
        Case::new(Distort, [Tensor::from(points), lens].map(Input::leaf))
    });
    entry.check(Check::from_cases("distort by a quotient", rational).refuses(
        "distort needs coefficients of shape [5] or [8], got shape [7]",
        of(leaf([2, 3], 1.0), leaf([7], 0.1)),
    ));
    entry.check(
        Check::from_cases("distort", cases)
            .large(1, many)
            .refuses(
                "distort needs coefficients of shape [5] or [8], got shape [4]",
                of(leaf([2, 3], 1.0), leaf([4], 0.1)),
            )
            .refuses(
                "distort needs points of shape [V, 3], got shape [4]",
                of(leaf([4], 1.0), leaf([5], 0.1)),
            )
            .refuses(
                "distort needs coefficients within -1e100 and 1e100, got inf",
                of(leaf([2, 3], 0.0), with_one([5], 1, f64::INFINITY)),
            ),
    );
}

#[derive(Debug, Clone, Copy)]
struct Fisheye;

impl Subject for Fisheye {
    /// Points and coefficients.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let (points, coefficients) = (wide(inputs[0]), wide(inputs[1]));
        let out = fisheye(inputs[0], inputs[1])?;
        let limit = fisheye_limit(std::array::from_fn(|k| coefficients.data()[k]));
        let is_inside = |p: &[f64]| p[0].hypot(p[1]).atan2(p[2]) <= limit;
        let inside: Vec<_> = points.data().chunks(3).map(is_inside).collect();
        Ok(Outcome::from(out).with_state(inside).with_state(limit < 2.6))
    }
}

fn a_fisheye_shows_points_on_all_sides(entry: &mut Entry) {
    // Polynomials that turn round before 90 degrees, and those that go on to the widest angle.
    let turning = [-0.2..-0.1, -0.02..-0.01, -0.01..0.0, -0.003..-0.001];
    let growing = [0.01..0.1, -0.002..0.01, 1e-4..1e-3, 1e-5..1e-4];
    let lenses = || {
        prop_oneof![turning.clone().prop_map(Tensor::from), growing.clone().prop_map(Tensor::from)]
    };
    // Beside the axis, where series take over, too.
    let near = ([-1e-3..1e-3, -1e-3..1e-3], select(&[1.0, -1.0][..]));
    let near = near.prop_map(|([x, y], z)| [x, y, z]);
    let point = prop_oneof![4 => any_point(), 1 => near];
    let cases = (proptest::collection::vec(point, 6), lenses()).prop_map(|(points, lens)| {
        Case::new(Fisheye, [Tensor::from(points), lens].map(Input::leaf))
    });
    let many = lenses().prop_map(|lens| {
        let points = Tensor::from_flat_fn([20_000, 3], |k| 2.0 * motley(k) - 1.0);
        Case::new(Fisheye, [points, lens].map(Input::leaf))
    });
    let of = |points, lens| Case::new(Fisheye, [points, lens]);
    entry.check(
        Check::from_cases("fisheye", cases)
            .large(1, many)
            .refuses(
                "fisheye needs coefficients of shape [4], got shape [5]",
                of(leaf([2, 3], 1.0), leaf([5], 0.1)),
            )
            .refuses(
                "fisheye needs points of shape [V, 3], got shape [2, 4]",
                of(leaf([2, 4], 1.0), leaf([4], 0.1)),
            )
            .refuses(
                "fisheye needs coefficients within -1e100 and 1e100, got NaN",
                of(leaf([2, 3], 0.0), with_one([4], 2, f64::NAN)),
            ),
    );
}
