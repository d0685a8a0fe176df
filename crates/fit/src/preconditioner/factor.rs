//! The sparse Cholesky factor of `A = I + lambda L`, with the combinatorial Laplacian L of a mesh.
//!
//! # Formula
//! `A = P' C C' P`, with a permutation P that keeps the lower triangular C sparse. Rows of C follow each other from the
//! top, in `f64`: `c_kj = (a_kj - sum_i<j c_ki c_ji) / c_jj` and `c_kk = sqrt(a_kk - sum_j<k c_kj^2)`. Substitution is
//! in [`Scalar::Wide`], column by column of C: in one order, whatever the number of threads.
//!
//! # Source
//! Davis, *Direct Methods for Sparse Linear Systems*, SIAM 2006, chapter 4: the elimination tree and "up-looking" rows.

use bokashi_core::Scalar;

#[cfg(feature = "precondition")]
use crate::topology::Topology;

/// C by columns, the diagonal entry of each first.
#[derive(Default)]
pub(super) struct Factor {
    /// The vertex of each row of the permuted matrix.
    order: Vec<u32>,
    starts: Vec<usize>,
    rows: Vec<u32>,
    values: Vec<f64>,
}

#[cfg(feature = "precondition")]
impl Factor {
    /// The factor of `A = I + lambda L`, row by row from the top; none where there is no memory for it.
    pub(super) fn new(topology: &Topology, lambda: f64) -> Option<Self> {
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
    /// The number of entries.
    pub(super) fn entry_count(&self) -> usize {
        self.values.len()
    }

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
    pub(super) fn solve_rows<T: Scalar>(
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
