//! The exponential of a small motion, before a fixed matrix.
//!
//! # Forward
//! `M = exp(xi^) T` with `xi = (rho, phi)`: three entries for the translation, then three for the
//! rotation, an axis times an angle in radians. `exp(xi^) = [R J rho; 0 1]`, with `K = [phi]_x`,
//! `s = |phi|^2`, and Stumpff's functions `c_k(s)`:
//!
//! `R = 1 + c_1 K + c_2 K^2`, `J = 1 + c_2 K + c_3 K^2`.
//!
//! # Backward
//! `E_bar = M_bar T^T` has `R_bar` and `t_bar`; `J_bar = t_bar rho^T`, `rho_bar = J^T t_bar`. For any G let
//! `g = (G_21 - G_12, G_02 - G_20, G_10 - G_01)`, and `q(G) = phi^T G phi - s tr G`. Then `<G, K> = g . phi`
//! and `<G, K^2> = q(G)`, so with r of `R_bar` and j of `J_bar`
//!
//! `phi_bar = c_1 r + c_2 (dq(R_bar) + j) + c_3 dq(J_bar) + 2 phi (c_1' r . phi + c_2' (q(R_bar) + j . phi)
//! + c_3' q(J_bar))`,
//!
//! with `dq(G) = (G + G^T) phi - 2 phi tr G`. It is smooth everywhere, at angle 0 too.
//!
//! # Source
//! Barfoot, *State Estimation for Robotics*, 2017, section 7.1; `stumpff` has the coefficients.

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Var};
use glam::DMat4;

use super::stumpff::{slopes, stumpff};
use crate::error::RenderError;
use crate::matrix::{self, Matrix4};
use crate::projection;
use crate::rotation::Matrix3;

const NAME: &str = "se3";

/// Squared angles beyond its square would leave the range of the numbers.
const LARGEST: f64 = 1e50;

/// `exp(increment^) fixed`, of shape `[4, 4]`: the update of a pose that bundle adjustment learns.
///
/// `increment: [6]` has the translation first, in units of the scene, then the rotation, an axis times an
/// angle in radians. It multiplies from the left. So on a view, world to camera, it moves in the camera's
/// frame, and on a camera's pose, camera to world, in the world's. At 0 the result is `fixed`, and the
/// gradient is as smooth as elsewhere: a fit starts there, and no pose is singular. For a pose on the tape
/// take the identity as `fixed`, and `matmul`.
///
/// # Errors
/// - [`RenderError::Shape`] unless the increment is `[6]`.
/// - `TensorError::Value` for an increment that is not finite, or beyond 1e50.
/// - [`RenderError::Camera`] for an entry of `fixed`, or of the result, that is not finite.
#[inline(never)]
pub fn se3<'t, T: Scalar>(increment: Var<'t, T>, fixed: &DMat4) -> Result<Var<'t, T>, RenderError> {
    let fixed = projection::rows::<T::Wide>(fixed)?;
    increment.tape().apply(Se3 { fixed }, &[increment])
}

/// Input: an increment `[6]`. Output: a matrix `[4, 4]`.
struct Se3<S> {
    fixed: Matrix4<S>,
}

/// The two halves of an increment.
fn halves<T: Scalar>(increment: &[T]) -> [[T::Wide; 3]; 2] {
    [0, 3].map(|first| std::array::from_fn(|k| increment[first + k].widen()))
}

