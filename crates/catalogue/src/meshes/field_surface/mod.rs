//! Surfaces of fields, on grids that stand still and on grids that move.

mod extremes;

use bokashi_check::strategy::tensor;
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject, sides};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_mesh::{Grid, field_surface};
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, with_one};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("field_surface").with_extremes(extremes::EXTREMES);
    for (kind, count) in [("field_surface", 1), ("field_surface on a grid that moves", 2)] {
        let cases = small_grids().prop_flat_map(move |grid| {
            let inputs = (field(&grid), tensor([grid.point_count(), 3], -0.1..0.1));
            inputs.prop_map(move |(field, offsets)| {
                Case::new(FieldSurface { grid }, &[field, offsets].map(Input::leaf)[..count])
            })
        });
        let check = Check::from_cases(kind, cases).large(1, Just(large(count)));
        entry.check(refusing(check));
    }
    benchmark!(entry, "field_surface", |s| [s.field, s.offsets], |x| {
        field_surface(x[0], Some(x[1]), &s.grid)?.positions
    });
    entry
}

/// Grids of a few cells, and one whose rows are longer than a word of signs.
fn small_grids() -> BoxedStrategy<Grid> {
    let shapes = vec![[2, 2, 2], [3, 2, 4], [2, 3, 3], [2, 2, 66]];
    select(shapes).prop_map(|shape| Grid::new(shape, [-0.5, 0.25, 1.0], 0.5).unwrap()).boxed()
}

/// Fields of at least one crossing; of every sixth some numbers are exactly 0, where no slope is defined.
fn field(grid: &Grid) -> BoxedStrategy<Tensor<f64>> {
    let signed = prop_oneof![0.05..1.0, -1.0..-0.05];
    let number = prop_oneof![4 => signed.clone(), 1 => select(&[0.0, -0.0][..])];
    let last = grid.point_count() - 1;
    let crossed = move |field: Tensor<f64>| {
        Tensor::from_flat_fn(field.shape(), |k| match k {
            0 => -0.5,
            k if k == last => 0.75,
            k => field.data()[k],
        })
    };
    prop_oneof![5 => tensor(grid.shape(), signed), 1 => tensor(grid.shape(), number)]
        .prop_map(crossed)
        .boxed()
}

/// A sphere on a grid of many pieces of work.
fn large(count: usize) -> Case {
    let grid = Grid::new([40; 3], [-1.1, -1.2, -1.15], 0.0625).unwrap();
    let field = grid.sampled(|[x, y, z]| (x * x + y * y + z * z).sqrt() - 0.8);
    let motley = |k: usize| 0.01 * (((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.4);
    let offsets = Tensor::from_flat_fn([grid.point_count(), 3], motley);
    Case::new(FieldSurface { grid }, &[field, offsets].map(Input::leaf)[..count])
}

fn refusing(check: Check) -> Check {
    let grid = Grid::new([2, 3, 2], [0.0; 3], 1.0).unwrap();
    let of = |inputs: Vec<Input>| Case::new(FieldSurface { grid }, inputs);
    let check = [&[11][..], &[2, 2, 3], &[12, 1]].into_iter().fold(check, |check, shape| {
        check.refuses(
            format!("field_surface needs a field of shape [2, 3, 2] or [12], got shape {shape:?}"),
            of(vec![Input::leaf(Tensor::full(shape, 1.0))]),
        )
    });
    let check = check
        .refuses(
            "field_surface needs offsets of shape [12, 3], got shape [2, 3, 2, 3]",
            of(vec![leaf([12], 1.0), leaf([2, 3, 2, 3], 0.0)]),
        )
        .refuses(
            "grid points need finite positions, got [1.0, inf, 2.0] at grid point [0, 2, 1]",
            of(vec![leaf([12], 1.0), with_one([12, 3], 16, f64::INFINITY)]),
        );
    [(f64::NAN, "NaN"), (f64::NEG_INFINITY, "-inf")].into_iter().fold(
        check,
        |check, (bad, name)| {
            check.refuses(
                format!("a field needs to be finite, got {name} at grid point [1, 1, 1]"),
                of(vec![with_one([12], 9, bad)]),
            )
        },
    )
}

#[derive(Debug)]
struct FieldSurface {
    grid: Grid,
}

impl Subject for FieldSurface {
    /// A field, and perhaps offsets.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let surface = field_surface(inputs[0], inputs.get(1).copied(), &self.grid)?;
        let signs = sides(inputs[0], &[0.0]);
        let faces = surface.mesh.faces().to_vec();
        Ok(Outcome::from(surface.positions).with_state((signs, faces)))
    }
}
