//! Inner product along an axis: `z_o = sum_k x_ok y_ok`, where operands broadcast;
//! `x_bar_ok += y_ok z_bar_o`, `y_bar_ok += x_ok z_bar_o`. An entry that was repeated collects the terms
//! of all its copies.
//!
//! No product is stored: sums are formed in [`Scalar::Wide`] as the products are.

use crate::axis::{blocks, for_each_line_mut, is_in_lines, reduced};
use crate::copies::add_over_copies;
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::inner_product::{Operand, inner_products};
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;
use crate::walk::{Walk, axes};

struct Dot {
    axis: usize,
}

impl Dot {
    const NAME: &'static str = "dot";

    /// The common shape of two operands.
    fn full(&self, left: &Shape, right: &Shape) -> Result<Shape, TensorError> {
        let operation = Self::NAME;
        let full = left.broadcast(right).ok_or_else(|| TensorError::Broadcast {
            operation,
            shapes: Box::new([left.clone(), right.clone()]),
        })?;
        if self.axis < full.rank() {
            return Ok(full);
        }
        Err(TensorError::Axis { operation, axis: self.axis, shape: full })
    }

    /// The common shape seen as `[outer, extent, inner]`.
    fn blocks(&self, full: &Shape) -> [usize; 3] {
        blocks(full, self.axis, Self::NAME).expect("the common shape has the axis")
    }

    /// How far a step along the axes before `axis`, along it, and along those after it moves in an
    /// operand; `None` where several axes are not one.
    fn steps(&self, operand: &Shape, full: &Shape) -> Option<[usize; 3]> {
        let one = |from: usize, to: usize| {
            let within = axes([full, operand]).skip(from).take(to - from);
            match *Walk::new(within.map(|(extent, [_, step])| (extent, [step]))).axes() {
                [] => Some(0),
                [(_, [step])] => Some(step),
                _ => None,
            }
        };
        let Self { axis } = *self;
        Some([one(0, axis)?, one(axis, axis + 1)?, one(axis + 1, full.rank())?])
    }
}

