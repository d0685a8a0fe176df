//! Normals moved by matrices of both shapes.

mod extremes;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::transform_normals;
use glam::DMat3;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::motley;
use crate::surfaces::{directions, vanishing};

const TURN: [[f64; 3]; 3] = [[0.5, -0.75, 1.0], [1.5, 0.25, -0.5], [0.0, 1.0, 2.0]];

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("transform_normals").with_extremes(extremes::EXTREMES);
    let of = |normals: Input, matrix: Input| Case::new(TransformNormals, [normals, matrix]);
    for side in [3, 4] {
        let cases = (directions(4), matrices(side))
            .prop_map(move |(normals, matrix)| of(Input::leaf(normals), Input::leaf(matrix)));
        let many = Tensor::from_flat_fn([20_000, 3], |k| motley(7 * k) + 0.6);
        let matrix =
            Tensor::from_flat_fn([side, side], |k| motley(k) + f64::from(k % (side + 1) == 0));
        entry.check(
            Check::from_cases(format!("transform_normals by {side} x {side}"), cases)
                .large(1, Just(of(Input::leaf(many), Input::leaf(matrix))))
                .refuses(
                    "transform_normals needs normals of shape [.., 3], got shape [2, 4]",
                    of(leaf([2, 4], 1.0), leaf([side, side], 1.0)),
                )
                .refuses(
                    "transform_normals needs normals of shape [.., 3], got shape []",
                    of(leaf([], 1.0), leaf([side, side], 1.0)),
                )
                .refuses(
                    "transform_normals needs a matrix of shape [4, 4] or [3, 3], got shape [3, 4]",
                    of(leaf([2, 3], 1.0), leaf([3, 4], 1.0)),
                )
                .refuses(
                    "transform_normals needs a matrix of shape [4, 4] or [3, 3], got shape [9]",
                    of(leaf([3], 1.0), leaf([9], 1.0)),
                ),
        );
    }
    benchmark!(entry, "transform_normals", |s| [s.positions, Tensor::from(TURN)], |x| {
        transform_normals(x[0], x[1])?
    });
    entry
}

#[derive(Debug)]
struct TransformNormals;

impl Subject for TransformNormals {
    /// Normals and a matrix.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let normals = transform_normals(inputs[0], inputs[1])?;
        Ok(Outcome::from(normals).with_state(vanishing(normals, 3)))
    }
}

/// Square matrices whose linear part is far enough from singular for difference quotients.
fn matrices(side: usize) -> BoxedStrategy<Tensor<f64>> {
    let determinant = move |matrix: &Tensor<f64>| {
        let at = |i: usize, j: usize| matrix.data()[i * side + j];
        DMat3::from_cols_array_2d(&[0, 1, 2].map(|i| [0, 1, 2].map(|j| at(i, j)))).determinant()
    };
    let is_regular = move |matrix: &Tensor<f64>| determinant(matrix).abs() > 0.5;
    tensor([side, side], number()).prop_filter("nearly singular", is_regular).boxed()
}
