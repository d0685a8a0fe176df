//! Positions to clip space, by a camera that is fixed or learnt, with and without a pose.

use bokashi_check::strategy::{camera, number, tensor, unit_quaternion};
use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Pose, project};
use glam::DMat4;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::motley;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("project");
    project_with_and_without_a_pose(&mut entry);
    project_by_a_camera_that_is_learnt(&mut entry);
    benchmark!(entry, "project", |s| [s.positions], |x| project(x[0], &s.camera, None)?);
    entry
}

#[derive(Debug)]
struct Project {
    camera: [[f64; 4]; 4],
}

impl Subject for Project {
    /// Positions, or positions with a rotation and a translation.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let camera = DMat4::from_cols_array_2d(&self.camera);
        let pose = match *inputs {
            [_, rotation, translation] => Some(Pose { rotation, translation }),
            _ => None,
        };
        Ok(project(inputs[0], &camera, pose)?.into())
    }
}

fn project_with_and_without_a_pose(entry: &mut Entry) {
    let positions = |count| tensor([count, 3], number()).prop_map(Input::leaf);
    let bare = (camera(), positions(5));
    let bare = bare.prop_map(|(camera, p)| Case::new(Project { camera }, [p]));
    let mut blind = DMat4::IDENTITY.to_cols_array_2d();
    blind[2][1] = f64::NAN;
    entry.check(
        Check::from_cases("project", bare)
            .refuses(
                "project needs positions of shape [V, 3], got shape [6]",
                project_by(identity(), &[leaf([6], 0.5)]),
            )
            .refuses(
                "a camera matrix needs finite entries, got NaN in row 1, column 2",
                project_by(blind, &[leaf([2, 3], 0.5)]),
            ),
    );
    let posed = (camera(), positions(4), unit_quaternion(), 0.5..2.0, tensor([3], number()));
    let posed = posed.prop_map(|(camera, p, q, length, t)| {
        let rotation = Tensor::from_flat_fn([4], |k| length * q[k]);
        Case::new(Project { camera }, [p, Input::leaf(rotation), Input::leaf(t)])
    });
    let points = leaf([2, 3], 0.5);
    let no_rotation = [points.clone(), leaf([4], 0.0), leaf([3], 0.0)];
    let three = [points.clone(), leaf([3], 0.5), leaf([3], 0.0)];
    let no_shift = [points, leaf([4], 0.5), leaf([4], 0.0)];
    entry.check(
        Check::from_cases("project with a pose", posed)
            .refuses(
                "a rotation needs a finite quaternion other than zero, got (0, 0, 0, 0)",
                project_by(identity(), &no_rotation),
            )
            .refuses(
                "project needs a rotation of shape [4], got shape [3]",
                project_by(identity(), &three),
            )
            .refuses(
                "project needs a translation of shape [3], got shape [4]",
                project_by(identity(), &no_shift),
            ),
    );
}

fn identity() -> [[f64; 4]; 4] {
    DMat4::IDENTITY.to_cols_array_2d()
}

fn project_by(camera: [[f64; 4]; 4], inputs: &[Input]) -> Case {
    Case::new(Project { camera }, inputs)
}

#[derive(Debug, Clone, Copy)]
struct ProjectByVariable;

impl Subject for ProjectByVariable {
    /// Positions and a camera; or positions, a rotation, a translation and a camera.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        Ok(match *inputs {
            [positions, rotation, translation, camera] => {
                project(positions, camera, Some(Pose { rotation, translation }))?.into()
            }
            _ => project(inputs[0], inputs[1], None)?.into(),
        })
    }
}

fn project_by_a_camera_that_is_learnt(entry: &mut Entry) {
    let matrix = |camera: [[f64; 4]; 4]| Tensor::from_fn([4, 4], |[i, k]| camera[k][i]);
    let of = |inputs: Vec<Tensor<f64>>| {
        Case::new(ProjectByVariable, inputs.into_iter().map(Input::leaf).collect::<Vec<_>>())
    };
    let bare = (camera(), tensor([5, 3], number()));
    let bare = bare.prop_map(move |(camera, p)| of(vec![p, matrix(camera)]));
    let many = camera().prop_map(move |camera| {
        of(vec![Tensor::from_flat_fn([20_000, 3], motley), matrix(camera)])
    });
    let points = Tensor::full([2, 3], 0.5);
    let blind = Tensor::from_flat_fn([4, 4], |k| if k == 9 { f64::NAN } else { 0.0 });
    entry.check(
        Check::from_cases("project by a variable", bare)
            .large(1, many)
            .refuses(
                "project needs a camera matrix of shape [4, 4], got shape [3, 4]",
                of(vec![points.clone(), Tensor::zeros([3, 4])]),
            )
            .refuses(
                "a camera matrix needs finite entries, got NaN in row 2, column 1",
                of(vec![points, blind]),
            ),
    );
    let posed = (camera(), tensor([4, 3], number()), unit_quaternion(), tensor([3], number()));
    let posed = posed.prop_map(move |(camera, p, q, t)| {
        of(vec![p, Tensor::from(q.map(|entry| 1.3 * entry)), t, matrix(camera)])
    });
    entry.check(Check::from_cases("project by a variable, with a pose", posed));
}
