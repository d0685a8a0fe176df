//! Short copies between images and strips.

/// Copies a few entries inline: a copy whose length the compiler does not know is a call.
#[inline(always)]
pub(crate) fn copy<T: Copy>(from: &[T], to: &mut [T]) {
    for (to, &from) in to.iter_mut().zip(from) {
        *to = from;
    }
}
