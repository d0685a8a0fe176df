//! Rotations by quaternions.
//!
//! # Forward
//! `R(q / |q|)`, with `q = (x, y, z, w)` in glam's order, w the real part. Normalizing inside makes
//! every quaternion but zero a rotation, so that a plain gradient step cannot leave the rotations.
//!
//! # Backward
//! From `R_bar` by the partials of the entries of R, then through the normalization, which removes
//! the component along q: `q_bar = (g - (g . n) n) / |q|` with `n = q / |q|`.

use bokashi_core::Scalar;

use crate::error::RenderError;

/// A 3x3 matrix, by rows.
pub(crate) type Matrix3<S> = [[S; 3]; 3];

/// The length of `q`, of any size that a number can have.
pub(crate) fn length<S: Scalar>(q: [S; 4]) -> S {
    let largest = q.into_iter().map(S::abs).fold(S::ZERO, S::maximum_or_nan);
    if largest == S::ZERO || !largest.is_finite() {
        return largest;
    }
    let squares = q.into_iter().map(|entry| (entry / largest) * (entry / largest));
    largest * squares.sum::<S>().sqrt()
}

/// The rotation matrix of `q`, which need not have length 1.
pub(crate) fn matrix<S: Scalar>(q: [S; 4]) -> Matrix3<S> {
    let [x, y, z, w] = normalized(q);
    let one = S::ONE;
    let two = one + one;
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

/// The rotation matrix of the four entries of a quaternion, with more digits.
///
/// # Errors
/// [`RenderError::Rotation`] for a quaternion that is zero or not finite.
pub(crate) fn checked_matrix<T: Scalar>(q: &[T]) -> Result<Matrix3<T::Wide>, RenderError> {
    let wide: [T::Wide; 4] = std::array::from_fn(|k| q[k].widen());
    let length = length(wide).to_f64();
    if length > 0.0 && length.is_finite() {
        return Ok(matrix(wide));
    }
    let [x, y, z, w] = std::array::from_fn(|k| q[k].to_f64());
    Err(RenderError::Rotation { x, y, z, w })
}

/// The gradient with respect to `q` from the gradient `r_bar` with respect to its matrix.
pub(crate) fn pull_back<S: Scalar>(q: [S; 4], r_bar: Matrix3<S>) -> [S; 4] {
    let n = normalized(q);
    let [x, y, z, w] = n;
    let two = S::ONE + S::ONE;
    let symmetric = |i: usize, j: usize| r_bar[i][j] + r_bar[j][i];
    let skew = |i: usize, j: usize| r_bar[i][j] - r_bar[j][i];
    let diagonal = |i: usize, j: usize| two * (r_bar[i][i] + r_bar[j][j]);
    let g = [
        y * symmetric(0, 1) + z * symmetric(0, 2) + w * skew(2, 1) - x * diagonal(1, 2),
        x * symmetric(0, 1) + z * symmetric(1, 2) + w * skew(0, 2) - y * diagonal(0, 2),
        x * symmetric(0, 2) + y * symmetric(1, 2) + w * skew(1, 0) - z * diagonal(0, 1),
        x * skew(2, 1) + y * skew(0, 2) + z * skew(1, 0),
    ]
    .map(|entry| two * entry);
    let along: S = g.iter().zip(n).map(|(&g, n)| g * n).sum();
    let length = length(q);
    std::array::from_fn(|k| (g[k] - along * n[k]) / length)
}

fn normalized<S: Scalar>(q: [S; 4]) -> [S; 4] {
    let length = length(q);
    q.map(|entry| entry / length)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    const Q: [f64; 4] = [0.3, -0.7, 0.2, 1.1];

    #[test]
    fn the_matrix_is_glams_for_a_unit_quaternion() {
        let unit = glam::DQuat::from_array(Q).normalize();
        let expected = glam::DMat3::from_quat(unit).transpose().to_cols_array_2d();
        for (row, expected) in matrix(Q).iter().zip(expected) {
            for (entry, expected) in row.iter().zip(expected) {
                assert_relative_eq!(*entry, expected, epsilon = 1e-15);
            }
        }
    }

    #[test]
    fn the_smallest_and_the_largest_quaternions_are_rotations_too() {
        for scale in [1e-300, 1e300] {
            for (row, expected) in matrix(Q.map(|entry| entry * scale)).iter().zip(matrix(Q)) {
                for (entry, expected) in row.iter().zip(expected) {
                    assert_relative_eq!(*entry, expected, epsilon = 1e-14);
                }
            }
        }
    }

    #[test]
    fn the_gradient_is_orthogonal_to_the_quaternion() {
        let r_bar = [[0.2, -1.0, 0.5], [0.7, 0.3, -0.4], [1.5, -0.6, 0.1]];
        let gradient = pull_back(Q, r_bar);
        let along: f64 = gradient.iter().zip(Q).map(|(g, q)| g * q).sum();
        assert_relative_eq!(along, 0.0, epsilon = 1e-14);
    }
}
