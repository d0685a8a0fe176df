//! Projection of positions to clip space.
//!
//! # Forward
//! `clip_i = M (R p_i + t, 1)`, with the camera matrix `M: [4, 4]` (projection times view), and a
//! pose of rotation `R` (from a quaternion, see `rotation`) and translation `t`; without a pose
//! `R = 1` and `t = 0`. With `N` the first three columns of M and m its last: `clip_i = A p_i + b`,
//! `A = N R`, `b = N t + m`.
//!
//! # Backward
//! `p_bar_i = A^T clip_bar_i`; `A_bar = sum_i clip_bar_i p_i^T`, `R_bar = N^T A_bar`;
//! `t_bar = N^T sum_i clip_bar_i`. It is smooth everywhere.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020, where the projection is left to the user.

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};
use glam::DMat4;

use crate::error::RenderError;
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
/// The camera matrix maps to OpenGL clip space: visible where `w > 0` and `-w <= x, y, z <= w`
/// (`glam::dcamera::rh::proj::opengl::perspective` times a view matrix).
///
/// # Errors
/// [`RenderError::Shape`] unless positions are `[V, 3]`, the rotation `[4]` and the translation
/// `[3]`; [`RenderError::Camera`] for a matrix entry that is not finite;
/// [`RenderError::Rotation`] for a quaternion that is zero or not finite.
#[inline(never)]
pub fn project<'t, T: Scalar>(
    positions: Var<'t, T>,
    camera: &DMat4,
    pose: Option<Pose<'t, T>>,
) -> Result<Var<'t, T>, RenderError> {
    let columns = camera.to_cols_array_2d();
    for (column, entries) in columns.iter().enumerate() {
        if let Some(row) = entries.iter().position(|entry| !entry.is_finite()) {
            return Err(RenderError::Camera { row, column, value: entries[row] });
        }
    }
    let camera =
        std::array::from_fn(|row| std::array::from_fn(|k| T::Wide::from_f64(columns[k][row])));
    let op = Project { camera };
    match pose {
        None => positions.tape().apply(op, &[positions]),
        Some(Pose { rotation, translation }) => {
            positions.tape().apply(op, &[positions, rotation, translation])
        }
    }
}

/// Vertices in one piece of work.
const ROWS_PER_PIECE: usize = 1 << 13;

/// Inputs: positions `[V, 3]`, and with a pose rotation `[4]` and translation `[3]`.
struct Project<S> {
    /// By rows.
    camera: [[S; 4]; 4],
}

impl<S: Scalar<Wide = S>> Project<S> {
    /// A, by rows.
    fn linear(&self, rotation: Option<&[impl Scalar<Wide = S>]>) -> [[S; 3]; 4] {
        let rotation = rotation.map(|q| rotation::matrix(widened(q)));
        self.camera.map(|[x, y, z, _]| match rotation {
            None => [x, y, z],
            Some(r) => std::array::from_fn(|k| x * r[0][k] + y * r[1][k] + z * r[2][k]),
        })
    }

    /// N^T v for a vector of clip space.
    fn transposed(&self, v: [S; 4]) -> [S; 3] {
        std::array::from_fn(|k| (0..4).map(|row| self.camera[row][k] * v[row]).sum())
    }
}

