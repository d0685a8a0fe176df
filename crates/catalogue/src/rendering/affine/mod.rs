//! Affine matrices, inverted and moving points: `affine_inverse` and `transform_points`.

mod extremes;

use bokashi_check::strategy::{number, tensor, unit_quaternion};
use bokashi_check::{Applied, Case, Check, Input, Subject, subject};
use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var};
use bokashi_render_ops::{affine_inverse, transform_points};
use glam::DMat4;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("affine").with_extremes(extremes::EXTREMES);
    let inverses = affine_rows().prop_map(|rows| Case::new(Affine, [Input::leaf(rows)]));
    subject!(Inverse: |x| affine_inverse(x[0])?);
    subject!(Moved: |x| transform_points(x[0], x[1])?);
    let inverse = |matrix: [f64; 16]| {
        Case::new(Inverse, [Input::leaf(Tensor::from_flat_fn([4, 4], |k| matrix[k]))])
    };
    let with = |changes: &[(usize, f64)]| {
        let mut matrix = DMat4::IDENTITY.to_cols_array();
        changes.iter().for_each(|&(k, entry)| matrix[k] = entry);
        matrix
    };
    let rows = |entry: fn(usize) -> f64| with(&[0, 1, 2, 4, 5, 6, 8, 9, 10].map(|k| (k, entry(k))));
    let determinant =
        "affine_inverse needs a linear part whose determinant is not 0 within rounding, got 0";
    entry.check(
        Check::from_cases("affine_inverse", inverses)
            .refuses(
                "affine_inverse needs a matrix of shape [4, 4], got shape [4]",
                Case::new(Inverse, [leaf([4], 1.0)]),
            )
            .refuses(
                "a camera matrix needs finite entries, got NaN in row 1, column 0",
                inverse(with(&[(4, f64::NAN)])),
            )
            .refuses(
                "affine_inverse needs a matrix with the last row (0, 0, 0, 1), got -1",
                inverse(with(&[(14, -1.0), (15, 0.0)])),
            )
            .refuses(determinant, inverse(rows(|k| (k + 1) as f64)))
            .refuses(determinant, inverse(rows(|_| 0.0))),
    );
    let moved_by = |points, matrix: [f64; 16]| {
        Case::new(Moved, [points, Input::leaf(Tensor::from_flat_fn([4, 4], |k| matrix[k]))])
    };
    let moved = |points: Tensor<f64>, rows| Case::new(Affine, [points, rows].map(Input::leaf));
    let some = (tensor([5, 3], number()), affine_rows()).prop_map(move |(p, rows)| moved(p, rows));
    // More than a piece of points.
    let many =
        affine_rows().prop_map(move |rows| moved(Tensor::from_flat_fn([20_000, 3], motley), rows));
    let last_row = "transform_points needs a matrix with the last row (0, 0, 0, 1), got";
    entry.check(
        Check::from_cases("transform_points", some)
            .large(1, many)
            .refuses(format!("{last_row} 0.5"), moved_by(leaf([2, 3], 0.5), with(&[(12, 0.5)])))
            .refuses(format!("{last_row} 2"), moved_by(leaf([2, 3], 0.5), with(&[(15, 2.0)])))
            .refuses(
                "transform_points needs a matrix of shape [4, 4], got shape [3, 4]",
                Case::new(Moved, [leaf([2, 3], 0.5), leaf([3, 4], 1.0)]),
            )
            .refuses(
                "transform_points needs points of shape [V, 3], got shape [6]",
                moved_by(leaf([6], 0.5), with(&[])),
            ),
    );
    benchmark!(entry, "affine_inverse", |s| [s.affine], |x| affine_inverse(x[0])?);
    benchmark!(entry, "transform_points", |s| [s.positions, s.affine], |x| {
        transform_points(x[0], x[1])?
    });
    entry
}

#[derive(Debug, Clone, Copy)]
struct Affine;

impl Subject for Affine {
    /// The rows of an affine matrix; with points before it, which it moves.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(match *inputs {
            [points, rows] => transform_points(points, affine(rows)?)?.into(),
            _ => affine_inverse(affine(inputs[0])?)?.into(),
        })
    }
}

/// `[3, 4]` with the row that makes it an affine matrix: that row is no variable.
fn affine<'t, T: Scalar>(rows: Var<'t, T>) -> Result<Var<'t, T>, TensorError> {
    let last = Tensor::from_flat_fn([1, 4], |k| if k == 3 { T::ONE } else { T::ZERO });
    Var::concat(&[rows, rows.tape().constant(&last)], 0)
}

/// The rows of a motion times a matrix of any kind that is not close to a singular one.
fn affine_rows() -> impl Strategy<Value = Tensor<f64>> {
    let entries = (unit_quaternion(), [0.3..2.0, 0.3..2.0, 0.3..2.0], tensor([3], number()));
    entries.prop_map(|(q, scale, shift)| {
        let turn = DMat4::from_quat(glam::DQuat::from_array(q));
        let matrix = turn * DMat4::from_scale(scale.into()) * turn;
        let columns = matrix.to_cols_array_2d();
        Tensor::from_flat_fn([3, 4], |k| match k % 4 {
            3 => shift.data()[k / 4],
            column => columns[column][k / 4],
        })
    })
}
