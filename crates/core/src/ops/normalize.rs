//! Vectors along an axis divided by their Euclidean length: `y = x / |x|`;
//! `x_bar += (y_bar - y <y, y_bar>) / |x|`.
//!
//! Formed in [`Scalar::Wide`], and scaled where squares would over- or underflow (`length.rs`).
//!
//! # Where it is not smooth
//! At `x = 0`, where `y` is 0 and the gradient is taken as 0.

use crate::axis::{blocks, for_each_line_mut, for_each_short_line_mut, is_in_lines};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::inner_product::{Operand, inner_products};
use crate::length::{Length, length, lengths};
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;
use crate::walk::Walk;

struct Normalize {
    axis: usize,
}

impl Normalize {
    const NAME: &'static str = "normalize";

    /// `shape` seen as `[outer, extent, inner]`.
    fn blocks(&self, shape: &Shape) -> Result<[usize; 3], TensorError> {
        blocks(shape, self.axis, Self::NAME)
    }
}

/// What is kept of lines that do not lie in one piece, or are long.
#[derive(Debug)]
struct Lines<W> {
    lengths: Vec<Length<W>>,
    /// `<y, y_bar>`, of a backward pass.
    products: Vec<W>,
}

impl<W> Default for Lines<W> {
    fn default() -> Self {
        Self { lengths: Vec::new(), products: Vec::new() }
    }
}

/// The walk over the entries of `[outer, extent, inner]` and the lines that they are of.
fn entries_and_lines([outer, extent, inner]: [usize; 3]) -> Walk<2> {
    let axes = [(outer, [extent * inner, inner]), (extent, [inner, 0]), (inner, [1, 1])];
    Walk::new(axes.into_iter())
}

/// Adds to the gradient of a line `x`, or writes it, from that of `x / |x|`.
#[inline(always)]
fn pull_back<T: Scalar>(x_bar: &mut [T], [x, y_bar]: [&[T]; 2], fresh: bool) {
    let length = length(x);
    let per_size = length.divide(T::Wide::ONE);
    let mut product = T::Wide::ZERO;
    for (x, y_bar) in x.iter().zip(y_bar) {
        product += length.scaled(x.widen()) * y_bar.widen();
    }
    let share = product * per_size * per_size;
    for ((x_bar, x), y_bar) in x_bar.iter_mut().zip(x).zip(y_bar) {
        let across = y_bar.widen() - length.scaled(x.widen()) * share;
        let term = T::narrow(length.scaled(across * per_size));
        *x_bar = if fresh { term } else { *x_bar + term };
    }
}

