//! A preconditioner: a change of variables after which steps of a fit are smooth.
//!
//! # Forward
//! Vertices v are learnt as `u = A v`, `A = I + lambda L`, with the combinatorial Laplacian L of a mesh; v is solved
//! from u. The matrix A is symmetric and positive definite. It is factored once in `f64`, `A = P' C C' P`, with a
//! permutation P that keeps C sparse. Substitution is in [`Scalar::Wide`], column by column of C: in one order,
//! whatever the number of threads.
//!
//! # Backward
//! `u_bar = A^-1 v_bar`: the same solve.
//!
//! # Bounds
//! A is an M-matrix, and its rows sum to 1. So each entry of v is a mean of entries of u, with weights
//! from 0 up: finite u have finite v.
//!
//! # Source
//! Nicolet, Jacobson and Jakob, *Large steps in inverse rendering of geometry*, ACM Transactions on
//! Graphics 40(6), 2021, equation 12.

use std::fmt;
use std::sync::Arc;

use bokashi_core::{
    Accumulators, Inputs, Kept, Op, Outputs, Scalar, Shape, Tensor, TensorError, Var,
};

use crate::topology::Topology;

/// The change of variables `u = (I + lambda L) v` of numbers at the vertices of a mesh, with the factor that solves for
/// v. Made once, with the feature `precondition`; cheap to clone.
///
/// [`Parameter::preconditioned`](crate::Parameter::preconditioned) learns a parameter as u.
#[derive(Clone)]
pub struct Preconditioner(Arc<Inner>);

struct Inner {
    topology: Topology,
    lambda: f64,
    factor: Factor,
}

/// C by columns, the diagonal entry of each first.
#[derive(Default)]
struct Factor {
    /// The vertex of each row of the permuted matrix.
    order: Vec<u32>,
    starts: Vec<usize>,
    rows: Vec<u32>,
    values: Vec<f64>,
}

const NAME: &str = "precondition";

impl fmt::Debug for Preconditioner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner { topology, lambda, factor } = &*self.0;
        f.debug_struct("Preconditioner")
            .field("vertices", &topology.vertex_count())
            .field("lambda", lambda)
            .field("entries", &factor.values.len())
            .finish_non_exhaustive()
    }
}

/// Two preconditioners are equal if they have the same edges and the same lambda.
impl PartialEq for Preconditioner {
    fn eq(&self, other: &Self) -> bool {
        let [a, b] = [&*self.0, &*other.0];
        let size = |inner: &Inner| (inner.topology.vertex_count(), inner.lambda);
        Arc::ptr_eq(&self.0, &other.0)
            || size(a) == size(b) && a.topology.edges() == b.topology.edges()
    }
}

#[cfg(feature = "precondition")]
impl Preconditioner {
    /// Makes the preconditioner for the vertices of `topology`. With a larger `lambda`, a step at one vertex moves
    /// neighbours farther away; the paper takes 19 for most of its meshes.
    ///
    /// It factors a matrix of the size of the mesh, which takes some microseconds per vertex.
    ///
    /// # Errors
    /// [`TensorError::Value`] for a lambda outside 0 to 1e12, beyond which nothing of I is left in `f64`; also where
    /// there is no memory for the factor.
    pub fn new(topology: &Topology, lambda: f64) -> Result<Self, TensorError> {
        if !(0.0..=1e12).contains(&lambda) {
            let rule = "a lambda from 0 to 1e12".into();
            return Err(TensorError::Value { operation: NAME, rule, value: lambda });
        }
        let factor = Factor::new(topology, lambda).ok_or_else(|| {
            let rule = "memory for its factor".into();
            let value = topology.vertex_count() as f64;
            TensorError::Value { operation: NAME, rule, value }
        })?;
        Ok(Self(Arc::new(Inner { topology: topology.clone(), lambda, factor })))
    }
}

