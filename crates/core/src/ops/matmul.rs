//! Matrix product: `z = x y`, `[m, k] x [k, n] -> [m, n]`; `x_bar += z_bar y^T`,
//! `y_bar += x^T z_bar`.
//!
//! Terms are added in the order of the inner axis, whatever the number of threads: each row of a
//! result is one thread's.

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;

/// Independent partial sums of a dot product, so that additions overlap in the processor.
const LANES: usize = 16;

struct MatrixProduct;

impl<T: Scalar> Op<T> for MatrixProduct {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "matmul"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let [m, k, n] = extents(inputs.shape(0), inputs.shape(1))?;
        let (x, y) = (inputs.data(0), inputs.data(1));
        let z = outputs.try_push("matmul", [m, n])?;
        z.fill(T::ZERO);
        for_each_row(z, n, k, |i, z| {
            // Row by row of y, as it lies in memory: a column of y would be a walk with long steps.
            for p in 0..k {
                add_scaled(z, x[i * k + p], &y[p * n..][..n]);
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(1, inputs.needs(0)).input_if(0, inputs.needs(1))
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let [m, k, n] = extents(kept.input_shape(0), kept.input_shape(1))
            .expect("the forward pass found that they fit");
        let z_bar = kept.only_upstream();
        if let Some(x_bar) = gradients.get(0) {
            let y = kept.input(1);
            for_each_row(x_bar.entries(), k, n, |i, x_bar| {
                let z_bar = &z_bar[i * n..][..n];
                for (p, x_bar) in x_bar.iter_mut().enumerate() {
                    *x_bar += dot(z_bar, &y[p * n..][..n]);
                }
            });
        }
        if let Some(y_bar) = gradients.get(1) {
            let x = kept.input(0);
            for_each_row(y_bar.entries(), n, m, |p, y_bar| {
                for i in 0..m {
                    add_scaled(y_bar, x[i * k + p], &z_bar[i * n..][..n]);
                }
            });
        }
    }
}

/// `[m, k, n]` of the shapes `[m, k]` and `[k, n]`.
fn extents(left: &Shape, right: &Shape) -> Result<[usize; 3], TensorError> {
    match (&**left, &**right) {
        (&[m, k], &[rows, n]) if k == rows => Ok([m, k, n]),
        _ => Err(TensorError::Mismatch {
            operation: "matmul",
            rule: "shapes [m, k] and [k, n]".into(),
            shapes: Box::new([left.clone(), right.clone()]),
        }),
    }
}

/// Calls `work(i, row)` for each row of `columns` entries, each of which costs `terms` additions.
fn for_each_row<T: Scalar>(
    matrix: &mut [T],
    columns: usize,
    terms: usize,
    work: impl Fn(usize, &mut [T]) + Send + Sync,
) {
    if columns == 0 {
        return;
    }
    let rows = (ENTRIES_PER_PIECE / (columns * terms).max(1)).max(1);
    for_each_piece_mut(matrix, rows * columns, |piece, matrix| {
        let rows = (piece * rows..).zip(matrix.chunks_mut(columns));
        rows.for_each(|(i, row)| work(i, row));
    });
}

/// `sum += a row`.
fn add_scaled<T: Scalar>(sum: &mut [T], a: T, row: &[T]) {
    sum.iter_mut().zip(row).for_each(|(sum, &entry)| *sum += a * entry);
}

/// `sum_k x_k y_k`.
fn dot<T: Scalar>(x: &[T], y: &[T]) -> T {
    let ((x, x_rest), (y, y_rest)) = (x.as_chunks::<LANES>(), y.as_chunks::<LANES>());
    let mut lanes = [T::ZERO; LANES];
    for (x, y) in x.iter().zip(y) {
        for lane in 0..LANES {
            lanes[lane] += x[lane] * y[lane];
        }
    }
    let rest = x_rest.iter().zip(y_rest);
    lanes.into_iter().chain(rest.map(|(&x, &y)| x * y)).sum()
}

impl<T: Scalar> Var<'_, T> {
    /// The matrix product of `self: [m, k]` and `other: [k, n]`, of shape `[m, n]`.
    ///
    /// # Errors
    /// [`TensorError::Mismatch`] unless the shapes fit so.
    pub fn matmul(self, other: Self) -> Result<Self, TensorError> {
        self.tape.apply(MatrixProduct, &[self, other])
    }
}
