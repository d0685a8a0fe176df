//! Normals of a surface that a matrix transforms.
//!
//! # Forward
//! `y = v / |v|`, `v = C n`, with the cofactor matrix C of the linear part A of the matrix. Its rows are
//! `a_1 x a_2`, `a_2 x a_0`, `a_0 x a_1`, with the rows `a_i` of A. As `(A p) x (A q) = C (p x q)`, these
//! are the normals of the transformed faces. `C = det(A) A^-T`: where A has an inverse this is its
//! transpose, up to a factor that normalizing removes, but for its sign. A singular matrix has
//! cofactors, too.
//!
//! # Backward
//! `v_bar = (y_bar - y (y . y_bar)) / |v|`, `n_bar = C^T v_bar`, `C_bar = sum v_bar n^T`, and
//! `a_bar_0 = c_bar_1 x a_2 + a_1 x c_bar_2` with the rows `c_bar` of `C_bar`, and so on in turn.
//!
//! # Where it is not smooth
//! Where v is no longer than a bound on its rounding error, y is zero and gives no gradient: for a
//! normal of 0, and where a singular matrix flattens the surface to a line.
//!
//! # Scale
//! Matrix and normals are multiplied by powers of two that bring their largest entries near 1: neither
//! a factor of the matrix nor the length of a normal matters.
//!
//! # Loops
//! Of its own: with those of `row_map` it takes 1.4 times as long.
//!
//! # Source
//! Turkowski, *Properties of surface-normal transformations*, Graphics Gems, 1990.

use bokashi_core::parallel::{for_each_piece_mut, merge_ranges_into};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Shape, Var};

use crate::error::RenderError;
use crate::vector::{
    Direction, ROUNDING, Vector3, cross, dot, larger, largest, power_of_two_to_1, scaled, sum,
};

/// Normals in one piece of work.
const ROWS_PER_PIECE: usize = 1 << 12;

/// `normals: [.., 3]` of any length, transformed by `matrix: [4, 4]` or `[3, 3]`; unit vectors of the
/// same shape. The matrix acts on columns, `p' = A p + t`, and counts by its linear part A alone: the
/// upper left 3 x 3 entries.
///
/// The result is along the cofactors of A times the normal: the normals of the transformed faces, as
/// [`face_normals`](crate::face_normals()) has them. It is `A^-T n` normalized, where the determinant is
/// positive. A matrix that mirrors turns the corners of all faces clockwise, and their normals with
/// them: the result is the opposite of `A^-T n`. A singular matrix is taken, too. Where nothing is left
/// of a normal, or it was zero, the result is the zero vector, without a gradient.
///
/// # Errors
/// [`RenderError::Shape`] unless the normals have rows of 3 and the matrix is `[4, 4]` or `[3, 3]`.
#[inline(never)]
pub fn transform_normals<'t, T: Scalar>(
    normals: Var<'t, T>,
    matrix: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    normals.tape().apply(TransformNormals, &[normals, matrix])
}

const NAME: &str = "transform_normals";

/// Inputs: normals `[.., 3]`, matrix `[4, 4]` or `[3, 3]`.
struct TransformNormals;

/// A matrix by rows.
type Matrix3<S> = [Vector3<S>; 3];

/// A linear map of surfaces.
#[derive(Debug, Clone, Copy)]
struct Linear<S> {
    /// The matrix by rows, times `factor`.
    rows: Matrix3<S>,
    /// A power of two.
    factor: S,
    /// The cofactors of `rows`, and bounds on their errors.
    cofactors: Matrix3<S>,
    errors: Matrix3<S>,
}

/// What becomes of a normal.
struct Transformed<S> {
    /// The normal times a power of two, and that power.
    normal: Vector3<S>,
    factor: S,
    /// Where the transformed normal points; `None` where nothing is left.
    direction: Option<Direction<S>>,
}