impl<T: Scalar> Op<T> for Normalize {
    type Saved = Lines<T::Wide>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let blocks = self.blocks(shape)?;
        let [outer, extent, inner] = blocks;
        let y = outputs.push(shape);
        if y.is_empty() {
            return Ok(());
        }
        let quotient =
            |x: T, length: Length<T::Wide>| T::narrow(length.divide(length.scaled(x.widen())));
        if is_in_lines(blocks) {
            for_each_line_mut(y, extent, [x], |_, y, [x]| {
                let length = length(x);
                y.iter_mut().zip(x).for_each(|(y, &x)| *y = quotient(x, length));
            });
            return Ok(());
        }
        saved.lengths.resize(outer * inner, Length::default());
        lengths(x, blocks, &mut saved.lengths, |length| length);
        let walk = entries_and_lines(blocks);
        let [_, step] = walk.steps();
        walk.rows_mut(y, |y, [from, line]| {
            for (k, (y, &x)) in y.iter_mut().zip(&x[from..]).enumerate() {
                *y = quotient(x, saved.lengths[line + k * step]);
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        // Lengths of lines at hand are formed again: that is quicker than to read them.
        match self.blocks(inputs.shape(0)) {
            Ok(blocks) if is_in_lines(blocks) => Keep::NOTHING.input(0),
            _ => Keep::NOTHING.output(0),
        }
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(x_bar) = gradients.get(0) else { return };
        let blocks = self.blocks(kept.input_shape(0)).expect("the forward pass found the axis");
        let [outer, extent, inner] = blocks;
        let y_bar = kept.only_upstream();
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        if x_bar.is_empty() {
            return;
        }
        if is_in_lines(blocks) {
            let x = kept.input(0);
            match extent {
                // By itself, so that its loops are of a known length.
                3 => for_each_short_line_mut::<T, 3, 2>(x_bar, [x, y_bar], |_, x_bar, from| {
                    pull_back(x_bar, from, fresh);
                }),
                _ => for_each_line_mut(x_bar, extent, [x, y_bar], |_, x_bar, from| {
                    pull_back(x_bar, from, fresh);
                }),
            }
            return;
        }
        let (y, Lines { lengths, products }) = (kept.output(0), saved);
        products.resize(outer * inner, T::Wide::ZERO);
        let operands = [y, y_bar].map(|entries| Operand::whole(entries, blocks));
        inner_products(operands, blocks, products, |_, product| product);
        let walk = entries_and_lines(blocks);
        let [_, step] = walk.steps();
        walk.rows_mut(x_bar, |x_bar, [from, line]| {
            let from = y[from..].iter().zip(&y_bar[from..]);
            for (k, (x_bar, (y, y_bar))) in x_bar.iter_mut().zip(from).enumerate() {
                let (length, product) = (lengths[line + k * step], products[line + k * step]);
                let across = y_bar.widen() - y.widen() * product;
                let term = T::narrow(length.scaled(length.divide(across)));
                *x_bar = if fresh { term } else { *x_bar + term };
            }
        });
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        size_of_val(&saved.lengths[..])
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Vectors along `axis` divided by their Euclidean lengths, in the same shape. A vector of zeros
    /// stays, and has the gradient 0. Nothing over- or underflows before the result does.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis.
    pub fn normalize(self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(Normalize { axis }, &[self])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn value_and_gradient_by_hand_and_nothing_of_a_vector_of_zeros() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from([[3.0, 4.0], [0.0, 0.0], [0.0, -7.0]]));
        let y = x.normalize(1).unwrap();
        assert_eq!(y.value(), Tensor::from([[3.0 / 5.0, 4.0 / 5.0], [0.0, 0.0], [0.0, -1.0]]));
        let upstream = Tensor::from([[1.0, 0.0], [1.0, 2.0], [14.0, 3.0]]);
        let x_bar = tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x);
        // Across (3, 4) / 5 the upstream gradient is 4/5 of (4, -3) / 5.
        let expected = [16.0 / 125.0, -12.0 / 125.0, 0.0, 0.0, 2.0, 0.0];
        for (x_bar, expected) in x_bar.data().iter().zip(expected) {
            assert!((x_bar - expected).abs() < 1e-15, "{x_bar} {expected}");
        }
    }

    #[test]
    fn vectors_along_another_axis_are_those_of_the_transpose() {
        let tape = Tape::new();
        for shape in [[3, 5], [2, 40], [70, 3], [1, 4], [2, 20_000]] {
            let x = tape.leaf(&Tensor::from_flat_fn(shape, |k| (k as f64 * 0.7).sin()));
            let rows = x.normalize(1).unwrap();
            let columns = x.transpose().unwrap().normalize(0).unwrap().transpose().unwrap();
            let upstream = x.value().map(|x| (3.0 * x).cos());
            let [a, b] = [rows, columns]
                .map(|y| (y.value(), tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x)));
            for (a, b) in [(&a.0, &b.0), (&a.1, &b.1)] {
                let pairs = a.data().iter().zip(b.data());
                pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{a} {b}"));
            }
        }
    }

    #[test]
    fn a_multiple_of_a_vector_has_the_same_direction_down_to_the_smallest_numbers() {
        let tape = Tape::new();
        let vector = [2.0, -3.0, 6.0];
        let of = |scale: f64| {
            let x = tape.leaf(&Tensor::from(vector.map(|x| x * scale)));
            let y = x.normalize(0).unwrap();
            let upstream = Tensor::from([1.0, 0.0, 0.0]);
            let x_bar = tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x);
            (y.value(), x_bar.map(|x_bar| x_bar * scale))
        };
        let plain = of(1.0);
        for exponent in [-1000, -600, -480, 0, 480, 600, 1000] {
            assert_eq!(of(2.0_f64.powi(exponent)), plain, "2^{exponent}");
        }
        let largest = tape.leaf(&Tensor::from([f64::MAX; 4])).normalize(0).unwrap();
        assert_eq!(largest.value(), Tensor::full([4], 0.5));
        let single = Tape::<f32>::new();
        let tiny = single.leaf(&Tensor::from([3e-45_f32, 0.0])).normalize(0).unwrap();
        assert_eq!(tiny.value(), Tensor::from([1.0, 0.0]));
    }

    #[test]
    fn a_nan_is_not_masked() {
        let tape = Tape::new();
        for axis in [0, 1] {
            let x = tape.leaf(&Tensor::from([[f64::NAN, 0.0], [0.0, 0.0]]));
            let y = x.normalize(axis).unwrap();
            assert!(y.value()[[0, 0]].is_nan());
            let upstream = Tensor::from([[0.0, 0.0], [0.0, f64::NAN]]);
            assert!(tape.vjp(&[(y, &upstream)]).unwrap().get(x).unwrap()[[1, 1]].is_nan());
        }
    }

    #[test]
    fn an_axis_must_exist_and_may_be_empty() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&Tensor::zeros([2, 0]));
        assert_eq!(x.normalize(1).unwrap().value(), Tensor::zeros([2, 0]));
        assert_eq!(x.normalize(0).unwrap().value(), Tensor::zeros([2, 0]));
        let message = "normalize needs an axis below the rank 2, got axis 2 of shape [2, 0]";
        assert_eq!(x.normalize(2).unwrap_err().to_string(), message);
    }
}
