//! Motions by quaternions and by increments: `rigid` and `se3`.

mod extremes;

use bokashi_check::strategy::{camera, number, tensor, unit_quaternion};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{rigid, se3};
use glam::DMat4;
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;

const ROTATION: [f64; 4] = [0.125, -0.25, 0.5, 1.0];

const TRANSLATION: [f64; 3] = [0.25, -0.5, 1.0];

const INCREMENT: [f64; 6] = [0.25, -0.5, 1.0, 0.125, -0.25, 0.5];

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("motions").with_extremes(extremes::EXTREMES);
    let turns = (unit_quaternion(), 0.5..2.0, tensor([3], number()));
    let turns = turns.prop_map(|(q, length, t)| {
        let rotation = Tensor::from(q.map(|entry| length * entry));
        Case::new(Motion { fixed: None }, [rotation, t].map(Input::leaf))
    });
    let of = |rotation, translation| Case::new(Motion { fixed: None }, [rotation, translation]);
    let far = Input::leaf(Tensor::from([0.0, f64::INFINITY, 0.0]));
    entry.check(
        Check::from_cases("rigid", turns)
            .refuses(
                "rigid needs a rotation of shape [4], got shape [3]",
                of(leaf([3], 1.0), leaf([3], 0.0)),
            )
            .refuses(
                "rigid needs a translation of shape [3], got shape [4]",
                of(leaf([4], 1.0), leaf([4], 1.0)),
            )
            .refuses(
                "a rotation needs a finite quaternion other than zero, got (0, 0, 0, 0)",
                of(leaf([4], 0.0), leaf([3], 0.0)),
            )
            .refuses("rigid needs a finite translation, got inf", of(leaf([4], 1.0), far)),
    );
    // Angles of 0, next to it, on both sides of where the series end, and far beyond half a turn.
    let length = select(&[0.0, 1e-9, 1e-3, 0.4, 1.0, 1.7][..]);
    let increments = (camera(), tensor([6], number()), length);
    let increments = increments.prop_map(|(fixed, increment, length)| {
        let entry = |k: usize| increment.data()[k] * if k < 3 { 1.0 } else { length };
        let increment = Tensor::from_flat_fn([6], entry);
        Case::new(Motion { fixed: Some(fixed) }, [Input::leaf(increment)])
    });
    let of = |fixed: DMat4, increment| {
        Case::new(Motion { fixed: Some(fixed.to_cols_array_2d()) }, [increment])
    };
    let with = |entry: f64, k: usize| {
        let increment = Tensor::from_flat_fn([6], |other| if other == k { entry } else { 0.0 });
        of(DMat4::IDENTITY, Input::leaf(increment))
    };
    let mut lost = DMat4::IDENTITY;
    lost.x_axis.y = f64::NAN;
    let far = format!("-1{}", "0".repeat(51));
    let range = "se3 needs an increment within -1e50 and 1e50, got";
    entry.check(
        Check::from_cases("se3", increments)
            .refuses(
                "se3 needs an increment of shape [6], got shape [5]",
                of(DMat4::IDENTITY, leaf([5], 0.0)),
            )
            .refuses(format!("{range} {far}"), with(-1e51, 3))
            .refuses(format!("{range} NaN"), with(f64::NAN, 1))
            .refuses(
                "a camera matrix needs finite entries, got NaN in row 1, column 0",
                of(lost, leaf([6], 0.0)),
            ),
    );
    benchmark!(entry, "rigid", |s| [Tensor::from(ROTATION), Tensor::from(TRANSLATION)], |x| {
        rigid(x[0], x[1])?
    });
    benchmark!(entry, "se3", |s| [Tensor::from(INCREMENT)], |x| se3(x[0], &s.camera)?);
    entry
}

#[derive(Debug, Clone, Copy)]
struct Motion {
    fixed: Option<[[f64; 4]; 4]>,
}

impl Subject for Motion {
    /// A rotation and a translation, or an increment before a fixed matrix.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(match &self.fixed {
            None => rigid(inputs[0], inputs[1])?.into(),
            Some(fixed) => se3(inputs[0], &DMat4::from_cols_array_2d(fixed))?.into(),
        })
    }
}
