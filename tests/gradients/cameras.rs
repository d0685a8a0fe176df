//! Cameras on the tape keep the laws: matrices of intrinsics and poses, lenses, and what takes them.

use bokashi_check::strategy::{camera, non_zero, number, tensor, unit_quaternion};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, TensorError, Var};
use bokashi_render_ops::camera::{distortion_radius, fisheye_limit};
use bokashi_render_ops::{
    Pose, affine_inverse, distort, fisheye, orthographic, pinhole, project, project_instances,
    rigid, se3, transform_points,
};
use glam::DMat4;
use proptest::prelude::*;
use proptest::sample::select;

use crate::rendering::{check, leaf, wide};
use crate::scenes::{motley, size};

/// Four numbers from 0.1 up in size, as intrinsics.
fn intrinsics() -> impl Strategy<Value = Tensor<f64>> {
    [non_zero(), non_zero(), number(), number()].prop_map(Tensor::from)
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

#[test]
fn projections_by_intrinsics() {
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
        check(
            Check::of_cases(name, cases)
                .refuses("three intrinsics", of((0.1, 1.0), Tensor::full([3], 1.0)))
                .refuses("a scale of 0", of((0.1, 1.0), Tensor::zeros([4])))
                .refuses("planes in the wrong order", of((1.0, 0.1), Tensor::full([4], 1.0))),
        );
    }
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

#[test]
fn motions_by_quaternions_and_by_increments() {
    let turns = (unit_quaternion(), 0.5..2.0, tensor([3], number()));
    let turns = turns.prop_map(|(q, length, t)| {
        let rotation = Tensor::from(q.map(|entry| length * entry));
        Case::new(Motion { fixed: None }, [rotation, t].map(Input::leaf))
    });
    let of = |rotation, translation| {
        Case::new(Motion { fixed: None }, [leaf([rotation], 0.0), leaf([translation], 0.0)])
    };
    check(
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
    check(
        Check::of_cases("se3", increments)
            .refuses("five entries", of(leaf([5], 0.0)))
            .refuses("an increment that is not finite", of(leaf([6], f64::NAN))),
    );
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

#[derive(Debug, Clone, Copy)]
struct Affine;

impl Subject for Affine {
    /// The rows of an affine matrix; with points before it, which it moves.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(match *inputs {
            [points, rows] => transform_points(points, affine(rows)?)?.into(),
            _ => affine_inverse(affine(inputs[0])?)?.into(),
        })
    }
}

#[test]
fn affine_matrices_are_inverted_and_move_points() {
    let inverses = affine_rows().prop_map(|rows| Case::new(Affine, [Input::leaf(rows)]));
    check(
        Check::of_cases("affine_inverse", inverses)
            .refuses_midway("a singular matrix", Case::new(Affine, [leaf([3, 4], 1.0)]))
            .refuses_midway("five columns", Case::new(Affine, [leaf([3, 5], 1.0)])),
    );
    let moved = |points: Tensor<f64>, rows| Case::new(Affine, [points, rows].map(Input::leaf));
    let some = (tensor([5, 3], number()), affine_rows()).prop_map(move |(p, rows)| moved(p, rows));
    // More than a piece of points.
    let many =
        affine_rows().prop_map(move |rows| moved(Tensor::from_flat_fn([20_000, 3], motley), rows));
    let flat = Case::new(Affine, [leaf([5, 2], 0.5), leaf([3, 4], 1.0)]);
    check(
        Check::of_cases("transform_points", some)
            .large(1, many)
            .refuses_midway("points of two coordinates", flat),
    );
}

#[derive(Debug, Clone, Copy)]
struct Distort;

impl Subject for Distort {
    /// Points and coefficients.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let (points, coefficients) = (wide(inputs[0]), wide(inputs[1]));
        let out = distort(inputs[0], inputs[1])?;
        // What a lens of five lacks is 0.
        let all: [f64; 8] =
            std::array::from_fn(|k| coefficients.data().get(k).copied().unwrap_or_default());
        let rim = distortion_radius(all);
        let is_inside = |p: &[f64]| p[2] > 0.0 && p[0].hypot(p[1]) <= rim * p[2];
        let inside: Vec<_> = points.data().chunks(3).map(is_inside).collect();
        Ok(Outcome::from(out).with_state(inside).with_state(rim < 16.0))
    }
}

/// Coefficients of lenses whose polynomial turns round, and of lenses whose does not.
fn lenses() -> impl Strategy<Value = Tensor<f64>> {
    let turning = [-0.4..-0.1, -0.05..0.0, -0.01..0.01, -0.01..0.01, -0.01..-0.001];
    let growing = [0.01..0.3, 0.001..0.01, -0.01..0.01, -0.01..0.01, 1e-4..1e-3];
    prop_oneof![turning, growing].prop_map(Tensor::from)
}

/// The same with a denominator that stays above 0, and one that falls to 0 at about 2.
fn rational_lenses() -> impl Strategy<Value = Tensor<f64>> {
    let denominator =
        prop_oneof![[0.05..0.3, 0.01..0.05, 1e-3..1e-2], [-0.3..-0.2, -0.01..0.0, -1e-3..0.0],];
    (lenses(), denominator)
        .prop_map(|(five, rest)| Tensor::from([five.data(), &rest[..]].concat().as_slice()))
}

