//! Product of a constant sparse matrix and a variable: `y = A x`, `[m, n] x [n, C] -> [m, C]`;
//! `x_bar += A^T y_bar`.
//!
//! Each row of a result is one thread's; its terms are summed in [`Scalar::Wide`], in the order of the
//! columns.

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::listed_rows::sum_listed_rows;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::sparse::{Compressed, SparseMatrix};
use crate::var::Var;

struct SparseProduct<T> {
    matrix: SparseMatrix<T>,
}

impl<T> SparseProduct<T> {
    const NAME: &'static str = "sparse_product";
}

/// Computes the product of `matrix` and `x`, with rows of `inner` entries: calls `put` for each entry.
fn multiply<T: Scalar>(
    matrix: &Compressed<T>,
    x: &[T],
    inner: usize,
    y: &mut [T],
    put: impl Fn(&mut T, T) + Send + Sync,
) {
    let (lists, values) = (matrix.lists(), Some(matrix.values()));
    sum_listed_rows(lists, values, x, inner, y, |y, sum| put(y, T::narrow(sum)));
}

impl<T: Scalar> Op<T> for SparseProduct<T> {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (shape, columns) = (inputs.shape(0), self.matrix.columns());
        if !(1..=2).contains(&shape.rank()) || shape[0] != columns {
            let rule = format!("shape [{columns}] or [{columns}, C]").into();
            let (operation, shape) = (Self::NAME, shape.clone());
            return Err(TensorError::Shape { operation, rule, shape });
        }
        let inner = shape[1..].iter().product();
        let product = shape.with(0, self.matrix.rows());
        let y = outputs.try_push(Self::NAME, product)?;
        multiply(self.matrix.by_rows(), inputs.data(0), inner, y, |y, product| *y = product);
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let inner = kept.input_shape(0)[1..].iter().product();
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        let add = |x_bar: &mut T, term: T| *x_bar = if fresh { term } else { *x_bar + term };
        multiply(self.matrix.by_columns(), kept.only_upstream(), inner, x_bar, add);
    }
}

impl<T: Scalar> SparseMatrix<T> {
    /// The product of this matrix, `[m, n]`, and `x: [n]` or `[n, C]`; returns `[m]` or `[m, C]`. The
    /// matrix is shared.
    ///
    /// # Errors
    /// [`TensorError::Shape`] unless `x` has such a shape; [`TensorError::Memory`] for a product that
    /// takes more than there is.
    pub fn product<'t>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, TensorError> {
        x.tape().apply(SparseProduct { matrix: self.clone() }, &[x])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    /// A matrix with some ten entries in a row, and the same one dense.
    fn matrix(rows: usize, columns: usize) -> (SparseMatrix<f64>, Tensor<f64>) {
        let count = if rows * columns == 0 { 0 } else { 10 * rows };
        let entries = (0..count).map(|k| {
            let at = [k * 31 % rows, k * k % columns].map(|at| at as u32);
            (at[0], at[1], (k % 7) as f64 - 3.0)
        });
        let sparse = SparseMatrix::new(rows, columns, entries).unwrap();
        let mut dense = Tensor::zeros([rows, columns]);
        for (i, j, value) in sparse.triplets() {
            dense[[i as usize, j as usize]] = value;
        }
        (sparse, dense)
    }

    #[test]
    fn a_sparse_product_is_that_of_the_dense_matrix() {
        for (rows, columns) in [(1, 1), (7, 5), (40, 90), (300, 200), (0, 3), (3, 0)] {
            let (sparse, dense) = matrix(rows, columns);
            for width in [0, 1, 2, 3, 4, 5, 9] {
                let tape = Tape::new();
                let entry = |k: usize| (k % 11) as f64 - 5.0;
                let x = tape.leaf(&Tensor::from_flat_fn([columns, width], entry));
                let products =
                    [sparse.product(x).unwrap(), tape.constant(&dense).matmul(x).unwrap()];
                let upstream = Tensor::from_flat_fn([rows, width], |k| (k % 5) as f64);
                let [found, expected] = products.map(|product| {
                    let gradients = tape.vjp(&[(product, &upstream)]).unwrap();
                    (product.value(), gradients.get_or_zeros(x))
                });
                assert_eq!(found, expected, "{rows} {columns} {width}");
            }
        }
    }

    #[test]
    fn the_transpose_pulls_back() {
        let (sparse, _) = matrix(20, 30);
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn([30], |k| k as f64));
        let y = Tensor::from_flat_fn([20], |k| (k % 7) as f64);
        let gradients = tape.vjp(&[(sparse.product(x).unwrap(), &y)]).unwrap();
        let pulled = sparse.transposed().product(tape.constant(&y)).unwrap();
        assert_eq!(gradients.get(x), Some(&pulled.value()));
    }

    #[test]
    fn a_row_of_many_entries_keeps_its_digits_in_f32() {
        let n = 1 << 17;
        let ones = (0..n).map(|k| (0, k, 1.0_f32));
        let sum = SparseMatrix::new(1, n as usize, ones).unwrap();
        let tape = Tape::new();
        let tenths = tape.leaf_full([n as usize], 0.1);
        let exact = (f64::from(0.1_f32) * f64::from(n)) as f32;
        assert_eq!(sum.product(tenths).unwrap().item(), exact);
    }
}
