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