/// Within the rim, beside it, far outside, and behind the camera.
fn any_point() -> impl Strategy<Value = [f64; 3]> {
    let depth = prop_oneof![4 => 1.0..3.0, 1 => 0.05..0.2, 1 => -2.0..-0.1];
    ([-1.5..1.5, -1.5..1.5], depth).prop_map(|([x, y], z)| [x, y, z])
}

#[test]
fn distort_points_before_and_behind_a_lens() {
    let cases = (proptest::collection::vec(any_point(), 6), lenses()).prop_map(|(points, lens)| {
        Case::new(Distort, [Tensor::from(points), lens].map(Input::leaf))
    });
    let many = lenses().prop_map(|lens| {
        let point = |k: usize| if k % 3 == 2 { 1.0 + motley(k) } else { 2.0 * motley(k) - 1.0 };
        let points = Tensor::from_flat_fn([20_000, 3], point);
        Case::new(Distort, [points, lens].map(Input::leaf))
    });
    let of = |points, lens| Case::new(Distort, [points, lens]);
    let rational = (proptest::collection::vec(any_point(), 6), rational_lenses());
    let rational = rational.prop_map(|(points, lens)| {
        Case::new(Distort, [Tensor::from(points), lens].map(Input::leaf))
    });
    check(
        Check::of_cases("distort by a quotient", rational)
            .refuses("seven coefficients", of(leaf([2, 3], 1.0), leaf([7], 0.1))),
    );
    check(
        Check::of_cases("distort", cases)
            .large(1, many)
            .refuses("four coefficients", of(leaf([2, 3], 1.0), leaf([4], 0.1)))
            .refuses("points of four coordinates", of(leaf([2, 4], 1.0), leaf([5], 0.1))),
    );
}

#[derive(Debug, Clone, Copy)]
struct Fisheye;

impl Subject for Fisheye {
    /// Points and coefficients.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let (points, coefficients) = (wide(inputs[0]), wide(inputs[1]));
        let out = fisheye(inputs[0], inputs[1])?;
        let limit = fisheye_limit(std::array::from_fn(|k| coefficients.data()[k]));
        let is_inside = |p: &[f64]| p[0].hypot(p[1]).atan2(p[2]) <= limit;
        let inside: Vec<_> = points.data().chunks(3).map(is_inside).collect();
        Ok(Outcome::from(out).with_state(inside).with_state(limit < 2.6))
    }
}

#[test]
fn a_fisheye_shows_points_on_all_sides() {
    // Polynomials that turn round before 90 degrees, and those that go on to the widest angle.
    let turning = [-0.2..-0.1, -0.02..-0.01, -0.01..0.0, -0.003..-0.001];
    let growing = [0.01..0.1, -0.002..0.01, 1e-4..1e-3, 1e-5..1e-4];
    let lenses = || {
        prop_oneof![turning.clone().prop_map(Tensor::from), growing.clone().prop_map(Tensor::from)]
    };
    // Beside the axis, where series take over, too.
    let near = ([-1e-3..1e-3, -1e-3..1e-3], select(&[1.0, -1.0][..]));
    let near = near.prop_map(|([x, y], z)| [x, y, z]);
    let point = prop_oneof![4 => any_point(), 1 => near];
    let cases = (proptest::collection::vec(point, 6), lenses()).prop_map(|(points, lens)| {
        Case::new(Fisheye, [Tensor::from(points), lens].map(Input::leaf))
    });
    let many = lenses().prop_map(|lens| {
        let points = Tensor::from_flat_fn([20_000, 3], |k| 2.0 * motley(k) - 1.0);
        Case::new(Fisheye, [points, lens].map(Input::leaf))
    });
    let of = |points, lens| Case::new(Fisheye, [points, lens]);
    check(
        Check::of_cases("fisheye", cases)
            .large(1, many)
            .refuses("five coefficients", of(leaf([2, 3], 1.0), leaf([5], 0.1)))
            .refuses("points of four coordinates", of(leaf([2, 4], 1.0), leaf([4], 0.1))),
    );
}

#[derive(Debug, Clone, Copy)]
struct ProjectByVariable;

impl Subject for ProjectByVariable {
    /// Positions and a camera; or positions, a rotation, a translation and a camera.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(match *inputs {
            [positions, rotation, translation, camera] => {
                project(positions, camera, Some(Pose { rotation, translation }))?.into()
            }
            _ => project(inputs[0], inputs[1], None)?.into(),
        })
    }
}

#[test]
fn project_by_a_camera_that_is_learnt() {
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
    check(
        Check::of_cases("project by a variable", bare)
            .large(1, many)
            .refuses("a camera of three rows", of(vec![points.clone(), Tensor::zeros([3, 4])]))
            .refuses("a camera not finite", of(vec![points, Tensor::full([4, 4], f64::NAN)])),
    );
    let posed = (camera(), tensor([4, 3], number()), unit_quaternion(), tensor([3], number()));
    let posed = posed.prop_map(move |(camera, p, q, t)| {
        of(vec![p, Tensor::from(q.map(|entry| 1.3 * entry)), t, matrix(camera)])
    });
    check(Check::of_cases("project by a variable, with a pose", posed));
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

#[test]
fn instances_by_their_matrices() {
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
    check(
        Check::of_cases("project_instances", fixed)
            .large(2, many)
            .refuses("a matrix without an instance", refused([2, 3], [4, 4])),
    );
    check(
        Check::of_cases("project_instances by a variable", learnt)
            .refuses("points of two coordinates", refused([2, 2], [4, 4])),
    );
}
