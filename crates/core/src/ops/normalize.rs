//! Vectors along the last axis divided by their Euclidean length: `y = x / |x|`;
//! `x_bar += (y_bar - y <y, y_bar>) / |x|`.
//!
//! Formed in [`Scalar::Wide`], and scaled where squares would over- or underflow (`length.rs`).
//!
//! # Where it is not smooth
//! At `x = 0`, where `y` is 0 and the gradient is taken as 0.

use crate::axis::{for_each_line_mut, for_each_short_line_mut};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::length::length;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;
use crate::vectors::components;

const NAME: &str = "normalize";

struct Normalize;

/// Adds to the gradient of a vector `x`, or writes it, from that of `x / |x|`.
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
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let extent = components(shape, NAME)?;
        for_each_line_mut(outputs.push(shape), extent, [x], |_, y, [x]| {
            let length = length(x);
            for (y, x) in y.iter_mut().zip(x) {
                *y = T::narrow(length.divide(length.scaled(x.widen())));
            }
        });
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        // Lengths are formed again: that is quicker than to read them.
        Keep::NOTHING.input(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let extent = components(kept.input_shape(0), NAME).expect("the forward pass found them");
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        let from = [kept.input(0), kept.only_upstream()];
        match extent {
            // By itself, so that its loops are of a known length.
            3 => for_each_short_line_mut::<T, 3, 2>(x_bar, from, |_, x_bar, from| {
                pull_back(x_bar, from, fresh);
            }),
            _ => for_each_line_mut(x_bar, extent, from, |_, x_bar, from| {
                pull_back(x_bar, from, fresh);
            }),
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Vectors along the last axis divided by their Euclidean lengths, in the same shape. A vector of zeros
    /// stays, and has the gradient 0. Nothing over- or underflows before the result does.
    ///
    /// # Errors
    /// [`TensorError::Shape`] for a scalar.
    pub fn normalize(self) -> Result<Self, TensorError> {
        self.tape.apply(Normalize, &[self])
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
        let y = x.normalize().unwrap();
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
    fn long_vectors_are_those_of_a_quotient_by_the_length() {
        let tape = Tape::new();
        for shape in [[3, 5], [2, 40], [70, 4], [1, 1], [2, 20_000]] {
            let x = tape.leaf(&Tensor::from_flat_fn(shape, |k| (k as f64 * 0.7 + 0.1).sin()));
            let quotient = x / x.norm().unwrap().keepdim(1).unwrap();
            let upstream = x.value().map(|x| (3.0 * x).cos());
            let [a, b] = [x.normalize().unwrap(), quotient]
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
            let y = x.normalize().unwrap();
            let upstream = Tensor::from([1.0, 0.0, 0.0]);
            let x_bar = tape.vjp(&[(y, &upstream)]).unwrap().get_or_zeros(x);
            (y.value(), x_bar.map(|x_bar| x_bar * scale))
        };
        let plain = of(1.0);
        for exponent in [-1000, -600, -480, 0, 480, 600, 1000] {
            assert_eq!(of(2.0_f64.powi(exponent)), plain, "2^{exponent}");
        }
        let largest = tape.leaf(&Tensor::from([f64::MAX; 4])).normalize().unwrap();
        assert_eq!(largest.value(), Tensor::full([4], 0.5));
        let single = Tape::<f32>::new();
        let tiny = single.leaf(&Tensor::from([3e-45_f32, 0.0])).normalize().unwrap();
        assert_eq!(tiny.value(), Tensor::from([1.0, 0.0]));
    }

    #[test]
    fn a_nan_is_not_masked() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from([[f64::NAN, 0.0], [0.0, 0.0]]));
        let y = x.normalize().unwrap();
        assert!(y.value()[[0, 0]].is_nan());
        let upstream = Tensor::from([[0.0, 0.0], [0.0, f64::NAN]]);
        assert!(tape.vjp(&[(y, &upstream)]).unwrap().get(x).unwrap()[[1, 1]].is_nan());
    }
}
