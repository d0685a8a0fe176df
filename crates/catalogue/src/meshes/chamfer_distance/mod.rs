//! Chamfer distances of clouds.

mod extremes;

use bokashi_check::strategy::tensor;
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_mesh::{PointDistance, chamfer_distance, nearest_points};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, with_one};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("chamfer_distance").with_extremes(extremes::EXTREMES);
    let kinds = [("distances", PointDistance::Euclidean), ("squares", PointDistance::Squared)];
    for (kind, distance) in kinds {
        let clouds = (1..7_usize, 1..7_usize)
            .prop_flat_map(|(n, m)| (tensor([n, 3], -1.0..1.0), tensor([m, 3], -1.0..1.0)));
        let cases =
            clouds.prop_map(move |(x, y)| Case::new(Chamfer { distance }, [x, y].map(Input::leaf)));
        let check = Check::from_cases(format!("chamfer_distance of {kind}"), cases);
        let motley = |k: usize| ((k * 7919 + 13) % 1009) as f64 / 1009.0;
        let large = [3000, 2000].map(|n| Input::leaf(Tensor::from_flat_fn([n, 3], motley)));
        entry.check(refusing(
            check.large(1, Just(Case::new(Chamfer { distance }, large))),
            |x, y| Case::new(Chamfer { distance }, [x, y]),
        ));
    }
    benchmark!(entry, "chamfer_distance", |s| [s.positions, s.normals], |x| {
        chamfer_distance(x[0], x[1], PointDistance::Squared)?
    });
    entry
}

fn refusing(check: Check, of: impl Fn(Input, Input) -> Case) -> Check {
    let rule = "chamfer_distance needs points of shape [n, 3]";
    check
        .refuses(format!("{rule}, got shape [4, 2]"), of(leaf([4, 2], 1.0), leaf([4, 3], 1.0)))
        .refuses(format!("{rule}, got shape [12]"), of(leaf([4, 3], 1.0), leaf([12], 1.0)))
        .refuses(
            format!("{rule} with n from 1 up, got shape [0, 3]"),
            of(leaf([0, 3], 1.0), leaf([4, 3], 1.0)),
        )
        .refuses(
            format!("{rule} with n from 1 up, got shape [0, 3]"),
            of(leaf([4, 3], 1.0), leaf([0, 3], 1.0)),
        )
        .refuses(
            "chamfer_distance needs finite numbers in row 2 of the points, got NaN",
            of(leaf([4, 3], 1.0), with_one([4, 3], 7, f64::NAN)),
        )
}

#[derive(Debug)]
struct Chamfer {
    distance: PointDistance,
}

impl Subject for Chamfer {
    /// Two clouds.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let [x, y] = [inputs[0], inputs[1]];
        let distance = chamfer_distance(x, y, self.distance)?;
        let nearest = [(x, y), (y, x)].map(|(from, to)| nearest_points(&from.value(), &to.value()));
        let [of_x, of_y] = nearest.map(|found| found.map(|found| found.indices));
        Ok(Outcome::from(distance).with_state((of_x?, of_y?)))
    }
}
