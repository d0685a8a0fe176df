//! Constant sparse matrices, stored by rows and by columns.

use std::fmt;
use std::sync::Arc;

use crate::error::TensorError;
use crate::listed_rows::Lists;
use crate::scalar::Scalar;

/// The rows of a matrix, one after another: compressed sparse rows.
#[derive(PartialEq)]
pub(crate) struct Compressed<T> {
    /// Where each row starts, and last where the last one ends.
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<T>,
}

impl<T> Compressed<T> {
    /// The columns of each row.
    pub(crate) fn lists(&self) -> Lists<'_> {
        Lists { starts: &self.starts, rows: &self.columns }
    }

    /// The values of all rows, beside their columns.
    pub(crate) fn values(&self) -> &[T] {
        &self.values
    }

    fn rows(&self) -> usize {
        self.starts.len() - 1
    }
}

/// A constant matrix of which only entries that were given are stored. Its transpose is stored as well.
/// Cloning and transposing share both.
///
/// [`SparseMatrix::product`] multiplies it with a variable.
///
/// ```
/// # use bokashi_core::{SparseMatrix, Tape, Tensor};
/// let differences = SparseMatrix::new(2, 3, [(0, 0, -1.0), (0, 1, 1.0), (1, 1, -1.0), (1, 2, 1.0)])?;
/// let tape = Tape::new();
/// let x = tape.leaf(&Tensor::from([1.0, 4.0, 9.0]));
/// assert_eq!(differences.product(x)?.value(), Tensor::from([3.0, 5.0]));
/// # Ok::<(), bokashi_core::TensorError>(())
/// ```
#[derive(Clone, PartialEq)]
pub struct SparseMatrix<T> {
    by_rows: Arc<Compressed<T>>,
    by_columns: Arc<Compressed<T>>,
}

impl<T: Scalar> SparseMatrix<T> {
    /// The matrix of `rows` by `columns` with these entries, `(row, column, value)` in any order. Values
    /// of one place are added, in their order; entries of 0 are kept.
    ///
    /// # Errors
    /// [`TensorError::Index`] for an entry outside the matrix; [`TensorError::Value`] for more than 2^32
    /// rows or columns.
    pub fn new(
        rows: usize,
        columns: usize,
        triplets: impl IntoIterator<Item = (u32, u32, T)>,
    ) -> Result<Self, TensorError> {
        let operation = "sparse_matrix";
        for extent in [rows, columns] {
            if extent as u64 > 1 << 32 {
                let (rule, value) = ("at most 2^32 rows and columns".into(), extent as f64);
                return Err(TensorError::Value { operation, rule, value });
            }
        }
        let triplets: Vec<_> = triplets.into_iter().collect();
        for &(row, column, _) in &triplets {
            for (index, extent) in [(row, rows), (column, columns)] {
                let index = index as usize;
                if index >= extent {
                    return Err(TensorError::Index { operation, index, extent });
                }
            }
        }
        // By column first: each row then has its columns in order, and equal places in theirs.
        let entries = triplets.iter().map(|&(row, column, value)| (column, row, value));
        let by_columns = sorted(columns, triplets.len(), entries);
        let by_rows = with_sums(sorted(rows, triplets.len(), transposed(&by_columns)));
        let by_columns = sorted(columns, by_rows.values.len(), transposed(&by_rows));
        Ok(Self { by_rows: Arc::new(by_rows), by_columns: Arc::new(by_columns) })
    }

    /// The number of rows.
    pub fn rows(&self) -> usize {
        self.by_rows.rows()
    }

    /// The number of columns.
    pub fn columns(&self) -> usize {
        self.by_columns.rows()
    }

    /// The number of entries that are stored.
    pub fn entries(&self) -> usize {
        self.by_rows.values.len()
    }

