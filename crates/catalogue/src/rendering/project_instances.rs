//! Positions to clip space, once for each matrix.

use bokashi_check::strategy::{camera, number, tensor};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::project_instances;
use glam::DMat4;
use proptest::prelude::*;
use proptest::sample::select;

use crate::entry::Entry;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("project_instances");
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
    let refused = |positions: [usize; 2], matrices: [usize; 2]| {
        of(
            None,
            vec![
                Tensor::full(positions, 0.5),
                Tensor::full(matrices, 0.5),
                Tensor::full([4, 4], 0.5),
            ],
        )
    };
    entry.check(
        Check::of_cases("project_instances", fixed)
            .large(2, many)
            .refuses("a matrix without an instance", refused([2, 3], [4, 4])),
    );
    entry.check(
        Check::of_cases("project_instances by a variable", learnt)
            .refuses("points of two coordinates", refused([2, 2], [4, 4])),
    );
    entry
}

#[derive(Debug, Clone, Copy)]
struct Instances {
    fixed: Option<[[f64; 4]; 4]>,
}

impl Subject for Instances {
    /// Positions and matrices, and perhaps a camera.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(match &self.fixed {
            None => project_instances(inputs[0], inputs[1], inputs[2])?.into(),
            Some(fixed) => {
                let camera = DMat4::from_cols_array_2d(fixed);
                project_instances(inputs[0], inputs[1], &camera)?.into()
            }
        })
    }
}
