//! Directions mirrored by normals.

mod extremes;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::reflect;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::materials::{ROWS, directions};
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("reflect").with_extremes(extremes::EXTREMES);
    let of = |d: Input, n: Input| Case::new(Reflect, [d, n]);
    let cases = (tensor([ROWS, 3], number()), directions(ROWS))
        .prop_map(move |(d, n)| of(Input::leaf(d), Input::leaf(n)));
    let rows =
        |k: usize| Input::leaf(Tensor::from_flat_fn([9000, 3], move |i| motley(11 * i + k) + 0.2));
    entry.check(
        Check::from_cases("reflect", cases)
            .large(1, Just(of(rows(1), rows(2))))
            .refuses(
                "reflect needs directions of shape [.., 3], got shape [2]",
                of(leaf([2], 1.0), leaf([2], 1.0)),
            )
            .refuses(
                "reflect needs normals of shape [2, 3], one for each direction, got shape [3]",
                of(leaf([2, 3], 1.0), leaf([3], 1.0)),
            ),
    );
    benchmark!(entry, "reflect", |s| [s.frames[2], s.frames[0]], |x| reflect(x[0], x[1])?);
    entry
}

#[derive(Debug)]
struct Reflect;

impl Subject for Reflect {
    /// Directions and normals.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(reflect(inputs[0], inputs[1])?.into())
    }
}