impl<T: Scalar> Op<T> for Dot {
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
        let (left, right) = (inputs.shape(0), inputs.shape(1));
        let (x, y) = (inputs.data(0), inputs.data(1));
        let full = self.full(left, right)?;
        let z = outputs.try_push(Self::NAME, reduced(&full, self.axis)?)?;
        if let (Some(of_x), Some(of_y)) = (self.steps(left, &full), self.steps(right, &full)) {
            let operands = [(x, of_x), (y, of_y)];
            let operands = operands.map(|(entries, steps)| Operand { entries, steps });
            inner_products(operands, self.blocks(&full), z, |_, sum| T::narrow(sum));
            return Ok(());
        }
        // Axes that several steps lead along on one side: sum by sum.
        let all = || axes([&full, left, right]).map(|(extent, [_, i, j])| (extent, [i, j]));
        let (extent, [down, right_down]) = all().nth(self.axis).expect("there is such an axis");
        let others = Walk::new(all().enumerate().filter(|(at, _)| *at != self.axis).map(|of| of.1));
        let steps = others.steps();
        others.rows_mut(z, |z, [i, j]| {
            for (k, z) in z.iter_mut().enumerate() {
                let (i, j) = (i + k * steps[0], j + k * steps[1]);
                let mut sum = T::Wide::ZERO;
                for term in 0..extent {
                    sum += x[i + term * down].widen() * y[j + term * right_down].widen();
                }
                *z = T::narrow(sum);
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let mut keep = Keep::NOTHING;
        for (own, other) in [(0, 1), (1, 0)] {
            if inputs.needs(own) {
                keep = keep.input(other);
            }
        }
        keep
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let z_bar = kept.only_upstream();
        let full = self.full(kept.input_shape(0), kept.input_shape(1));
        let full = full.expect("the forward pass found that they fit");
        let sums = full.with(self.axis, 1);
        for (own, other) in [(0, 1), (1, 0)] {
            let Some(x_bar) = gradients.get(own) else { continue };
            let (own, y) = (kept.input_shape(own), kept.input(other));
            let other = kept.input_shape(other);
            if *own != full {
                let axes = axes([&full, own, other, &sums]);
                let axes = axes.map(|(extent, [_, i, j, k])| (extent, [i, j, k]));
                let term = |[_, j, k]: [usize; 3]| y[j].widen() * z_bar[k].widen();
                add_over_copies(x_bar.entries(), axes, term);
                continue;
            }
            let (x_bar, fresh) = x_bar.entries_or_fresh();
            let add = |x_bar: &mut T, [y, z_bar]: [T; 2]| {
                let term = y * z_bar;
                *x_bar = if fresh { term } else { *x_bar + term };
            };
            let blocks = self.blocks(&full);
            let [_, extent, _] = blocks;
            if is_in_lines(blocks) && *other == full {
                for_each_line_mut(x_bar, extent, [y], |row, x_bar, [y]| {
                    let z_bar = z_bar[row];
                    x_bar.iter_mut().zip(y).for_each(|(x_bar, &y)| add(x_bar, [y, z_bar]));
                });
            } else if is_in_lines(blocks) && matches!(self.steps(other, &full), Some([0, 1, _])) {
                // A row beside all.
                for_each_line_mut(x_bar, extent, [], |row, x_bar, []| {
                    let z_bar = z_bar[row];
                    x_bar.iter_mut().zip(y).for_each(|(x_bar, &y)| add(x_bar, [y, z_bar]));
                });
            } else {
                let axes = axes([&full, other, &sums]);
                let walk = Walk::new(axes.map(|(extent, [_, j, k])| (extent, [j, k])));
                walk.zip_mut(x_bar, [y, z_bar], add);
            }
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The sums of products of `self` and `other` along `axis` of their common shape, which is removed;
    /// the operands broadcast. Of `[n, 3]` and `[n, 3]` or `[3]`, along axis 1, the inner products of
    /// rows: `[n]`.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast; [`TensorError::Axis`] unless the common
    /// shape has such an axis.
    pub fn dot(self, other: Self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(Dot { axis }, &[self, other])
    }
}

#[cfg(test)]
mod tests {
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn a_dot_is_the_sum_of_a_product_whichever_axes_broadcast() {
        let shapes: [&[usize]; 9] =
            [&[4, 2, 3], &[2, 3], &[3], &[4, 1, 3], &[1, 2, 1], &[4, 1, 1], &[1], &[], &[2, 1]];
        for (left, right) in shapes.iter().flat_map(|&l| shapes.iter().map(move |&r| (l, r))) {
            let rank = left.len().max(right.len());
            for axis in 0..rank {
                let tape = Tape::new();
                let x = tape.leaf(&Tensor::from_flat_fn(left, |k| (k % 7) as f64 - 3.0));
                let y = tape.leaf(&Tensor::from_flat_fn(right, |k| (k % 5) as f64 - 1.0));
                let fused = x.dot(y, axis).unwrap();
                let apart = (x * y).sum_axis(axis).unwrap();
                let upstream = Tensor::from_flat_fn(apart.shape(), |k| 1.0 + k as f64);
                let of = |z| {
                    let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
                    (z.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y))
                };
                assert_eq!(of(fused), of(apart), "{left:?} {right:?} {axis}");
            }
        }
    }

    #[test]
    fn long_sums_keep_their_digits_in_f32() {
        let n = 1 << 18;
        let tape = Tape::<f32>::new();
        let (tenths, ones) = (tape.leaf(&Tensor::full([n, 2], 0.1)), tape.leaf_full([2], 1.0));
        let exact = (f64::from(0.1_f32) * n as f64) as f32;
        assert_eq!(tenths.dot(ones, 0).unwrap().value(), Tensor::full([2], exact));
        let along = tenths.dot(ones, 1).unwrap();
        let gradients = along.sum().backward().unwrap();
        assert_eq!(gradients.get(ones), Some(&Tensor::full([2], exact)));
        // 2^60 and -2^60 cancel, and what is between them stays.
        let terms = tape.constant(&Tensor::from([1.0, 1.0, -1.0]));
        let large = 2.0_f32.powi(40);
        let sum = tape.constant(&Tensor::from([large, 0.25, large])).dot(terms, 0).unwrap();
        assert_eq!(sum.item(), 0.25);
    }

    #[test]
    fn an_empty_axis_gives_zeros() {
        let tape = Tape::<f64>::new();
        let [x, y] = [[2, 0], [2, 1]].map(|shape| tape.leaf(&Tensor::zeros(shape)));
        let z = x.dot(y, 1).unwrap();
        assert_eq!(z.value(), Tensor::zeros([2]));
        let gradients = z.sum().backward().unwrap();
        assert_eq!(gradients.get_or_zeros(y), Tensor::zeros([2, 1]));
        assert_eq!(x.dot(x, 0).unwrap().value(), Tensor::zeros([0]));
    }

    #[test]
    fn a_nan_is_not_masked_by_a_zero() {
        let tape = Tape::new();
        let x = tape.constant(&Tensor::from([0.0, 1.0]));
        let y = tape.constant(&Tensor::from([f64::NAN, 1.0]));
        assert!(x.dot(y, 0).unwrap().item().is_nan());
    }

    #[test]
    fn shapes_must_broadcast_and_have_the_axis() {
        let tape = Tape::<f64>::new();
        let [x, y] = [[2, 3], [2, 4]].map(|shape| tape.constant_full(shape, 0.0));
        let message = "dot needs shapes that broadcast, got [2, 3] and [2, 4]";
        assert_eq!(x.dot(y, 1).unwrap_err().to_string(), message);
        let message = "dot needs an axis below the rank 2, got axis 2 of shape [2, 3]";
        assert_eq!(x.dot(x, 2).unwrap_err().to_string(), message);
    }
}
