//! Which side of a comparison gets the upstream gradient, for minimum and maximum.

use std::cmp::Ordering;

use crate::scalar::Scalar;

/// The share of the upstream gradient that goes to `input`: all of it where `input` compares to
/// `other` as `preferred`, half where they are equal, NaN where one is NaN.
#[inline(always)]
pub(crate) fn share<T: Scalar>(input: T, other: T, preferred: Ordering) -> T {
    let is_preferred = if preferred == Ordering::Less { input < other } else { input > other };
    // Three choices side by side, of which one at most is not zero: comparisons can't be foretold.
    let all = if is_preferred { T::ONE } else { T::ZERO };
    let half = if input == other { T::from_f64(0.5) } else { T::ZERO };
    let nan = input + other;
    let nan = if (input <= other) | (input > other) { T::ZERO } else { nan };
    all + half + nan
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shares_of_both_sides_add_up_to_one() {
        for (a, b) in [(1.0, 2.0), (2.0, 1.0), (3.0, 3.0), (0.0, -0.0), (-1.0, f64::INFINITY)] {
            for preferred in [Ordering::Less, Ordering::Greater] {
                assert_eq!(share(a, b, preferred) + share(b, a, preferred), 1.0);
            }
        }
    }

    #[test]
    fn a_nan_on_either_side_gives_nan() {
        for (a, b) in [(f64::NAN, 1.0), (1.0, f64::NAN)] {
            assert!(share(a, b, Ordering::Less).is_nan());
        }
    }
}