fn dot<S: Scalar>(a: [S; 3], b: [S; 3]) -> S {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `one + a K + b K^2`, with `K^2 = phi phi^T - s`.
fn polynomial<S: Scalar>(phi: [S; 3], a: S, b: S) -> Matrix3<S> {
    let [x, y, z] = phi;
    let k = [[S::ZERO, -z, y], [z, S::ZERO, -x], [-y, x, S::ZERO]];
    // The squares that are left of the diagonal, without a difference.
    let squares = [y * y + z * z, x * x + z * z, x * x + y * y];
    std::array::from_fn(|i| {
        std::array::from_fn(|j| match i == j {
            true => S::ONE - b * squares[i],
            false => a * k[i][j] + b * (phi[i] * phi[j]),
        })
    })
}

impl<T: Scalar> Op<T> for Se3<T::Wide> {
    type Saved = ();
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), RenderError> {
        if **inputs.shape(0) != [6] {
            let rule = "an increment of shape [6]";
            return Err(RenderError::shape(NAME, rule, inputs.shape(0)));
        }
        let increment = inputs.data(0);
        if let Some(lost) =
            increment.iter().find(|entry| !(-LARGEST..=LARGEST).contains(&entry.to_f64()))
        {
            let rule = "an increment within -1e50 and 1e50";
            return Err(RenderError::value(NAME, rule, lost.to_f64()));
        }
        let [rho, phi] = halves(increment);
        let [c1, c2, c3, ..] = stumpff(dot(phi, phi));
        let (r, j) = (polynomial(phi, c1, c2), polynomial(phi, c2, c3));
        let last = [T::Wide::ZERO, T::Wide::ZERO, T::Wide::ZERO, T::Wide::ONE];
        let mut exponential = [last; 4];
        for (row, (r, j)) in r.into_iter().zip(j).enumerate() {
            exponential[row] = [r[0], r[1], r[2], dot(j, rho)];
        }
        let entries = outputs.push([4, 4]);
        matrix::write(&matrix::product(&exponential, &self.fixed), entries);
        matrix::check_finite(entries)
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(increment_bar) = gradients.get(0) else { return };
        let [rho, phi] = halves(kept.input(0));
        let m_bar = matrix::from_entries(kept.only_upstream());
        let e_bar = matrix::product_transposed(&m_bar, &self.fixed);
        let r_bar: Matrix3<T::Wide> = std::array::from_fn(|i| std::array::from_fn(|k| e_bar[i][k]));
        let t_bar: [T::Wide; 3] = std::array::from_fn(|i| e_bar[i][3]);
        let c = stumpff(dot(phi, phi));
        let [d1, d2, d3] = slopes(&c);
        let j = polynomial(phi, c[1], c[2]);
        let rho_bar: [T::Wide; 3] =
            std::array::from_fn(|k| (0..3).map(|i| j[i][k] * t_bar[i]).sum());
        let j_bar = t_bar.map(|t_bar| rho.map(|rho| t_bar * rho));
        let (of_r, of_j) = (Pulled::new(&r_bar, phi), Pulled::new(&j_bar, phi));
        let two = T::Wide::from_f64(2.0);
        let along = d1 * dot(of_r.linear, phi)
            + d2 * (of_r.square + dot(of_j.linear, phi))
            + d3 * of_j.square;
        let phi_bar: [T::Wide; 3] = std::array::from_fn(|k| {
            c[0] * of_r.linear[k]
                + c[1] * (of_r.by_phi[k] + of_j.linear[k])
                + c[2] * of_j.by_phi[k]
                + two * phi[k] * along
        });
        increment_bar.add_each(|k| T::narrow(if k < 3 { rho_bar[k] } else { phi_bar[k - 3] }));
    }
}

/// What a matrix G says of K and of K^2.
struct Pulled<S> {
    /// g.
    linear: [S; 3],
    /// q(G).
    square: S,
    /// dq(G).
    by_phi: [S; 3],
}

impl<S: Scalar> Pulled<S> {
    fn new(g: &Matrix3<S>, phi: [S; 3]) -> Self {
        // Without the trace's own terms, whose difference would cancel: sum_(i != j) G_ij phi_i phi_j
        // - sum_i G_ii (s - phi_i^2).
        let off = |i: usize, j: usize| g[i][j] + g[j][i];
        let others = |i: usize| g[(i + 1) % 3][(i + 1) % 3] + g[(i + 2) % 3][(i + 2) % 3];
        let by_phi: [S; 3] = std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            off(i, j) * phi[j] + off(i, k) * phi[k] - (others(i) + others(i)) * phi[i]
        });
        Self {
            linear: [g[2][1] - g[1][2], g[0][2] - g[2][0], g[1][0] - g[0][1]],
            // It is of second degree.
            square: S::from_f64(0.5) * dot(by_phi, phi),
            by_phi,
        }
    }
}
