//! The smaller of each pair of entries of two arrays: `z = minimum(x, y)`; the smaller entry gets
//! `z_bar`.
//!
//! # Where it is not smooth
//! At `x = y`, where each side gets half of `z_bar`: the middle of the subgradients. So swapped
//! arguments have swapped gradients. A NaN on either side makes value and slopes NaN.

use std::cmp::Ordering;

use crate::broadcast::Binary;
use crate::error::TensorError;
use crate::preference::share;
use crate::scalar::Scalar;
use crate::var::Var;

#[derive(Clone, Copy)]
struct Smaller;

impl<T: Scalar> Binary<T> for Smaller {
    const NAME: &'static str = "minimum";
    const LEFT_SLOPE_FROM: [bool; 2] = [true, true];
    const RIGHT_SLOPE_FROM: [bool; 2] = [true, true];

    fn value(self, x: T, y: T) -> T {
        // As IEEE 754-2019 has it, -0 is smaller than 0.
        if x == y && x.to_f64().is_sign_negative() { x } else { x.minimum_or_nan(y) }
    }
    fn left_slope(self, x: T, y: T) -> T {
        share(x, y, Ordering::Less)
    }
    fn right_slope(self, x: T, y: T) -> T {
        share(y, x, Ordering::Less)
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The smaller of `self` and `other`, entry by entry, with broadcasting.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn minimum(self, other: Self) -> Result<Self, TensorError> {
        self.pairwise(other, Smaller)
    }
}

#[cfg(test)]
mod tests {
    use crate::broadcast::value_and_slopes;

    #[test]
    fn the_smaller_side_gets_the_gradient_and_equal_sides_share_it() {
        let of = |x, y| value_and_slopes(x, y, |x, y| x.minimum(y).unwrap());
        assert_eq!(of(1.0, 2.0), [1.0, 1.0, 0.0]);
        assert_eq!(of(2.0, 1.0), [1.0, 0.0, 1.0]);
        assert_eq!(of(3.0, 3.0), [3.0, 0.5, 0.5]);
    }

    #[test]
    fn a_nan_on_either_side_is_not_masked() {
        for (x, y) in [(f64::NAN, 1.0), (1.0, f64::NAN)] {
            let of = value_and_slopes(x, y, |x, y| x.minimum(y).unwrap());
            assert!(of.iter().all(|number| number.is_nan()));
        }
    }

    #[test]
    fn negative_zero_is_smaller_than_zero() {
        let (plus, minus) = (0.0_f64.to_bits(), (-0.0_f64).to_bits());
        let pairs: [(f64, f64); 4] = [(-0.0, 0.0), (0.0, -0.0), (0.0, 0.0), (-0.0, -0.0)];
        let found =
            pairs.map(|(x, y)| value_and_slopes(x, y, |x, y| x.minimum(y).unwrap())[0].to_bits());
        assert_eq!(found, [minus, minus, plus, minus]);
    }
}
