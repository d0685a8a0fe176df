//! Checks of the entries of a parameter, for every optimizer.

use bokashi_core::Scalar;

use crate::parameter::Mapping;

/// The first of `count` numbers that is not finite.
pub(super) fn first_not_finite<T: Scalar>(count: usize, number: impl Fn(usize) -> T) -> Option<T> {
    // Without an early exit, so that the usual case is a loop over vectors.
    if (0..count).fold(true, |finite, k| finite & number(k).is_finite()) {
        return None;
    }
    (0..count).map(number).find(|number| !number.is_finite())
}

/// The number that must be finite if an entry becomes `raw`: its value for an exponential mapping, which can be
/// infinite for a finite raw number.
pub(super) fn value_of<T: Scalar>(mapping: Mapping, raw: T) -> T {
    if mapping == Mapping::Exp { raw.exp() } else { raw }
}

/// Whether an update that is not zero left `old` as it was.
pub(super) fn vanishes<T: Scalar>(old: T, new: T, direction: T, rate: T) -> bool {
    (new == old) & (direction != T::ZERO) & (rate != T::ZERO)
}
