//! Slopes of absolute values.

use bokashi_core::Scalar;

/// 1, -1, or at 0 the middle of the subgradients of `|d|`: 0. NaN for NaN.
#[inline(always)]
pub(crate) fn sign<S: Scalar>(d: S) -> S {
    if d > S::ZERO {
        S::ONE
    } else if d < S::ZERO {
        -S::ONE
    } else {
        d * S::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sign_is_1_minus_1_or_0_and_a_nan_stays_one() {
        assert_eq!([2.0, -1e-300, 0.0, -0.0, f64::INFINITY].map(sign), [1.0, -1.0, 0.0, 0.0, 1.0]);
        assert!(sign(f64::NAN).is_nan());
    }
}
