//! Inner product of vectors along the last axes: `z_o = sum_k x_ok y_ok`, where the other axes broadcast;
//! `x_bar_ok += y_ok z_bar_o`, `y_bar_ok += x_ok z_bar_o`. A vector that was repeated collects the terms
//! of all its copies.
//!
//! No product is stored: sums are formed in [`Scalar::Wide`] as the products are.

use crate::axis::{for_each_line_mut, reduced};
use crate::copies::add_over_copies;
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::summation::inner_product;
use crate::var::Var;
use crate::vectors::{Pairs, Vectors, common_shape, for_each_vector};
use crate::walk::axes;

const NAME: &str = "dot";

struct Dot;

impl<T: Scalar> Op<T> for Dot {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let full = common_shape(inputs.shape(0), inputs.shape(1), NAME)?;
        let last = full.rank() - 1;
        let pairs = Pairs::new([0, 1].map(|i| (inputs.data(i), inputs.shape(i))), &full);
        let (z, n) = (outputs.try_push(NAME, reduced(&full, last)?)?, full[last]);
        match pairs {
            Pairs::Many([x, y]) => for_each_vector(z, n, |row, n| {
                T::narrow(inner_product(&x[row * n..][..n], &y[row * n..][..n]))
            }),
            Pairs::ManyAndOne(many, one) | Pairs::OneAndMany(one, many) => {
                for_each_vector(z, n, |row, n| {
                    T::narrow(inner_product(&many[row * n..][..n], &one[..n]))
                });
            }
            Pairs::Any([x, y]) => for_each_vector(z, n, |row, n| {
                T::narrow(inner_product(x.row(row, n), y.row(row, n)))
            }),
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(1, inputs.needs(0)).input_if(0, inputs.needs(1))
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let z_bar = kept.only_upstream();
        let full = common_shape(kept.input_shape(0), kept.input_shape(1), NAME);
        let full = full.expect("the forward pass found that they fit");
        let last = full.rank() - 1;
        let products = full.with(last, 1);
        for (operand, other) in [(0, 1), (1, 0)] {
            let Some(x_bar) = gradients.get(operand) else { continue };
            let (shape, y, y_shape) =
                (kept.input_shape(operand), kept.input(other), kept.input_shape(other));
            if *shape != full {
                let axes = axes([&full, shape, y_shape, &products]);
                let axes = axes.map(|(extent, [_, i, j, k])| (extent, [i, j, k]));
                let term = |[_, j, k]: [usize; 3]| y[j].widen() * z_bar[k].widen();
                add_over_copies(x_bar.entries(), axes, term);
                continue;
            }
            let (x_bar, fresh) = x_bar.entries_or_fresh();
            let add = |x_bar: &mut [T], y: &[T], z_bar: T| {
                for (x_bar, &y) in x_bar.iter_mut().zip(y) {
                    let term = y * z_bar;
                    *x_bar = if fresh { term } else { *x_bar + term };
                }
            };
            if *y_shape == full {
                for_each_line_mut(x_bar, full[last], [y], |row, x_bar, [y]| {
                    add(x_bar, y, z_bar[row]);
                });
            } else if y.len() == full[last] {
                // One vector for all: no walk finds it.
                for_each_line_mut(x_bar, full[last], [], |row, x_bar, []| {
                    add(x_bar, y, z_bar[row]);
                });
            } else {
                let y = Vectors::new((y, y_shape), &full);
                for_each_line_mut(x_bar, full[last], [], |row, x_bar, []| {
                    add(x_bar, y.row(row, full[last]), z_bar[row]);
                });
            }
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The inner products of vectors along the last axes, which are removed; the other axes broadcast. Of
    /// `[n, 3]` and `[n, 3]` or `[3]`, those of rows: `[n]`. For vectors along another axis
    /// [`Var::permute`] the operands.
    ///
    /// # Errors
    /// [`TensorError::Mismatch`] unless both have one extent along the last axis;
    /// [`TensorError::Broadcast`] unless the other axes broadcast.
    pub fn dot(self, other: Self) -> Result<Self, TensorError> {
        self.tape.apply(Dot, &[self, other])
    }
}