    /// The entries of row `i`: their columns, in increasing order, and their values.
    ///
    /// # Panics
    /// Unless there is such a row.
    #[track_caller]
    pub fn row(&self, i: usize) -> (&[u32], &[T]) {
        let Compressed { starts, columns, values } = &*self.by_rows;
        assert!(i < self.rows(), "a row needs to be below {}, got {i}", self.rows());
        let within = starts[i]..starts[i + 1];
        (&columns[within.clone()], &values[within])
    }

    /// All entries, `(row, column, value)`, row by row and by column within a row: what
    /// [`SparseMatrix::new`] takes.
    pub fn triplets(&self) -> impl Iterator<Item = (u32, u32, T)> {
        transposed(&self.by_rows).map(|(column, row, value)| (row, column, value))
    }

    /// The transpose; the entries are shared.
    #[must_use]
    pub fn transposed(&self) -> Self {
        let (by_rows, by_columns) = (Arc::clone(&self.by_columns), Arc::clone(&self.by_rows));
        Self { by_rows, by_columns }
    }

    /// The same matrix in another precision.
    pub fn cast<U: Scalar>(&self) -> SparseMatrix<U> {
        let cast = |from: &Compressed<T>| {
            let values = from.values.iter().map(|value| U::from_f64(value.to_f64())).collect();
            let (starts, columns) = (from.starts.clone(), from.columns.clone());
            Arc::new(Compressed { starts, columns, values })
        };
        SparseMatrix { by_rows: cast(&self.by_rows), by_columns: cast(&self.by_columns) }
    }

    /// The rows.
    pub(crate) fn by_rows(&self) -> &Compressed<T> {
        &self.by_rows
    }

    /// The rows of the transpose.
    pub(crate) fn by_columns(&self) -> &Compressed<T> {
        &self.by_columns
    }
}

/// The entries `(row, column, value)` sorted by row; those of a row stay in their order.
fn sorted<T: Scalar>(
    rows: usize,
    count: usize,
    entries: impl Iterator<Item = (u32, u32, T)> + Clone,
) -> Compressed<T> {
    let mut starts = vec![0; rows + 1];
    entries.clone().for_each(|(row, ..)| starts[row as usize + 1] += 1);
    for row in 0..rows {
        starts[row + 1] += starts[row];
    }
    let (mut columns, mut values) = (vec![0; count], vec![T::ZERO; count]);
    let mut next = starts.clone();
    for (row, column, value) in entries {
        let position = &mut next[row as usize];
        (columns[*position], values[*position]) = (column, value);
        *position += 1;
    }
    Compressed { starts, columns, values }
}

/// The entries of the transpose, `(column, row, value)`, row by row.
fn transposed<T: Scalar>(
    matrix: &Compressed<T>,
) -> impl Iterator<Item = (u32, u32, T)> + Clone + '_ {
    matrix.starts.windows(2).zip(0_u32..=u32::MAX).flat_map(|(ends, row)| {
        let within = ends[0]..ends[1];
        let entries = matrix.columns[within.clone()].iter().zip(&matrix.values[within]);
        entries.map(move |(&column, &value)| (column, row, value))
    })
}

/// The matrix with the values of equal places, which are neighbours, added in their order.
fn with_sums<T: Scalar>(mut matrix: Compressed<T>) -> Compressed<T> {
    let Compressed { starts, columns, values } = &mut matrix;
    let mut kept = 0;
    for row in 0..starts.len() - 1 {
        let (mut entry, end) = (starts[row], starts[row + 1]);
        starts[row] = kept;
        while entry < end {
            let column = columns[entry];
            let mut sum = values[entry].widen();
            entry += 1;
            while entry < end && columns[entry] == column {
                sum += values[entry].widen();
                entry += 1;
            }
            (columns[kept], values[kept]) = (column, T::narrow(sum));
            kept += 1;
        }
    }
    if let Some(end) = starts.last_mut() {
        *end = kept;
    }
    columns.truncate(kept);
    values.truncate(kept);
    matrix
}

impl<T: Scalar> fmt::Debug for SparseMatrix<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SparseMatrix[{}, {}] ", self.rows(), self.columns())?;
        f.debug_list().entries(self.triplets()).finish()
    }
}
