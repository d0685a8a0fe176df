//! Projection of positions to clip space.
//!
//! # Forward
//! `clip_i = M (R p_i + t, 1)`, with the camera matrix `M: [4, 4]` (projection times view), and a
//! pose of rotation `R` (from a quaternion, see `rotation`) and translation `t`; without a pose
//! `R = 1` and `t = 0`. With `N` the first three columns of M and m its last: `clip_i = A p_i + b`,
//! `A = N R`, `b = N t + m`.
//!
//! # Backward
//! `p_bar_i = A^T clip_bar_i`; `A_bar = sum_i clip_bar_i p_i^T`, `b_bar = sum_i clip_bar_i`;
//! `R_bar = N^T A_bar`; `t_bar = N^T b_bar`; `N_bar = A_bar R^T + b_bar t^T`, `m_bar = b_bar`. It is
//! smooth everywhere.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020, where the projection is left to the user.

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};
use smallvec::SmallVec;

use crate::error::RenderError;
use crate::matrix::{self, Matrix4};
use crate::point_map::{add_points_bar, map_points, moments, sum};
use crate::projection::{CAMERA_RULE, Camera};
use crate::rotation::{self, Matrix3};

/// Where an object is: turned about its origin, then moved.
#[derive(Debug, Clone, Copy)]
pub struct Pose<'t, T: Scalar> {
    /// A quaternion (x, y, z, w), w the real part, of any length but 0. Shape `[4]`.
    pub rotation: Var<'t, T>,
    /// The translation, in units of world space. Shape `[3]`.
    pub translation: Var<'t, T>,
}

/// Positions `[V, 3]` in clip space `[V, 4]`: `camera` times the posed positions.
///
/// The camera is a fixed `&DMat4`, or a variable `[4, 4]`, which then has a gradient. It maps to OpenGL
/// clip space, visible where `w > 0` and `-w <= x, y, z <= w`:
/// [`camera::perspective`](crate::camera::perspective) times a view matrix, or
/// [`pinhole`](crate::pinhole()) times an OpenCV view matrix.
///
/// # Errors
/// - [`RenderError::Shape`] unless positions are `[V, 3]`, the rotation `[4]`, the translation `[3]`, and
///   a variable camera `[4, 4]`.
/// - [`RenderError::Camera`] for a matrix entry that is not finite.
/// - [`RenderError::Rotation`] for a quaternion that is zero or not finite.
pub fn project<'t, T: Scalar>(
    positions: Var<'t, T>,
    camera: impl Into<Camera<'t, T>>,
    pose: Option<Pose<'t, T>>,
) -> Result<Var<'t, T>, RenderError> {
    record(positions, camera.into(), pose)
}

/// [`project()`], compiled once.
#[inline(never)]
fn record<'t, T: Scalar>(
    positions: Var<'t, T>,
    camera: Camera<'t, T>,
    pose: Option<Pose<'t, T>>,
) -> Result<Var<'t, T>, RenderError> {
    let (fixed, variable) = (camera.fixed()?, camera.variable());
    let pose = pose.map(|Pose { rotation, translation }| [rotation, translation]);
    let op = Project { fixed, is_posed: pose.is_some() };
    let inputs = std::iter::once(positions).chain(pose.into_iter().flatten()).chain(variable);
    positions.tape().apply(op, &inputs.collect::<SmallVec<[_; 4]>>())
}

/// Inputs: positions `[V, 3]`, with a pose rotation `[4]` and translation `[3]`, and a variable camera
/// `[4, 4]`.
struct Project<S> {
    fixed: Option<Matrix4<S>>,
    is_posed: bool,
}

/// A, by rows.
fn linear<S: Scalar>(camera: &Matrix4<S>, rotation: Option<&Matrix3<S>>) -> [[S; 3]; 4] {
    camera.map(|[x, y, z, _]| match rotation {
        None => [x, y, z],
        Some(r) => std::array::from_fn(|k| x * r[0][k] + y * r[1][k] + z * r[2][k]),
    })
}

/// `[A b]`, by rows.
fn with_shift<S: Scalar>(a: [[S; 3]; 4], b: [S; 4]) -> Matrix4<S> {
    std::array::from_fn(|row| [a[row][0], a[row][1], a[row][2], b[row]])
}

/// N^T v for a vector of clip space.
fn transposed<S: Scalar>(camera: &Matrix4<S>, v: [S; 4]) -> [S; 3] {
    std::array::from_fn(|k| (0..4).map(|row| camera[row][k] * v[row]).sum())
}

/// The entries of a short vector with more digits.
fn widened<T: Scalar, const N: usize>(entries: &[T]) -> [T::Wide; N] {
    std::array::from_fn(|k| entries[k].widen())
}

impl<S> Project<S> {
    /// The input that is the camera, if it is a variable.
    fn camera_input(&self) -> Option<usize> {
        self.fixed.is_none().then_some(if self.is_posed { 3 } else { 1 })
    }
}