impl<S: Scalar<Wide = S>> Linear<S> {
    /// The linear part of the matrix with these entries, in rows of `width`.
    fn new<T: Scalar<Wide = S>>(matrix: &[T], width: usize) -> Self {
        let rows = [0, 1, 2].map(|i| [0, 1, 2].map(|j| matrix[i * width + j].widen()));
        let factor = power_of_two_to_1(rows.map(largest).into_iter().fold(S::ZERO, larger));
        let rows = rows.map(|row| scaled(factor, row));
        let turned = |i: usize| [rows[(i + 1) % 3], rows[(i + 2) % 3]];
        let cofactors = [0, 1, 2].map(|i| cross(turned(i)[0], turned(i)[1]));
        let errors = [0, 1, 2].map(|i| {
            let [a, b] = turned(i).map(|row| row.map(S::abs));
            [0, 1, 2].map(|j| {
                let [next, last] = [(j + 1) % 3, (j + 2) % 3];
                S::from_f64(ROUNDING) * (a[next] * b[last] + a[last] * b[next])
            })
        });
        Self { rows, factor, cofactors, errors }
    }

    #[inline(always)]
    fn apply<T: Scalar<Wide = S>>(&self, normal: [T; 3]) -> Transformed<S> {
        let normal = normal.map(T::widen);
        let factor = power_of_two_to_1(largest(normal));
        let normal = scaled(factor, normal);
        let sizes = normal.map(S::abs);
        let error = dot(self.errors[0], sizes) + dot(self.errors[1], sizes);
        let direction = Direction::beyond(
            self.cofactors.map(|row| dot(row, normal)),
            error + dot(self.errors[2], sizes),
        );
        Transformed { normal, factor, direction }
    }

    /// The gradient of the matrix from that of the cofactors.
    fn pull_back(&self, cofactors_bar: Matrix3<S>) -> Matrix3<S> {
        [0, 1, 2].map(|i| {
            let [next, last] = [(i + 1) % 3, (i + 2) % 3];
            let by_next = cross(cofactors_bar[next], self.rows[last]);
            let by_last = cross(self.rows[next], cofactors_bar[last]);
            scaled(self.factor, sum(by_next, by_last))
        })
    }
}

/// The extent of the matrix.
fn width(matrix: &Shape) -> Option<usize> {
    match **matrix {
        [3, 3] => Some(3),
        [4, 4] => Some(4),
        _ => None,
    }
}

