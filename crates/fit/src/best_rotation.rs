//! The rotation that brings one set of vectors closest to another.
//!
//! # Formula
//! The rotation R that minimizes `sum w |p - R r|^2` maximizes `tr(R M)`, with `M = sum w r p'`. Its
//! quaternion is the eigenvector of the largest eigenvalue of a symmetric 4 x 4 matrix N, whose entries are
//! sums of entries of M. So R is never a reflection, and vectors in a plane are no special case. Where
//! several rotations are equally good, R is one of them.
//!
//! Jacobi's method gives all four eigenpairs, of the values of numbers with a derivative. Then one step of
//! perturbation theory, `q = q_0 + sum_k q_k (q_k' N q_0) / (l_0 - l_k)`, gives q its derivative. Without a
//! derivative it adds nothing but rounding.
//!
//! # Source
//! Horn, *Closed-form solution of absolute orientation using unit quaternions*, Journal of the Optical
//! Society of America A 4(4), 1987.

use std::array::from_fn;

use bokashi_core::Scalar;

/// Rows of a 4 x 4 matrix.
type Square = [[f64; 4]; 4];

/// The most sweeps of Jacobi's method. Each squares the error, and five are enough in practice.
const SWEEPS: usize = 12;

/// The sum of squares off the diagonal, of a matrix about as large as 1, at which sweeps end. The step of
/// perturbation theory squares the error once more.
const SMALL: f64 = 1e-28;

/// The difference of eigenvalues, over the largest one, below which there is no derivative.
const CLOSEST: f64 = 1e-12;

/// The eigenvalues of a symmetric matrix, and their eigenvectors as rows.
fn eigenpairs(mut a: Square) -> ([f64; 4], Square) {
    let mut vectors: Square = from_fn(|i| from_fn(|j| f64::from(i == j)));
    for _ in 0..SWEEPS {
        let off: f64 = (0..4).map(|i| (0..i).map(|j| a[i][j] * a[i][j]).sum::<f64>()).sum();
        if off <= SMALL {
            break;
        }
        // Planes that share no axis come after each other, so that a processor works on two rotations at a time.
        for [p, q] in [[0, 1], [2, 3], [0, 2], [1, 3], [0, 3], [1, 2]] {
            if a[p][q] == 0.0 {
                continue;
            }
            // The rotation in the plane of p and q that makes this entry 0.
            let half = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
            let root = (half * half + 1.0).sqrt();
            let tangent = if half < 0.0 { -1.0 / (root - half) } else { 1.0 / (root + half) };
            let cosine = 1.0 / (tangent * tangent + 1.0).sqrt();
            let sine = tangent * cosine;
            let turn = |x: f64, y: f64| [cosine * x - sine * y, sine * x + cosine * y];
            for k in 0..4 {
                [a[k][p], a[k][q]] = turn(a[k][p], a[k][q]);
            }
            for k in 0..4 {
                [a[p][k], a[q][k]] = turn(a[p][k], a[q][k]);
                [vectors[p][k], vectors[q][k]] = turn(vectors[p][k], vectors[q][k]);
            }
            (a[p][q], a[q][p]) = (0.0, 0.0);
        }
    }
    (from_fn(|k| a[k][k]), vectors)
}