/// The entries of a short vector with more digits.
fn widened<T: Scalar, const N: usize>(entries: &[T]) -> [T::Wide; N] {
    std::array::from_fn(|k| entries[k].widen())
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
        let rules: [(&str, &[usize]); 3] = [
            ("positions of shape [V, 3]", &[3]),
            ("a rotation of shape [4]", &[4]),
            ("a translation of shape [3]", &[3]),
        ];
        for (i, (rule, trailing)) in rules.into_iter().enumerate().take(inputs.len()) {
            let shape = inputs.shape(i);
            let leading = if i == 0 { shape.rank() == 2 } else { shape.rank() == 1 };
            if !leading || !shape.ends_with(trailing) {
                return Err(RenderError::Shape {
                    operation: "project",
                    rule: rule.to_owned(),
                    shape: shape.clone(),
                });
            }
        }
        let posed = inputs.len() == 3;
        if posed {
            let q = inputs.data(1);
            let length = rotation::length(widened::<T, 4>(q)).to_f64();
            if !(length > 0.0 && length.is_finite()) {
                let [x, y, z, w] = std::array::from_fn(|k| q[k].to_f64());
                return Err(RenderError::Rotation { x, y, z, w });
            }
        }
        let a = self.linear(posed.then(|| inputs.data(1)));
        let t: [T::Wide; 3] = if posed { widened(inputs.data(2)) } else { Default::default() };
        let b = self.camera.map(|[x, y, z, last]| x * t[0] + y * t[1] + z * t[2] + last);
        let (positions, clip) = (inputs.data(0), outputs.push([inputs.shape(0)[0], 4]));
        for_each_piece_mut(clip, 4 * ROWS_PER_PIECE, |piece, clip| {
            let positions = &positions.as_chunks::<3>().0[piece * ROWS_PER_PIECE..];
            pulp::Arch::new().dispatch(
                #[inline(always)]
                || {
                    for (p, clip) in positions.iter().zip(clip.as_chunks_mut::<4>().0) {
                        let p = p.map(T::widen);
                        *clip = [0, 1, 2, 3].map(|row| {
                            let a = a[row];
                            T::narrow(a[0] * p[0] + a[1] * p[1] + a[2] * p[2] + b[row])
                        });
                    }
                },
            );
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let mut keep = Keep::NOTHING;
        if inputs.len() == 3 {
            if inputs.needs(0) || inputs.needs(1) {
                keep = keep.input(1);
            }
            if inputs.needs(1) {
                keep = keep.input(0);
            }
        }
        keep
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let clip_bar = kept.only_upstream();
        let posed = kept.input_count() == 3;
        if let Some(positions_bar) = gradients.get(0) {
            let a = self.linear(posed.then(|| kept.input(1)));
            let entries = positions_bar.entries();
            for_each_piece_mut(entries, 3 * ROWS_PER_PIECE, |piece, entries| {
                let rows = &clip_bar.as_chunks::<4>().0[piece * ROWS_PER_PIECE..];
                pulp::Arch::new().dispatch(
                    #[inline(always)]
                    || {
                        for (p_bar, clip_bar) in entries.as_chunks_mut::<3>().0.iter_mut().zip(rows)
                        {
                            let [x, y, z, w] = clip_bar.map(T::widen);
                            for k in 0..3 {
                                let sum = a[0][k] * x + a[1][k] * y + a[2][k] * z + a[3][k] * w;
                                p_bar[k] += T::narrow(sum);
                            }
                        }
                    },
                );
            });
        }
        if !posed {
            return;
        }
        if let Some(rotation_bar) = gradients.get(1) {
            let mut a_bar = [[T::Wide::ZERO; 3]; 4];
            let positions = kept.input(0).chunks_exact(3);
            for (p, clip_bar) in positions.zip(clip_bar.chunks_exact(4)) {
                for (row, &clip_bar) in a_bar.iter_mut().zip(clip_bar) {
                    row.iter_mut().zip(p).for_each(|(a, &p)| *a += clip_bar.widen() * p.widen());
                }
            }
            let r_bar: Matrix3<T::Wide> = {
                let columns: [[T::Wide; 3]; 3] =
                    std::array::from_fn(|k| self.transposed(a_bar.map(|row| row[k])));
                std::array::from_fn(|i| std::array::from_fn(|k| columns[k][i]))
            };
            let q_bar = rotation::pull_back(widened(kept.input(1)), r_bar);
            rotation_bar.add_each(|k| T::narrow(q_bar[k]));
        }
        if let Some(translation_bar) = gradients.get(2) {
            let mut b_bar = [T::Wide::ZERO; 4];
            for clip_bar in clip_bar.chunks_exact(4) {
                b_bar.iter_mut().zip(clip_bar).for_each(|(b, &clip)| *b += clip.widen());
            }
            let t_bar = self.transposed(b_bar);
            translation_bar.add_each(|k| T::narrow(t_bar[k]));
        }
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};
    use glam::DVec3;
    use glam::dcamera::rh::proj::opengl::perspective;
    use glam::dcamera::rh::view::look_at_mat4;

    use super::*;

    #[test]
    fn without_a_pose_it_is_the_matrix_product() {
        let camera = perspective(1.0, 1.5, 0.1, 10.0)
            * look_at_mat4(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Y);
        let tape = Tape::<f64>::new();
        let p = tape.leaf(&Tensor::new([1, 3], vec![0.3, -0.2, 0.5]).unwrap());
        let clip = project(p, &camera, None).unwrap().value();
        let expected = camera * glam::DVec4::new(0.3, -0.2, 0.5, 1.0);
        for (k, &entry) in clip.data().iter().enumerate() {
            approx::assert_relative_eq!(entry, expected[k], max_relative = 1e-14);
        }
    }

    #[test]
    fn the_length_of_the_quaternion_does_not_matter() {
        let tape = Tape::<f64>::new();
        let p = tape.leaf(&Tensor::new([1, 3], vec![0.3, -0.2, 0.5]).unwrap());
        let translation = tape.leaf(&Tensor::new([3], vec![0.1, 0.2, -3.0]).unwrap());
        let clip = |length: f64| {
            let q = [0.1, 0.7, -0.5, 0.5].map(|entry| entry * length);
            let rotation = tape.leaf(&Tensor::new([4], q.to_vec()).unwrap());
            project(p, &DMat4::IDENTITY, Some(Pose { rotation, translation })).unwrap().value()
        };
        for (one, other) in clip(1.0).data().iter().zip(clip(4.0).data()) {
            approx::assert_relative_eq!(one, other, max_relative = 1e-14);
        }
    }

    /// A camera none of whose entries is zero.
    fn any_camera() -> DMat4 {
        let turned = look_at_mat4(DVec3::new(1.0, 2.0, 3.0), DVec3::new(0.2, -0.1, 0.3), DVec3::Y);
        DMat4::from_cols_array(&std::array::from_fn(|k| 0.1 + 0.03 * k as f64)) + turned
    }

    const POSITIONS: [f64; 9] = [0.3, -0.2, 0.5, -0.7, 0.1, 0.9, 0.4, 0.8, -0.6];

    #[test]
    fn a_pose_is_the_matrix_product_with_a_rotation_and_a_translation() {
        let q = [0.1, 0.7, -0.5, 0.3];
        let turn = glam::DQuat::from_array(q).normalize();
        let matrix =
            any_camera() * DMat4::from_rotation_translation(turn, DVec3::new(0.4, -0.6, 1.5));
        let tape = Tape::<f64>::new();
        let positions = tape.leaf(&Tensor::new([3, 3], POSITIONS.to_vec()).unwrap());
        let rotation = tape.leaf(&Tensor::new([4], q.to_vec()).unwrap());
        let translation = tape.leaf(&Tensor::new([3], vec![0.4, -0.6, 1.5]).unwrap());
        let clip = project(positions, &any_camera(), Some(Pose { rotation, translation })).unwrap();
        for (p, clip) in POSITIONS.chunks(3).zip(clip.value().data().chunks(4)) {
            let expected = matrix * DVec3::from_slice(p).extend(1.0);
            for k in 0..4 {
                approx::assert_relative_eq!(clip[k], expected[k], epsilon = 1e-14);
            }
        }
    }

    #[test]
    fn the_gradients_are_difference_quotients_whichever_are_asked_for() {
        let inputs = [POSITIONS.to_vec(), vec![0.1, 0.7, -0.5, 0.3], vec![0.4, -0.6, 1.5]];
        let shapes: [&[usize]; 3] = [&[3, 3], &[4], &[3]];
        let upstream = Tensor::from_flat_fn([3, 4], |k| (k as f64 + 1.0) / (2.0 * k as f64 - 5.0));
        let value = |inputs: &[Vec<f64>; 3]| -> f64 {
            let tape = Tape::<f64>::new();
            let [positions, rotation, translation] = std::array::from_fn(|i| {
                tape.leaf(&Tensor::new(shapes[i], inputs[i].clone()).unwrap())
            });
            let clip =
                project(positions, &any_camera(), Some(Pose { rotation, translation })).unwrap();
            clip.value().data().iter().zip(upstream.data()).map(|(c, u)| c * u).sum()
        };
        // Every choice of inputs that have a gradient.
        for mask in 1..8 {
            let tape = Tape::<f64>::new();
            let needs = |i: usize| mask >> i & 1 == 1;
            let variables: [Var<'_, f64>; 3] = std::array::from_fn(|i| {
                let tensor = Tensor::new(shapes[i], inputs[i].clone()).unwrap();
                if needs(i) { tape.leaf(&tensor) } else { tape.constant(&tensor) }
            });
            let [positions, rotation, translation] = variables;
            let clip =
                project(positions, &any_camera(), Some(Pose { rotation, translation })).unwrap();
            let gradients = tape.vjp(&[(clip, &upstream)]).unwrap();
            for i in 0..3 {
                let Some(gradient) = gradients.get(variables[i]) else {
                    assert!(!needs(i));
                    continue;
                };
                for (k, &entry) in gradient.data().iter().enumerate() {
                    let moved = |h: f64| {
                        let mut inputs = inputs.clone();
                        inputs[i][k] += h;
                        value(&inputs)
                    };
                    let quotient = (moved(1e-5) - moved(-1e-5)) / 2e-5;
                    approx::assert_relative_eq!(
                        entry,
                        quotient,
                        max_relative = 1e-8,
                        epsilon = 1e-8
                    );
                }
            }
        }
    }

    #[test]
    fn without_positions_clip_space_is_empty() {
        let tape = Tape::<f32>::new();
        let none = tape.leaf(&Tensor::zeros([0, 3]));
        let clip = project(none, &DMat4::IDENTITY, None).unwrap();
        assert_eq!(clip.shape(), [0, 4].into());
    }

    #[test]
    fn wrong_input_is_refused_with_rule_and_value() {
        let tape = Tape::<f32>::new();
        let p = tape.leaf(&Tensor::zeros([2, 3]));
        let flat = tape.leaf(&Tensor::zeros([6]));
        let error = project(flat, &DMat4::IDENTITY, None).unwrap_err();
        assert_eq!(error.to_string(), "project needs positions of shape [V, 3], got shape [6]");

        let pose = Pose {
            rotation: tape.leaf(&Tensor::zeros([4])),
            translation: tape.leaf(&Tensor::zeros([3])),
        };
        let error = project(p, &DMat4::IDENTITY, Some(pose)).unwrap_err();
        assert_eq!(
            error.to_string(),
            "a rotation needs a finite quaternion other than zero, got (0, 0, 0, 0)"
        );

        let pose = |rotation: usize, translation: usize| Pose {
            rotation: tape.leaf(&Tensor::full([rotation], 0.5)),
            translation: tape.leaf(&Tensor::zeros([translation])),
        };
        let error = project(p, &DMat4::IDENTITY, Some(pose(3, 3))).unwrap_err();
        assert_eq!(error.to_string(), "project needs a rotation of shape [4], got shape [3]");
        let error = project(p, &DMat4::IDENTITY, Some(pose(4, 4))).unwrap_err();
        assert_eq!(error.to_string(), "project needs a translation of shape [3], got shape [4]");

        let mut camera = DMat4::IDENTITY;
        camera.col_mut(2).y = f64::NAN;
        let error = project(p, &camera, None).unwrap_err();
        assert!(matches!(error, RenderError::Camera { row: 1, column: 2, .. }));
    }
}