#[cfg(feature = "precondition")]
impl Factor {
    /// The factor of `A = I + lambda L`, row by row from the top; none where there is no memory for it.
    fn new(topology: &Topology, lambda: f64) -> Option<Self> {
        let matrix = Permuted::new(topology)?;
        let count = matrix.order.len();
        let tree = EliminationTree::new(&matrix);
        let starts = tree.starts;
        let (mut rows, mut values) = (Vec::new(), Vec::new());
        rows.try_reserve_exact(starts[count]).ok()?;
        values.try_reserve_exact(starts[count]).ok()?;
        rows.resize(starts[count], 0);
        values.resize(starts[count], 0.0);

        // Where the next entry of each column goes, and row k of A less what the columns before have explained.
        let mut ends = starts[..count].to_vec();
        let (mut row, mut columns) = (vec![0.0; count], Vec::new());
        let mut visited = vec![usize::MAX; count];
        // Row by row, "up-looking". The columns with an entry in row k are those of A, and all on the paths from them
        // to the root of the elimination tree.
        for k in 0..count {
            columns.clear();
            tree.parents
                .visit(k, matrix.columns_before(k), &mut visited, |column| columns.push(column));
            // A parent comes after its children.
            columns.sort_unstable();
            matrix.columns_before(k).for_each(|column| row[column] = -lambda);
            let mut diagonal = 1.0 + lambda * matrix.degree(k) as f64;
            for &column in &columns {
                // c_kj = (a_kj - sum_i<j c_ki c_ji) / c_jj
                let filled = starts[column]..ends[column];
                let entry = row[column] / values[filled.start];
                row[column] = 0.0;
                for index in filled.skip(1) {
                    row[rows[index] as usize] -= values[index] * entry;
                }
                diagonal -= entry * entry;
                (rows[ends[column]], values[ends[column]]) = (k as u32, entry);
                ends[column] += 1;
            }
            // In exact numbers it is 1 or more.
            let root = diagonal.max(f64::MIN_POSITIVE).sqrt();
            (rows[ends[k]], values[ends[k]]) = (k as u32, root);
            ends[k] += 1;
        }
        Some(Self { order: matrix.order, starts, rows, values })
    }
}

/// `I + lambda L` in an order of the vertices that keeps its factor sparse: approximate minimum degree.
#[cfg(feature = "precondition")]
struct Permuted<'a> {
    topology: &'a Topology,
    /// The vertex of each row.
    order: Vec<u32>,
    /// The row of each vertex.
    rows: Vec<usize>,
}

#[cfg(feature = "precondition")]
impl<'a> Permuted<'a> {
    fn new(topology: &'a Topology) -> Option<Self> {
        let count = topology.vertex_count();
        let (mut starts, mut neighbors) = (vec![0], Vec::new());
        for vertex in 0..count {
            neighbors.extend(topology.neighbors(vertex).iter().map(|&other| other as usize));
            starts.push(neighbors.len());
        }
        let (order, ..) = amd::order(count, &starts, &neighbors, &amd::Control::default()).ok()?;
        let mut rows = vec![0; count];
        order.iter().enumerate().for_each(|(row, &vertex)| rows[vertex] = row);
        let order = order.into_iter().map(|vertex| vertex as u32).collect();
        Some(Self { topology, order, rows })
    }

    fn neighbors(&self, row: usize) -> &[u32] {
        self.topology.neighbors(self.order[row] as usize)
    }

    fn degree(&self, row: usize) -> usize {
        self.neighbors(row).len()
    }

    /// The columns of the entries of a row before its diagonal.
    fn columns_before(&self, row: usize) -> impl Iterator<Item = usize> {
        let columns = self.neighbors(row).iter().map(|&other| self.rows[other as usize]);
        columns.filter(move |&column| column < row)
    }
}

/// Where the entries of the factor are.
#[cfg(feature = "precondition")]
struct EliminationTree {
    parents: Parents,
    /// Where each column starts, and the number of all entries.
    starts: Vec<usize>,
}

/// The first row below the diagonal of each column of the factor; `usize::MAX` where there is none yet.
#[cfg(feature = "precondition")]
struct Parents(Vec<usize>);

#[cfg(feature = "precondition")]
impl EliminationTree {
    fn new(matrix: &Permuted<'_>) -> Self {
        let count = matrix.order.len();
        let mut parents = Parents(vec![usize::MAX; count]);
        let (mut visited, mut lengths) = (vec![usize::MAX; count], vec![1; count]);
        let mut reached = Vec::new();
        for k in 0..count {
            // Row k is the first below the diagonal of each root that is reached.
            reached.clear();
            parents.visit(k, matrix.columns_before(k), &mut visited, |column| {
                lengths[column] += 1;
                reached.push(column);
            });
            for &column in &reached {
                if parents.0[column] == usize::MAX {
                    parents.0[column] = k;
                }
            }
        }
        let mut starts = Vec::with_capacity(count + 1);
        starts.push(0);
        lengths.iter().for_each(|length| starts.push(starts[starts.len() - 1] + length));
        Self { parents, starts }
    }
}

