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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    fn matrix(shape: [usize; 2], entries: &[f64]) -> Tensor<f64> {
        Tensor::new(shape, entries.to_vec()).unwrap()
    }

    #[test]
    fn value_and_gradients_by_hand() {
        let tape = Tape::new();
        let x = tape.leaf(&matrix([2, 3], &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
        let y = tape.leaf(&matrix([3, 1], &[7.0, 8.0, 9.0]));
        let z = x.matmul(y).unwrap();
        assert_eq!(z.value(), matrix([2, 1], &[50.0, 122.0]));
        let gradients = tape.vjp(&[(z, &matrix([2, 1], &[1.0, 10.0]))]).unwrap();
        assert_eq!(gradients.get(x).unwrap().data(), [7.0, 8.0, 9.0, 70.0, 80.0, 90.0]);
        assert_eq!(gradients.get(y).unwrap().data(), [41.0, 52.0, 63.0]);
    }

    #[test]
    fn the_unit_matrix_changes_nothing() {
        let tape = Tape::new();
        let n = 2 * LANES + 3;
        let x = tape.leaf(&Tensor::from_flat_fn([n, n], |k| (k as f64).sin()));
        let unit = tape.constant(&Tensor::from_flat_fn([n, n], |k| f64::from(k % (n + 1) == 0)));
        for product in [x.matmul(unit).unwrap(), unit.matmul(x).unwrap()] {
            assert_eq!(product.value(), x.value());
            let gradients = tape.vjp(&[(product, &x.value())]).unwrap();
            assert_eq!(gradients.get(x), Some(&x.value()));
        }
    }

    #[test]
    fn an_empty_inner_axis_gives_zeros() {
        let tape = Tape::<f64>::new();
        let [x, y] = [[2, 0], [0, 3]].map(|shape| tape.leaf(&Tensor::zeros(shape)));
        let z = x.matmul(y).unwrap();
        assert_eq!(z.value(), Tensor::zeros([2, 3]));
        assert_eq!(z.sum().backward().unwrap().get_or_zeros(x).size(), 0);
    }

    #[test]
    fn a_nan_is_not_masked_by_a_zero() {
        let tape = Tape::new();
        let x = tape.constant(&matrix([1, 2], &[0.0, 1.0]));
        let y = tape.constant(&matrix([2, 1], &[f64::NAN, 1.0]));
        assert!(x.matmul(y).unwrap().item().is_nan());
    }
}
