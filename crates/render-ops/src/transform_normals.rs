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
        let v_bar = |row: usize| {
            let Transformed { normal, factor, direction } = linear.apply(normals[row]);
            let bar = direction.map(|direction| direction.pull_back(out_bar[row].map(T::widen)));
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
                for row in range {
                    let (normal, _, bar) = v_bar(row);
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