#[cfg(feature = "precondition")]
impl Parents {
    /// Calls `visit` once for each column with an entry in row `k` of the factor, before its diagonal: those of the
    /// matrix, and all on the way from them toward the root. `visited` marks columns by rows.
    fn visit(
        &self,
        k: usize,
        columns: impl Iterator<Item = usize>,
        visited: &mut [usize],
        mut visit: impl FnMut(usize),
    ) {
        for mut column in columns {
            // Where another entry's way has come by, the rest of the way is known.
            while column < k && visited[column] != k {
                visited[column] = k;
                visit(column);
                column = self.0[column];
            }
        }
    }
}

impl Factor {
    /// Solves `A x = b` for `W` right-hand sides, in place and in the order of the factor.
    fn solve<S: Scalar, const W: usize>(&self, x: &mut [[S; W]]) {
        let count = x.len();
        let column = |j: usize| {
            let within = self.starts[j]..self.starts[j + 1];
            let (rows, values) = (&self.rows[within.clone()], &self.values[within]);
            let below = rows.iter().zip(values).skip(1);
            (S::from_f64(values[0]), below.map(|(&row, &value)| (row as usize, S::from_f64(value))))
        };
        // C y = b from the top: once x_j is known, all rows below take their share of it off.
        for j in 0..count {
            let (diagonal, below) = column(j);
            let known = x[j].map(|x| x / diagonal);
            x[j] = known;
            for (row, value) in below {
                x[row].iter_mut().zip(known).for_each(|(x, known)| *x -= value * known);
            }
        }
        // C' x = y from the bottom: all that row j needs from below is known.
        for j in (0..count).rev() {
            let (diagonal, below) = column(j);
            let mut sum = x[j];
            for (row, value) in below {
                sum.iter_mut().zip(x[row]).for_each(|(sum, x)| *sum -= value * x);
            }
            x[j] = sum.map(|sum| sum / diagonal);
        }
    }

    /// Solves for columns `first..first + W` of `b`, with rows of `inner` entries.
    fn solve_columns<T: Scalar, const W: usize>(
        &self,
        b: &[T],
        inner: usize,
        first: usize,
        memory: &mut Vec<T::Wide>,
        mut put: impl FnMut(usize, T),
    ) {
        memory.clear();
        // All W columns at once, so that the factor is read once for them.
        let entries = self.order.iter().flat_map(|&vertex| {
            let row = &b[vertex as usize * inner + first..][..W];
            row.iter().map(|entry| entry.widen())
        });
        memory.extend(entries);
        let rows = memory.as_chunks_mut::<W>().0;
        self.solve(rows);
        for (&vertex, row) in self.order.iter().zip(rows) {
            for (k, &entry) in row.iter().enumerate() {
                put(vertex as usize * inner + first + k, T::narrow(entry));
            }
        }
    }

    /// Calls `put(k, x_k)` for each entry of the solution of `A x = b`, with rows of `inner` entries.
    fn solve_rows<T: Scalar>(
        &self,
        b: &[T],
        inner: usize,
        memory: &mut Vec<T::Wide>,
        mut put: impl FnMut(usize, T),
    ) {
        let threes = inner / 3;
        for part in 0..threes {
            self.solve_columns::<T, 3>(b, inner, 3 * part, memory, &mut put);
        }
        for first in 3 * threes..inner {
            self.solve_columns::<T, 1>(b, inner, first, memory, &mut put);
        }
    }
}

impl Preconditioner {
    /// The mesh.
    pub fn topology(&self) -> &Topology {
        &self.0.topology
    }

    /// Lambda.
    pub fn lambda(&self) -> f64 {
        self.0.lambda
    }

    /// Entries of a row of numbers at the vertices, `[V]` or `[V, C]`.
    fn inner(&self, shape: &Shape) -> Result<usize, TensorError> {
        let count = self.0.topology.vertex_count();
        match **shape {
            [rows] if rows == count => Ok(1),
            [rows, inner] if rows == count => Ok(inner),
            _ => {
                let rule = format!("shape [{count}] or [{count}, C]").into();
                Err(TensorError::Shape { operation: NAME, rule, shape: shape.clone() })
            }
        }
    }

    /// Checks that numbers of this shape stand at the vertices.
    pub(crate) fn check(&self, shape: &Shape) -> Result<(), TensorError> {
        self.inner(shape).map(drop)
    }

    /// `u = (I + lambda L) v` of numbers at the vertices, `[V]` or `[V, C]`.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for any other shape.
    pub fn raw<T: Scalar>(&self, v: &Tensor<T>) -> Result<Tensor<T>, TensorError> {
        let inner = self.inner(v.shape())?;
        let lambda = T::Wide::from_f64(self.0.lambda);
        // u_i = v_i + lambda sum_j (v_i - v_j) over the neighbours j of i
        let entry = |k: usize| {
            let (vertex, column) = (k / inner, k % inner);
            let value = v.data()[k].widen();
            let around = self.0.topology.neighbors(vertex).iter();
            let apart =
                around.map(|&other| value - v.data()[other as usize * inner + column].widen());
            T::narrow(value + lambda * apart.sum())
        };
        Ok(Tensor::from_flat_fn(v.shape(), entry))
    }

