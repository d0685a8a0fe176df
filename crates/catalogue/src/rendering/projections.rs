//! Projections by intrinsics: `pinhole` and `orthographic`.

use bokashi_check::strategy::{non_zero, number};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{orthographic, pinhole};
use proptest::prelude::*;
use proptest::sample::select;

use crate::entry::Entry;
use crate::scenes::size;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("projections");
    for (is_pinhole, planes) in [
        (true, vec![(0.1, 10.0), (1e-3, 1e3), (0.5, f64::INFINITY)]),
        (false, vec![(0.1, 10.0), (-2.0, 3.0)]),
    ] {
        let of = move |(near, far): (f64, f64), tensor| {
            Case::new(Projection { is_pinhole, near, far }, [Input::leaf(tensor)])
        };
        let cases =
            (select(planes), intrinsics()).prop_map(move |(planes, of_it)| of(planes, of_it));
        let name = if is_pinhole { "pinhole" } else { "orthographic" };
        entry.check(
            Check::of_cases(name, cases)
                .refuses("three intrinsics", of((0.1, 1.0), Tensor::full([3], 1.0)))
                .refuses("a scale of 0", of((0.1, 1.0), Tensor::zeros([4])))
                .refuses("planes in the wrong order", of((1.0, 0.1), Tensor::full([4], 1.0))),
        );
    }
    entry
}

#[derive(Debug, Clone, Copy)]
struct Projection {
    is_pinhole: bool,
    near: f64,
    far: f64,
}

impl Subject for Projection {
    /// Intrinsics.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let &Self { near, far, .. } = self;
        Ok(match self.is_pinhole {
            true => pinhole(inputs[0], size(7, 5), near, far)?.into(),
            false => orthographic(inputs[0], size(7, 5), near, far)?.into(),
        })
    }
}

/// Four numbers from 0.1 up in size, as intrinsics.
fn intrinsics() -> impl Strategy<Value = Tensor<f64>> {
    [non_zero(), non_zero(), number(), number()].prop_map(Tensor::from)
}
