//! Copies of little, between images and strips.

/// Copies a few entries, without the call that a copy of a length unknown to the compiler is.
#[inline(always)]
pub(super) fn copy<T: Copy>(from: &[T], to: &mut [T]) {
    for (to, &from) in to.iter_mut().zip(from) {
        *to = from;
    }
}