/// The rotation for `m = sum w r p'`, as rows. The identity for zeros; NaN where something is NaN.
pub(crate) fn best_rotation<S: Scalar>(m: [[S; 3]; 3]) -> [[S; 3]; 3] {
    let size = m.iter().flatten().fold(0.0, |size: f64, x| size.maximum_or_nan(x.to_f64().abs()));
    if size == 0.0 {
        return from_fn(|i| from_fn(|j| if i == j { S::ONE } else { S::ZERO }));
    }
    let unit = S::from_f64(size);
    let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = m.map(|row| row.map(|x| x / unit));
    let n = [
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, yy - xx - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ];
    let (values, vectors) = eigenpairs(n.map(|row| row.map(Scalar::to_f64)));
    let best = (1..4).fold(0, |best, k| if values[k] > values[best] { k } else { best });
    let largest = values.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
    let start = vectors[best].map(S::from_f64);
    let image: [S; 4] = from_fn(|i| (0..4).map(|j| n[i][j] * start[j]).sum());
    let mut q = start;
    for k in 0..4 {
        let gap = values[best] - values[k];
        if k != best && gap > CLOSEST * largest {
            let other = vectors[k].map(S::from_f64);
            let along: S = (0..4).map(|i| other[i] * image[i]).sum();
            let share = along / S::from_f64(gap);
            (0..4).for_each(|i| q[i] += share * other[i]);
        }
    }
    let square: S = q.iter().map(|&q| q * q).sum();
    let two = S::from_f64(2.0) / square;
    let [w, x, y, z] = q;
    let one = S::ONE;
    [
        [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
        [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
        [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use bokashi_core::Dual;

    type Matrix = [[f64; 3]; 3];

    fn product(a: Matrix, b: Matrix) -> Matrix {
        from_fn(|i| from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
    }

    fn transposed(a: Matrix) -> Matrix {
        from_fn(|i| from_fn(|j| a[j][i]))
    }

    fn trace(a: Matrix) -> f64 {
        a[0][0] + a[1][1] + a[2][2]
    }

    /// By Rodrigues' formula.
    fn rotation(axis: [f64; 3], angle: f64) -> Matrix {
        let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
        let [x, y, z] = axis.map(|x| x / length);
        let k = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
        let kk = product(k, k);
        from_fn(|i| {
            from_fn(|j| f64::from(i == j) + angle.sin() * k[i][j] + (1.0 - angle.cos()) * kk[i][j])
        })
    }

    fn assert_near(a: Matrix, b: Matrix, tolerance: f64) {
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            assert!((a - b).abs() <= tolerance, "{a} {b}");
        }
    }

    fn assert_rotation(r: Matrix) {
        assert_near(product(r, transposed(r)), rotation([1.0, 0.0, 0.0], 0.0), 1e-14);
        let [a, b, c] = r;
        let cross =
            [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]];
        assert!((0..3).map(|k| a[k] * cross[k]).sum::<f64>() > 0.0);
    }

    fn motley(seed: usize) -> Matrix {
        from_fn(|i| from_fn(|j| ((i * 37 + j * 53 + seed * 91) % 101) as f64 / 50.0 - 1.0))
    }

    #[test]
    fn a_turned_set_of_vectors_gives_its_rotation_whatever_its_rank_and_size() {
        // `sum w r r'` of vectors in space, in a plane, and nearly so.
        for stretch in [[3.0, 2.0, 1.0], [3.0, 2.0, 0.0], [1.0, 1.0, 1.0], [1.0, 1e-4, 1e-9]] {
            for scale in [1e-250, 1.0, 1e250] {
                for seed in 0..20 {
                    let own = rotation(motley(seed)[0], 0.3 * seed as f64);
                    let turn = rotation(motley(seed)[1], 0.31 * seed as f64);
                    let spread = from_fn(|i| from_fn(|j| if i == j { stretch[i] } else { 0.0 }));
                    let spread = product(product(own, spread), transposed(own));
                    let m = product(spread, transposed(turn));
                    let found = best_rotation(m.map(|row| row.map(|x| scale * x)));
                    assert_rotation(found);
                    let tolerance = if stretch[1] < 1e-3 { 1e-7 } else { 1e-14 };
                    assert_near(found, turn, tolerance);
                }
            }
        }
    }

    #[test]
    fn no_rotation_nearby_is_better_though_vectors_are_mirrored() {
        for seed in 0..50 {
            // Half of these have a negative determinant.
            let m = motley(seed);
            let best = best_rotation(m);
            assert_rotation(best);
            for (axis, angle) in [([1.0, 0.2, 0.3], 1e-3), ([0.1, 1.0, -0.3], -1e-3)] {
                let other = product(rotation(axis, angle), best);
                assert!(trace(product(other, m)) <= trace(product(best, m)) + 1e-15);
                let far = product(rotation(axis, 2.5), best);
                assert!(trace(product(far, m)) <= trace(product(best, m)));
            }
        }
    }

    #[test]
    fn a_derivative_is_that_of_difference_quotients() {
        for seed in 0..20 {
            let (m, along) = (motley(seed), motley(seed + 7));
            let dual = from_fn(|i| from_fn(|j| Dual::new(m[i][j], along[i][j])));
            let found = best_rotation(dual).map(|row| row.map(|x| x.tangent));
            let at =
                |h: f64| best_rotation::<f64>(from_fn(|i| from_fn(|j| m[i][j] + h * along[i][j])));
            let [more, less] = [at(1e-5), at(-1e-5)];
            let quotient = from_fn(|i| from_fn(|j| (more[i][j] - less[i][j]) / 2e-5));
            assert_near(found, quotient, 1e-6);
        }
    }

    #[test]
    fn nothing_turns_by_nothing_and_a_nan_stays_one() {
        let identity = rotation([1.0, 0.0, 0.0], 0.0);
        assert_near(best_rotation([[0.0; 3]; 3]), identity, 0.0);
        // A single vector: any rotation about it.
        let found = best_rotation([[0.0, 2.0, 0.0], [0.0; 3], [0.0; 3]]);
        assert_rotation(found);
        assert!((found[1][0] - 1.0).abs() < 1e-15);
        let mut lost = identity;
        lost[1][2] = f64::NAN;
        assert!(best_rotation(lost)[0][0].is_nan());
    }
}
