//! Euclidean length along an axis: `y = |x| = sqrt(sum_k x_k^2)`; `x_bar_k += y_bar x_k / |x|`.
//!
//! Squares are summed in [`Scalar::Wide`] and scaled where they would over- or underflow
//! (`length.rs`). The backward pass forms the lengths again, since a rounded one that is denormal, or
//! infinite, would not do.
//!
//! # Where it is not smooth
//! At `x = 0`, where the gradient is taken as 0, the middle of the subgradients.

use crate::axis::{blocks, for_each_line_mut, is_in_lines, reduced};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::length::{Length, length, lengths};
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;
use crate::walk::Walk;

struct Norm {
    axis: usize,
}

impl Norm {
    const NAME: &'static str = "norm";
}

impl<T: Scalar> Op<T> for Norm {
    /// The lengths, where a backward pass does not form them line by line.
    type Saved = Vec<Length<T::Wide>>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let blocks = blocks(shape, self.axis, Self::NAME)?;
        let y = outputs.try_push(Self::NAME, reduced(shape, self.axis)?)?;
        lengths(x, blocks, y, |length| T::narrow(length.value()));
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(x_bar) = gradients.get(0) else { return };
        let (x, y_bar) = (kept.input(0), kept.only_upstream());
        let blocks = blocks(kept.input_shape(0), self.axis, Self::NAME);
        let blocks = blocks.expect("the forward pass found the axis");
        let [outer, extent, inner] = blocks;
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        if x_bar.is_empty() {
            return;
        }
        // x_bar += x (y_bar / |x|), where neither factor leaves the range of the numbers.
        let add = |x_bar: &mut T, x: T, length: Length<T::Wide>, share: T::Wide| {
            let term = T::narrow(length.scaled(x.widen()) * share);
            *x_bar = if fresh { term } else { *x_bar + term };
        };
        if is_in_lines(blocks) {
            for_each_line_mut(x_bar, extent, [x], |row, x_bar, [x]| {
                let length = length(x);
                let share = length.divide(y_bar[row].widen());
                x_bar.iter_mut().zip(x).for_each(|(x_bar, &x)| add(x_bar, x, length, share));
            });
            return;
        }
        saved.resize(y_bar.len(), Length::default());
        lengths(x, blocks, saved, |length| length);
        let axes = [(outer, [extent * inner, inner]), (extent, [inner, 0]), (inner, [1, 1])];
        let walk = Walk::new(axes.into_iter());
        let [_, step] = walk.steps();
        walk.rows_mut(x_bar, |x_bar, [from, line]| {
            for (k, (x_bar, &x)) in x_bar.iter_mut().zip(&x[from..]).enumerate() {
                let line = line + k * step;
                add(x_bar, x, saved[line], saved[line].divide(y_bar[line].widen()));
            }
        });
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The Euclidean lengths along `axis`, which is removed from the shape; the gradient of the length
    /// 0 is 0. Neither over- nor underflows before the result does.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis.
    pub fn norm(self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(Norm { axis }, &[self])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn lengths_and_gradients_by_hand_along_either_axis() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from([[3.0, -4.0], [0.0, 0.0], [5.0, 12.0]]));
        let y = x.norm(1).unwrap();
        assert_eq!(y.value(), Tensor::from([5.0, 0.0, 13.0]));
        let gradients = tape.vjp(&[(y, &Tensor::from([1.0, 1.0, 2.0]))]).unwrap();
        let expected = [3.0 / 5.0, -4.0 / 5.0, 0.0, 0.0, 10.0 / 13.0, 24.0 / 13.0];
        let assert_near = |x_bar: Tensor<f64>| {
            let pairs = x_bar.data().iter().zip(expected);
            pairs.for_each(|(x_bar, expected)| assert!((x_bar - expected).abs() < 1e-15));
        };
        assert_near(gradients.get_or_zeros(x));
        let turned = x.transpose().unwrap().norm(0).unwrap();
        assert_eq!(turned.value(), y.value());
        let gradients = tape.vjp(&[(turned, &Tensor::from([1.0, 1.0, 2.0]))]).unwrap();
        assert_near(gradients.get_or_zeros(x));
    }

    #[test]
    fn lengths_are_roots_of_inner_products_however_the_array_lies() {
        for (shape, axis) in [([2, 40_000], 1), ([40_000, 2], 0), ([3, 20_000], 0), ([40, 7], 1)] {
            let tape = Tape::new();
            let x = tape.leaf(&Tensor::from_flat_fn(shape, |k| (k as f64).sin() + 0.1));
            let lengths = x.norm(axis).unwrap();
            let roots = x.dot(x, axis).unwrap().sqrt();
            let upstream = Tensor::from_flat_fn(lengths.shape(), |k| 1.0 + (k % 7) as f64);
            let [found, expected] = [lengths, roots].map(|y| {
                let gradients = tape.vjp(&[(y, &upstream)]).unwrap();
                [y.value(), gradients.get_or_zeros(x)]
            });
            for (found, expected) in found.iter().zip(&expected) {
                let pairs = found.data().iter().zip(expected.data());
                pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-13 * b.abs().max(1.0)));
            }
        }
    }

    #[test]
    fn neither_large_nor_small_entries_lose_the_length() {
        fn of<T: Scalar, const N: usize>(vector: [f64; N]) -> (f64, [f64; N]) {
            let tape = Tape::<T>::new();
            let x = tape.leaf(&Tensor::from(vector.map(T::from_f64)));
            let y = x.norm(0).unwrap();
            let x_bar = y.backward().unwrap().get_or_zeros(x);
            (y.item().to_f64(), std::array::from_fn(|k| x_bar.data()[k].to_f64()))
        }
        for scale in [1e-300, 1e-200, 1.0, 1e200, 1e300] {
            let (length, x_bar) = of::<f64, 3>([2.0 * scale, -3.0 * scale, 6.0 * scale]);
            assert!((length / scale - 7.0).abs() < 1e-14, "{scale}: {length}");
            assert!((x_bar[1] + 3.0 / 7.0).abs() < 1e-15, "{scale}: {x_bar:?}");
        }
        for scale in [1e-38_f32, 1e-20, 1e20, 4e37] {
            let scale = f64::from(scale);
            let (length, x_bar) = of::<f32, 3>([2.0 * scale, -3.0 * scale, 6.0 * scale]);
            assert!((length / scale - 7.0).abs() < 1e-6, "{scale}: {length}");
            assert!((x_bar[1] + 3.0 / 7.0).abs() < 1e-7, "{scale}: {x_bar:?}");
        }
        // The gradient is right even where the length itself is beyond the largest number.
        assert_eq!(of::<f64, 4>([f64::MAX; 4]), (f64::INFINITY, [0.5; 4]));
    }

    #[test]
    fn no_entries_have_length_zero() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&Tensor::zeros([2, 0]));
        let y = x.norm(1).unwrap();
        assert_eq!(y.value(), Tensor::zeros([2]));
        assert_eq!(y.sum().backward().unwrap().get_or_zeros(x).size(), 0);
        assert_eq!(x.norm(0).unwrap().value(), Tensor::zeros([0]));
        assert!(x.norm(2).is_err());
    }

    #[test]
    fn a_nan_is_not_masked() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from([[f64::NAN, 1.0], [0.0, 0.0]]));
        let y = x.norm(1).unwrap();
        assert!(y.value().data()[0].is_nan());
        let gradients = tape.vjp(&[(y, &Tensor::from([1.0, f64::NAN]))]).unwrap();
        assert!(gradients.get(x).unwrap().data().iter().all(|x_bar| x_bar.is_nan()));
    }
}
