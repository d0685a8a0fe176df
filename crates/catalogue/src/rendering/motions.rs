//! Motions by quaternions and by increments: `rigid` and `se3`.

use bokashi_check::strategy::{camera, number, tensor, unit_quaternion};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{rigid, se3};
use glam::DMat4;
use proptest::prelude::*;
use proptest::sample::select;

use crate::entry::Entry;
use crate::inputs::leaf;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("motions");
    let turns = (unit_quaternion(), 0.5..2.0, tensor([3], number()));
    let turns = turns.prop_map(|(q, length, t)| {
        let rotation = Tensor::from(q.map(|entry| length * entry));
        Case::new(Motion { fixed: None }, [rotation, t].map(Input::leaf))
    });
    let of = |rotation, translation| {
        Case::new(Motion { fixed: None }, [leaf([rotation], 0.0), leaf([translation], 0.0)])
    };
    entry.check(
        Check::of_cases("rigid", turns)
            .refuses("a quaternion of zeros", of(4, 3))
            .refuses("a rotation of three entries", of(3, 3)),
    );
    // Angles of 0, next to it, on both sides of where the series end, and far beyond half a turn.
    let length = select(&[0.0, 1e-9, 1e-3, 0.4, 1.0, 1.7][..]);
    let increments = (camera(), tensor([6], number()), length);
    let increments = increments.prop_map(|(fixed, increment, length)| {
        let entry = |k: usize| increment.data()[k] * if k < 3 { 1.0 } else { length };
        let increment = Tensor::from_flat_fn([6], entry);
        Case::new(Motion { fixed: Some(fixed) }, [Input::leaf(increment)])
    });
    let fixed = Some(DMat4::IDENTITY.to_cols_array_2d());
    let of = |increment| Case::new(Motion { fixed }, [increment]);
    entry.check(
        Check::of_cases("se3", increments)
            .refuses("five entries", of(leaf([5], 0.0)))
            .refuses("an increment that is not finite", of(leaf([6], f64::NAN))),
    );
    entry
}

#[derive(Debug, Clone, Copy)]
struct Motion {
    fixed: Option<[[f64; 4]; 4]>,
}

impl Subject for Motion {
    /// A rotation and a translation, or an increment before a fixed matrix.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(match &self.fixed {
            None => rigid(inputs[0], inputs[1])?.into(),
            Some(fixed) => se3(inputs[0], &DMat4::from_cols_array_2d(fixed))?.into(),
        })
    }
}
