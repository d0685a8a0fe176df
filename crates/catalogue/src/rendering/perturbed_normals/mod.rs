//! Normals of normal maps, in frames of every kind.

mod extremes;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::perturbed_normals;
use glam::DVec3;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, wide};
use crate::scenes::motley;
use crate::surfaces::directions;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("perturbed_normals").with_extremes(extremes::EXTREMES);
    let of = |n: Input, t: Input, v: Input| Case::new(PerturbedNormals, [n, t, v]);
    let count = 4;
    let rows = |width: usize| {
        let entry = move |k: usize| motley(11 * k + width) + 0.2;
        Input::leaf(Tensor::from_flat_fn([12_000, width], entry))
    };
    // The sign is a number that is not near 0; and a tangent may be missing.
    let sign = select(&[1.0, -1.0, 0.4, -0.7][..]);
    let is_there = prop_oneof![11 => Just(true), 1 => Just(false)];
    // Nearly along the normal a difference quotient has no step.
    let is_across = |[n, t, _]: &[Tensor<f64>; 3]| {
        let mut rows = n.data().chunks(3).zip(t.data().chunks(3));
        rows.all(|(n, t)| DVec3::from_slice(n).cross(DVec3::from_slice(t)).length() > 0.1)
    };
    let vectors = [directions(count), directions(count), directions(count)];
    let vectors = vectors.prop_filter("along the normal", is_across);
    let cases = (vectors, vec((sign, is_there), count)).prop_map(move |([n, t, v], kinds)| {
        let tangent = |k: usize| match (k % 4, kinds[k / 4]) {
            (3, (sign, _)) => sign,
            (_, (_, false)) => 0.0,
            (i, _) => t.data()[k / 4 * 3 + i],
        };
        let t = Tensor::from_flat_fn([count, 4], tangent);
        of(Input::leaf(n), Input::leaf(t), Input::leaf(v))
    });
    entry.check(
        Check::from_cases("perturbed_normals", cases)
            .large(1, Just(of(rows(3), rows(4), rows(3))))
            .refuses(
                "perturbed_normals needs normals of shape [.., 3], got shape [2, 4]",
                of(leaf([2, 4], 1.0), leaf([2, 4], 1.0), leaf([2, 3], 1.0)),
            )
            .refuses(
                "perturbed_normals needs normals of shape [.., 3], got shape []",
                of(leaf([], 1.0), leaf([4], 1.0), leaf([3], 1.0)),
            )
            .refuses(
                "perturbed_normals needs tangents of shape [2, 4], got shape [2, 3]",
                of(leaf([2, 3], 1.0), leaf([2, 3], 1.0), leaf([2, 3], 1.0)),
            )
            .refuses(
                "perturbed_normals needs tangents of shape [2, 4], got shape [3, 4]",
                of(leaf([2, 3], 1.0), leaf([3, 4], 1.0), leaf([2, 3], 1.0)),
            )
            .refuses(
                "perturbed_normals needs map values of shape [5, 2, 3], got shape [10, 3]",
                of(leaf([5, 2, 3], 1.0), leaf([5, 2, 4], 1.0), leaf([10, 3], 1.0)),
            ),
    );
    benchmark!(entry, "perturbed_normals", |s| [s.frames[0], s.frames[1], s.frames[2]], |x| {
        perturbed_normals(x[0], x[1], x[2])?
    });
    entry
}

#[derive(Debug)]
struct PerturbedNormals;

impl Subject for PerturbedNormals {
    /// Normals, tangents and map values.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let out = perturbed_normals(inputs[0], inputs[1], inputs[2])?;
        let tangents = wide(inputs[1]);
        let kind = |row: &[f64]| (row[3] < 0.0, row[..3] == [0.0; 3]);
        let kinds: Vec<_> = tangents.data().chunks(4).map(kind).collect();
        Ok(Outcome::from(out).with_state(kinds))
    }
}