impl<T: Scalar> Op<T> for TransformNormals {
    /// Memory: sums over pieces, by the rows of the cofactors.
    type Saved = Vec<Matrix3<T::Wide>>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let refused = |rule: &str, shape: &Shape| {
            let (rule, shape) = (rule.to_owned(), shape.clone());
            RenderError::Shape { operation: NAME, rule, shape }
        };
        let shape = inputs.shape(0);
        if !shape.ends_with(&[3]) {
            return Err(refused("normals of shape [.., 3]", shape));
        }
        let width = width(inputs.shape(1))
            .ok_or_else(|| refused("a matrix of shape [4, 4] or [3, 3]", inputs.shape(1)))?;
        let linear = Linear::new(inputs.data(1), width);
        let normals = inputs.data(0).as_chunks::<3>().0;
        let out = outputs.push(shape).as_chunks_mut::<3>().0;
        for_each_piece_mut(out, ROWS_PER_PIECE, |piece, out| {
            let normals = &normals[piece * ROWS_PER_PIECE..];
            for (out, normal) in out.iter_mut().zip(normals) {
                let direction = linear.apply(*normal).direction;
                *out = direction.map_or([T::ZERO; 3], |direction| direction.unit.map(T::narrow));
            }
        });
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        sums: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let width = width(kept.input_shape(1)).expect("the forward pass found that it is one");
        let linear = Linear::new(kept.input(1), width);
        let normals = kept.input(0).as_chunks::<3>().0;
        let out_bar = kept.only_upstream().as_chunks::<3>().0;
        // The normal times a power of two, that power, and the gradient of its transform.
        let v_bar = |at: usize| {
            let Transformed { normal, factor, direction } = linear.apply(normals[at]);
            let bar = direction.map(|direction| direction.pull_back(out_bar[at].map(T::widen)));
            (normal, factor, bar)
        };
        if let Some(normals_bar) = gradients.get(0) {
            let entries = normals_bar.entries().as_chunks_mut::<3>().0;
            for_each_piece_mut(entries, ROWS_PER_PIECE, |piece, entries| {
                for (k, entries) in entries.iter_mut().enumerate() {
                    let (_, factor, bar) = v_bar(piece * ROWS_PER_PIECE + k);
                    let Some(bar) = bar else { continue };
                    for j in 0..3 {
                        let column = linear.cofactors.map(|row| row[j]);
                        entries[j] += T::narrow(factor * dot(column, bar));
                    }
                }
            });
        }
        let Some(matrix_bar) = gradients.get(1) else { return };
        let zero = [[T::Wide::ZERO; 3]; 3];
        let mut total = zero;
        let add = |sum: &mut Matrix3<T::Wide>, term: Matrix3<T::Wide>| {
            sum.as_flattened_mut().iter_mut().zip(term.as_flattened()).for_each(|(s, &t)| *s += t);
        };
        merge_ranges_into(
            sums,
            normals.len(),
            ROWS_PER_PIECE,
            |range, sum| {
                *sum = zero;
                for at in range {
                    let (normal, _, bar) = v_bar(at);
                    let Some(bar) = bar else { continue };
                    add(sum, bar.map(|entry| scaled(entry, normal)));
                }
            },
            |sum| add(&mut total, *sum),
        );
        let bar = linear.pull_back(total);
        matrix_bar.add_each(|k| match (bar.get(k / width), k % width) {
            (Some(row), column @ 0..3) => T::narrow(row[column]),
            _ => T::ZERO,
        });
    }

    fn saved_bytes(&self, sums: &Self::Saved) -> usize {
        size_of_val(&sums[..])
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use bokashi_core::{Tape, Tensor};
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::face_normals::face_normals;
    use crate::fixtures::{bent_sheet, number};
    use crate::mesh::Mesh;

    const MATRIX: [f64; 9] = [1.2, -0.3, 0.5, 0.1, 0.9, -0.7, 0.4, 0.2, 1.6];
    const NORMALS: [f64; 12] = [0.3, -0.2, 0.9, 1.4, 0.1, -0.6, -0.5, 0.8, 0.2, 0., 0., 2.];

    /// Normals, and the gradients of both inputs for motley upstream.
    fn run<T: Scalar>(normals: &[f64], matrix: &[f64]) -> [Vec<f64>; 3] {
        let tape = Tape::<T>::new();
        let side = if matrix.len() == 9 { 3 } else { 4 };
        let tensor = |shape: [usize; 2], of: &[f64]| {
            tape.leaf(&Tensor::from_flat_fn(shape, |k| T::from_f64(of[k])))
        };
        let normals = tensor([normals.len() / 3, 3], normals);
        let matrix = tensor([side, side], matrix);
        let out = transform_normals(normals, matrix).unwrap();
        let upstream = Tensor::from_flat_fn(out.shape(), |k| T::from_f64(number(k)));
        let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
        let all = [out.value(), gradients.get_or_zeros(normals), gradients.get_or_zeros(matrix)];
        all.map(|tensor| tensor.data().iter().map(|x| x.to_f64()).collect())
    }

    fn assert_near(found: &[f64], expected: &[f64], bound: f64) {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert_relative_eq!(*found, *expected, epsilon = bound);
        }
    }

    #[test]
    fn it_is_the_inverse_transpose_where_the_determinant_is_positive() {
        let matrix = DMat3::from_cols_array(&MATRIX).transpose();
        assert!(matrix.determinant() > 0.0);
        let [out, ..] = run::<f64>(&NORMALS, &MATRIX);
        for (normal, out) in NORMALS.chunks(3).zip(out.chunks(3)) {
            let expected = matrix.inverse().transpose() * DVec3::from_slice(normal);
            assert_near(out, &expected.normalize().to_array(), 1e-15);
        }
    }

    #[test]
    fn it_is_the_normals_of_the_transformed_faces_also_under_a_mirror_and_a_projection() {
        let (positions, faces) = bent_sheet(5, 4);
        let mesh = Mesh::new(faces, positions.len() / 3).unwrap();
        let tape = Tape::<f64>::new();
        let normals = |positions: Vec<f64>| {
            let positions = Tensor::new([positions.len() / 3, 3], positions).unwrap();
            face_normals(tape.leaf(&positions), &mesh).unwrap().value().data().to_vec()
        };
        let before = normals(positions.clone());
        let mirror = MATRIX.map(|entry| -entry);
        // Onto the plane x = y, of rank 2.
        let flat = [0.5, 0.5, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0];
        for matrix in [MATRIX, mirror, flat] {
            let moved = positions.chunks(3).flat_map(|p| {
                (0..3).map(move |i| (0..3).map(|j| matrix[3 * i + j] * p[j]).sum::<f64>())
            });
            let expected = normals(moved.collect());
            assert_near(&run::<f64>(&before, &matrix)[0], &expected, 1e-13);
        }
    }

    #[test]
    fn a_shift_does_not_count_and_the_last_row_has_no_gradient() {
        let mut wide = [7.0; 16];
        for k in 0..9 {
            wide[k / 3 * 4 + k % 3] = MATRIX[k];
        }
        let [out, normals_bar, matrix_bar] = run::<f64>(&NORMALS, &MATRIX);
        let [same, same_bar, wide_bar] = run::<f64>(&NORMALS, &wide);
        assert_eq!((same, same_bar), (out, normals_bar));
        for (k, bar) in wide_bar.into_iter().enumerate() {
            let (i, j) = (k / 4, k % 4);
            let expected = if i < 3 && j < 3 { matrix_bar[3 * i + j] } else { 0.0 };
            assert_eq!(bar, expected);
        }
    }

    #[test]
    fn factors_of_matrix_and_normals_do_not_matter() {
        let [out, normals_bar, matrix_bar] = run::<f64>(&NORMALS, &MATRIX);
        for [of_matrix, of_normals] in [[900, -900], [-700, 300], [100, 900], [-1, -1]] {
            let [a, n] = [of_matrix, of_normals].map(|power| f64::powi(2.0, power));
            let times = |by: f64, entries: &[f64]| -> Vec<f64> {
                entries.iter().map(|entry| by * entry).collect()
            };
            let [there, n_bar, a_bar] = run::<f64>(&times(n, &NORMALS), &times(a, &MATRIX));
            assert_eq!(there, out);
            assert_eq!(
                (times(n, &n_bar), times(a, &a_bar)),
                (normals_bar.clone(), matrix_bar.clone())
            );
        }
    }

    #[test]
    fn where_nothing_is_left_of_a_normal_it_is_zero_and_gives_no_gradient() {
        // A line, a point, and multiples of a vector that are a line to within rounding.
        let line = [1., 2., 3., 2., 4., 6., -1., -2., -3.];
        let rounded = [0.1, 0.7, 0.3].map(|x| [x, x / 3.0, x / 7.0]);
        let rounded = std::array::from_fn(|k| rounded[k % 3][k / 3]);
        let linear = Linear::new(&rounded, 3);
        assert!(linear.cofactors.as_flattened().iter().any(|&entry| entry != 0.0));
        for matrix in [line, rounded, [0.0; 9]] {
            let [out, normals_bar, matrix_bar] = run::<f64>(&NORMALS, &matrix);
            let all = out.iter().chain(&normals_bar).chain(&matrix_bar);
            assert!(all.into_iter().all(|&entry| entry == 0.0), "{matrix:?}");
        }
        // A normal of 0, and one that lies in the plane onto which all is projected.
        let flat = [0.5, 0.5, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0];
        let [out, bar, _] = run::<f64>(&[0., 0., 0., 1., 1., 0., 1., -1., 0.], &flat);
        assert_eq!((&out[..6], &bar[..6]), (&[0.0; 6][..], &[0.0; 6][..]));
        assert_near(&out[6..], &[0.5_f64.sqrt(), -(0.5_f64.sqrt()), 0.0], 1e-15);
    }

    #[test]
    fn what_is_not_finite_is_not_masked() {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut normals = NORMALS;
            normals[4] = bad;
            let [out, ..] = run::<f64>(&normals, &MATRIX);
            assert!(out[3..6].iter().any(|entry| entry.is_nan()) && out[0].is_finite());
            let mut matrix = MATRIX;
            matrix[7] = bad;
            assert!(
                run::<f64>(&NORMALS, &matrix)[0]
                    .chunks(3)
                    .all(|row| row.iter().any(|x| x.is_nan()))
            );
        }
    }
}