impl<T: Scalar> Op<T> for Project<T::Wide> {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "project"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        let pose = ["a rotation of shape [4]", "a translation of shape [3]"];
        let is_points = matches!(**inputs.shape(0), [_, 3]);
        if !is_points {
            return Err(refused("positions of shape [V, 3]", inputs, 0));
        }
        for (k, rule) in pose.into_iter().enumerate().filter(|_| self.is_posed) {
            if **inputs.shape(1 + k) != [4 - k] {
                return Err(refused(rule, inputs, 1 + k));
            }
        }
        let camera = match (self.fixed, self.camera_input()) {
            (Some(fixed), _) => fixed,
            (None, input) => {
                let input = input.expect("a camera is fixed or an input");
                if **inputs.shape(input) != [4, 4] {
                    return Err(refused(CAMERA_RULE, inputs, input));
                }
                matrix::check_finite(inputs.data(input))?;
                matrix::from_entries(inputs.data(input))
            }
        };
        let rotation =
            if self.is_posed { Some(rotation::checked_matrix(inputs.data(1))?) } else { None };
        let a = linear(&camera, rotation.as_ref());
        let t: [T::Wide; 3] =
            if self.is_posed { widened(inputs.data(2)) } else { Default::default() };
        let shift = camera.map(|[x, y, z, last]| x * t[0] + y * t[1] + z * t[2] + last);
        let clip = outputs.push([inputs.shape(0)[0], 4]);
        map_points(&with_shift(a, shift), inputs.data(0), clip);
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let needs_camera = self.camera_input().is_some_and(|input| inputs.needs(input));
        let needs_rotation = self.is_posed && inputs.needs(1);
        let needs_translation = self.is_posed && inputs.needs(2);
        let needs_either = needs_rotation || needs_camera;
        let keep = Keep::NOTHING
            .input_if(0, needs_either)
            .input_if(1, self.is_posed && (inputs.needs(0) || needs_either))
            .input_if(2, self.is_posed && needs_camera);
        match self.camera_input() {
            Some(input) if inputs.needs(0) || needs_rotation || needs_translation => {
                keep.input(input)
            }
            _ => keep,
        }
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let clip_bar = kept.only_upstream();
        let camera = || match (self.fixed, self.camera_input()) {
            (Some(fixed), _) => fixed,
            (None, input) => matrix::from_entries(kept.input(input.expect("an input"))),
        };
        let rotation = || self.is_posed.then(|| rotation::matrix(widened(kept.input(1))));
        if let Some(positions_bar) = gradients.get(0) {
            let a = linear(&camera(), rotation().as_ref());
            // The shift does not count here.
            add_points_bar(&with_shift(a, [T::Wide::ZERO; 4]), clip_bar, positions_bar);
        }
        let needs_rotation = self.is_posed && gradients.needs(1);
        let needs_camera = self.camera_input().is_some_and(|input| gradients.needs(input));
        if !needs_rotation && !needs_camera {
            if self.is_posed && gradients.needs(2) {
                add_translation_bar(gradients, &camera(), sum(clip_bar));
            }
            return;
        }
        let sums = moments::<T, 4>(kept.input(0), clip_bar);
        let b_bar = sums.map(|[.., b_bar]| b_bar);
        if needs_rotation && let Some(rotation_bar) = gradients.get(1) {
            let r_bar: Matrix3<T::Wide> = {
                let camera = camera();
                let columns: [[T::Wide; 3]; 3] =
                    std::array::from_fn(|k| transposed(&camera, sums.map(|row| row[k])));
                std::array::from_fn(|i| std::array::from_fn(|k| columns[k][i]))
            };
            let q_bar = rotation::pull_back(widened(kept.input(1)), r_bar);
            rotation_bar.add_each(|k| T::narrow(q_bar[k]));
        }
        if self.is_posed && gradients.needs(2) {
            add_translation_bar(gradients, &camera(), b_bar);
        }
        let Some(camera_bar) = self.camera_input().and_then(|input| gradients.get(input)) else {
            return;
        };
        let rows = match rotation() {
            None => sums,
            Some(r) => {
                let t: [T::Wide; 3] = widened(kept.input(2));
                sums.map(|[x, y, z, b]| {
                    let [x, y, z] =
                        std::array::from_fn(|k| x * r[k][0] + y * r[k][1] + z * r[k][2] + b * t[k]);
                    [x, y, z, b]
                })
            }
        };
        camera_bar.add_each(|k| T::narrow(rows[k / 4][k % 4]));
    }
}

/// Adds `N^T b_bar` to the gradient of the translation.
fn add_translation_bar<T: Scalar>(
    gradients: &mut Accumulators<'_, T>,
    camera: &Matrix4<T::Wide>,
    b_bar: [T::Wide; 4],
) {
    let Some(translation_bar) = gradients.get(2) else { return };
    let t_bar = transposed(camera, b_bar);
    translation_bar.add_each(|k| T::narrow(t_bar[k]));
}

fn refused<T: Scalar>(rule: &'static str, inputs: &Inputs<'_, T>, input: usize) -> RenderError {
    RenderError::shape("project", rule, inputs.shape(input))
}
