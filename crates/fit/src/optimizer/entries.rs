//! What every optimizer asks of the entries of a parameter.

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

/// What has to be finite where an entry becomes `raw`: its value, which only an exponential makes
/// infinite of a finite raw number.
pub(super) fn value_of<T: Scalar>(mapping: Mapping, raw: T) -> T {
    if mapping == Mapping::Exp { raw.exp() } else { raw }
}

/// Whether an update left `old` as it was though it should have moved it.
pub(super) fn vanishes<T: Scalar>(old: T, new: T, direction: T, rate: T) -> bool {
    (new == old) & (direction != T::ZERO) & (rate != T::ZERO)
}
