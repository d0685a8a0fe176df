//! Positions to clip space, once for each matrix.

mod extremes;

use bokashi_check::strategy::{camera, number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::project_instances;
use glam::DMat4;
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("project_instances").with_extremes(extremes::EXTREMES);
    let of = |fixed, inputs: Vec<Tensor<f64>>| {
        let inputs: Vec<_> = inputs.into_iter().map(Input::leaf).collect();
        Case::new(Instances { fixed }, inputs)
    };
    let some = |(instances, vertices): (usize, usize)| {
        (camera(), tensor([vertices, 3], number()), tensor([instances, 4, 4], number()))
    };
    let counts = || (0..4_usize, 1..5_usize);
    let fixed = counts().prop_flat_map(some);
    let fixed = fixed.prop_map(move |(camera, p, matrices)| of(Some(camera), vec![p, matrices]));
    let learnt = counts().prop_flat_map(some).prop_map(move |(camera, p, matrices)| {
        of(None, vec![p, matrices, Tensor::from_fn([4, 4], |[i, k]| camera[k][i])])
    });
    // Two pieces of the same positions, and many small meshes.
    let sizes = select(&[(2, 9_000), (900, 20)][..]);
    let many = (sizes, camera()).prop_map(move |((instances, vertices), camera)| {
        let matrices = Tensor::from_flat_fn([instances, 4, 4], |k| motley(3 * k));
        of(Some(camera), vec![Tensor::from_flat_fn([vertices, 3], motley), matrices])
    });
    let refused = |positions: &[usize], matrices: &[usize], camera: &[usize]| {
        let inputs = [positions, matrices, camera].map(|shape| Tensor::full(shape, 0.5));
        of(None, inputs.to_vec())
    };
    let points = || Tensor::full([2, 3], 0.5);
    let lost = Tensor::from_flat_fn([3, 4, 4], |k| if k == 37 { f64::NAN } else { 1.0 });
    let mut far = DMat4::IDENTITY.to_cols_array_2d();
    far[0][2] = f64::INFINITY;
    entry.check(
        Check::from_cases("project_instances", fixed)
            .large(2, many)
            .refuses(
                "project_instances needs matrices of shape [I, 4, 4], got shape [4, 4]",
                refused(&[2, 3], &[4, 4], &[4, 4]),
            )
            .refuses(
                "project_instances needs finite entries of matrix 2, got NaN",
                of(Some(DMat4::IDENTITY.to_cols_array_2d()), vec![points(), lost]),
            )
            .refuses(
                "a camera matrix needs finite entries, got inf in row 2, column 0",
                of(Some(far), vec![points(), Tensor::full([1, 4, 4], 0.5)]),
            ),
    );
    entry.check(
        Check::from_cases("project_instances by a variable", learnt)
            .refuses(
                "project_instances needs positions of shape [V, 3], got shape [6]",
                refused(&[6], &[1, 4, 4], &[4, 4]),
            )
            .refuses(
                "project_instances needs a camera matrix of shape [4, 4], got shape [4]",
                refused(&[2, 3], &[1, 4, 4], &[4]),
            ),
    );
    benchmark!(entry, "project_instances", |s| [s.positions, s.instances], |x| {
        project_instances(x[0], x[1], &s.camera)?
    });
    entry
}

#[derive(Debug, Clone, Copy)]
struct Instances {
    fixed: Option<[[f64; 4]; 4]>,
}

impl Subject for Instances {
    /// Positions and matrices, and perhaps a camera.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(match &self.fixed {
            None => project_instances(inputs[0], inputs[1], inputs[2])?.into(),
            Some(fixed) => {
                let camera = DMat4::from_cols_array_2d(fixed);
                project_instances(inputs[0], inputs[1], &camera)?.into()
            }
        })
    }
}
