//! Irradiance of coefficients and normals.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::irradiance;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, with_one};
use crate::materials::{ROWS, directions};
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("irradiance");
    let of = |coefficients: Input, normals: Input| Case::new(Irradiance, [coefficients, normals]);
    let cases = (1..4_usize).prop_flat_map(move |channels| {
        let inputs = (tensor([9, channels], number()), directions(ROWS));
        inputs.prop_map(move |(coefficients, normals)| {
            of(Input::leaf(coefficients), Input::leaf(normals))
        })
    });
    let rows = |extents: [usize; 2], k: usize| {
        Input::leaf(Tensor::from_flat_fn(extents, move |i| motley(11 * i + k) + 0.2))
    };
    entry.check(
        Check::from_cases("irradiance", cases)
            .large(1, Just(of(rows([9, 3], 1), rows([9000, 3], 2))))
            .refuses(
                "irradiance needs coefficients of shape [9, C], got shape [4, 3]",
                of(leaf([4, 3], 1.0), leaf([2, 3], 1.0)),
            )
            .refuses(
                "irradiance needs directions other than zero, got zero in row 1",
                of(leaf([9, 3], 1.0), Input::leaf(Tensor::from([[1.0; 3], [0.0; 3]]))),
            )
            .refuses(
                "irradiance needs finite normals, got NaN in row 0",
                of(leaf([9, 3], 1.0), with_one([1, 3], 1, f64::NAN)),
            )
            .refuses(
                "irradiance needs normals of shape [N, 3], got shape [3]",
                of(leaf([9, 3], 1.0), leaf([3], 1.0)),
            ),
    );
    benchmark!(entry, "irradiance", |s| [harmonics(), s.frames[0]], |x| irradiance(x[0], x[1])?);
    entry
}

#[derive(Debug)]
struct Irradiance;

impl Subject for Irradiance {
    /// Coefficients and normals.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(irradiance(inputs[0], inputs[1])?.into())
    }
}

/// Coefficients of three channels.
fn harmonics() -> Tensor<f64> {
    Tensor::from_flat_fn([9, 3], |k| 1.0 / (1.0 + k as f64 / 4.0).floor())
}