    /// `v = (I + lambda L)^-1 u` of numbers at the vertices, `[V]` or `[V, C]`.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for any other shape.
    pub fn value<T: Scalar>(&self, u: &Tensor<T>) -> Result<Tensor<T>, TensorError> {
        let inner = self.inner(u.shape())?;
        let mut v = u.clone();
        let entries = v.data_mut();
        self.0.factor.solve_rows(u.data(), inner, &mut Vec::new(), |k, x| entries[k] = x);
        Ok(v)
    }

    /// [`Preconditioner::value`] of a variable.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for any other shape.
    #[inline(never)]
    pub fn record<'t, T: Scalar>(&self, u: Var<'t, T>) -> Result<Var<'t, T>, TensorError> {
        u.tape().apply(self.clone(), &[u])
    }
}

impl<T: Scalar> Op<T> for Preconditioner {
    /// Memory.
    type Saved = Vec<T::Wide>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        memory: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let shape = inputs.shape(0);
        let inner = self.inner(shape)?;
        if self.0.lambda == 0.0 {
            outputs.pass(0, "lambda = 0: the identity");
            return Ok(());
        }
        let v = outputs.push(shape);
        self.0.factor.solve_rows(inputs.data(0), inner, memory, |k, x| v[k] = x);
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        memory: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(u_bar) = gradients.get(0) else { return };
        let inner = kept.input_shape(0)[1..].iter().product();
        let (u_bar, fresh) = u_bar.entries_or_fresh();
        self.0.factor.solve_rows(kept.only_upstream(), inner, memory, |k, term: T| {
            u_bar[k] = if fresh { term } else { u_bar[k] + term };
        });
    }
}

#[cfg(all(test, feature = "precondition"))]
mod tests {
    use bokashi_core::{Dual, Tape};

    use super::*;

    /// A sheet of `side` by `side` quads, with a vertex more that has no face.
    fn sheet(side: u32) -> Topology {
        let mut faces = Vec::new();
        for k in 0..side * side {
            let first = k / side * (side + 1) + k % side;
            let above = first + side + 1;
            faces.extend([[first, first + 1, above + 1], [first, above + 1, above]]);
        }
        Topology::new(&faces, ((side + 1) * (side + 1) + 1) as usize).unwrap()
    }

    fn motley(shape: &[usize]) -> Tensor<f64> {
        Tensor::from_flat_fn(shape, |k| ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.4)
    }

    #[test]
    fn the_value_of_the_raw_numbers_is_the_value_at_every_width() {
        for side in [1, 2, 7, 40] {
            let topology = sheet(side);
            let count = topology.vertex_count();
            for lambda in [0.0, 1e-3, 1.0, 19.0, 1e6] {
                let preconditioner = Preconditioner::new(&topology, lambda).unwrap();
                for shape in [&[count][..], &[count, 1], &[count, 3], &[count, 5], &[count, 0]] {
                    let v = motley(shape);
                    let u = preconditioner.raw(&v).unwrap();
                    let laplacian = topology.combinatorial_laplacian::<f64>();
                    let tape = Tape::new();
                    let product = laplacian.product(tape.constant(&v)).unwrap().value();
                    let found = preconditioner.value(&u).unwrap();
                    for k in 0..v.size() {
                        let expected = v.data()[k] + lambda * product.data()[k];
                        let off = (u.data()[k] - expected).abs();
                        assert!(off <= 1e-14 * (1.0 + lambda), "{side} {lambda} {off}");
                        let error = (found.data()[k] - v.data()[k]).abs();
                        assert!(error <= 1e-14 * (1.0 + lambda), "{side} {lambda} {error}");
                    }
                    // What is recorded is the same, and again within a used tape.
                    let recorded = preconditioner.record(tape.leaf(&u)).unwrap().value();
                    assert_eq!(recorded.data().len(), found.data().len());
                    if lambda > 0.0 {
                        assert_eq!(recorded, found);
                    }
                }
            }
        }
    }

