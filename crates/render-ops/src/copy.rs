//! Short copies between images and strips.

/// Copies a few entries inline: a copy whose length the compiler does not know is a call.
#[inline(always)]
pub(crate) fn copy<T: Copy>(from: &[T], to: &mut [T]) {
    for (to, &from) in to.iter_mut().zip(from) {
        *to = from;
    }
}

/// Writes as much of a block as there is room for.
#[inline(always)]
pub(crate) fn put<T: Copy, const BLOCK: usize>(to: &mut [T], block: &[T; BLOCK]) {
    match to.first_chunk_mut::<BLOCK>() {
        Some(to) => *to = *block,
        None => to.copy_from_slice(&block[..to.len()]),
    }
}