    #[test]
    fn the_backward_pass_is_the_adjoint_and_adds_up() {
        let topology = sheet(9);
        let preconditioner = Preconditioner::new(&topology, 19.0).unwrap();
        let shape = [topology.vertex_count(), 3];
        let (u, upstream) = (motley(&shape), motley(&shape).map(|x| x * x));
        let tape = Tape::new();
        let leaf = tape.leaf(&u);
        let v = preconditioner.record(leaf).unwrap();
        let gradient = tape.vjp(&[(v, &upstream)]).unwrap().get_or_zeros(leaf);
        assert_eq!(gradient, preconditioner.value(&upstream).unwrap());
        let inner = |a: &Tensor<f64>, b: &Tensor<f64>| -> f64 {
            a.data().iter().zip(b.data()).map(|(a, b)| a * b).sum()
        };
        let (left, right) = (inner(&v.value(), &upstream), inner(&u, &gradient));
        approx::assert_relative_eq!(left, right, max_relative = 1e-13);
        // Used twice, and beside another way.
        let both = (v + preconditioner.record(leaf).unwrap()) + leaf;
        let sum = tape.vjp(&[(both, &upstream)]).unwrap().get_or_zeros(leaf);
        for k in 0..u.size() {
            let expected = 2.0 * gradient.data()[k] + upstream.data()[k];
            approx::assert_relative_eq!(sum.data()[k], expected, max_relative = 1e-14);
        }
    }

    #[test]
    fn duals_go_through_part_by_part_and_f32_is_the_rounded_f64() {
        let topology = sheet(6);
        let preconditioner = Preconditioner::new(&topology, 19.0).unwrap();
        let shape = [topology.vertex_count(), 3];
        let (u, along) = (motley(&shape), motley(&shape).map(f64::sin));
        let dual = Tensor::from_flat_fn(shape, |k| Dual::new(u.data()[k], along.data()[k]));
        let found = preconditioner.value(&dual).unwrap();
        let parts = [&u, &along].map(|part| preconditioner.value(part).unwrap());
        for (k, found) in found.data().iter().enumerate() {
            assert_eq!(found.value, parts[0].data()[k]);
            approx::assert_relative_eq!(found.tangent, parts[1].data()[k], max_relative = 1e-13);
        }
        let single = u.cast::<f32>();
        let wide = preconditioner.value(&single.cast::<f64>()).unwrap().cast::<f32>();
        assert_eq!(preconditioner.value(&single).unwrap(), wide);
    }

    #[test]
    fn constants_and_the_mean_are_kept_and_nothing_leaves_the_range_of_u() {
        let topology = sheet(12);
        let count = topology.vertex_count();
        for lambda in [1.0, 1e4, 1e12] {
            let preconditioner = Preconditioner::new(&topology, lambda).unwrap();
            let flat = preconditioner.value(&Tensor::full([count], 3.0)).unwrap();
            // The condition of the matrix: what f64 keeps of a constant.
            let bound = 1e-15 * (1.0 + lambda) * 10.0;
            assert!(flat.data().iter().all(|v| (v - 3.0).abs() <= bound.min(1.0)), "{lambda}");
            let mut spike = Tensor::zeros([count]);
            spike.data_mut()[40] = 1.0;
            let spread = preconditioner.value(&spike).unwrap();
            assert!(spread.data().iter().all(|v| (-1e-12..=1.0).contains(v)));
            let sum: f64 = spread.data().iter().sum();
            assert!((sum - 1.0).abs() <= bound.min(0.5), "{lambda} {sum}");
            assert_eq!(spread.data()[count - 1], 0.0);
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let topology = sheet(1);
        for lambda in [-1.0, f64::NAN, f64::INFINITY, 1e13] {
            let error = Preconditioner::new(&topology, lambda).unwrap_err().to_string();
            assert_eq!(error, format!("precondition needs a lambda from 0 to 1e12, got {lambda}"));
        }
        let preconditioner = Preconditioner::new(&topology, 1.0).unwrap();
        let tape = Tape::<f64>::new();
        for shape in [&[4][..], &[5, 2, 1], &[]] {
            let message = format!("precondition needs shape [5] or [5, C], got shape {shape:?}");
            let error = preconditioner.record(tape.leaf(&Tensor::zeros(shape))).unwrap_err();
            assert_eq!(error.to_string(), message);
        }
        let empty = Preconditioner::new(&Topology::new(&[], 0).unwrap(), 1.0).unwrap();
        assert_eq!(empty.value(&Tensor::<f64>::zeros([0, 3])).unwrap().size(), 0);
        // Only of the same edges and lambda are two alike.
        assert_eq!(preconditioner, Preconditioner::new(&sheet(1), 1.0).unwrap());
        assert_ne!(preconditioner, Preconditioner::new(&sheet(1), 2.0).unwrap());
        assert_ne!(preconditioner, Preconditioner::new(&sheet(2), 1.0).unwrap());
    }
}
