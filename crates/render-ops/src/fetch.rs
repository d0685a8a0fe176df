//! Reads from memory what is about to be needed.
//!
//! The faces of a band lie anywhere in the arrays of a large mesh. A processor reads ahead only what lies in order. It
//! waits for many loads at once if hardly anything stands between them, but for one or two where the work on a face
//! does. So what some faces need is read first, and then worked on in the cache.

use std::hint::black_box;

/// Faces that are fetched at once: what they need stays in the cache that is nearest.
pub(crate) const AT_ONCE: usize = 32;

/// Meshes of fewer faces stay in a core's cache, and nothing of them is fetched.
const MANY_FACES: usize = 1 << 14;

/// Whether what is known of these faces is worth fetching.
#[inline(always)]
pub(crate) fn is_large(faces: &[[u32; 3]]) -> bool {
    faces.len() >= MANY_FACES
}

/// Images of fewer bytes stay in a core's cache, too.
const MANY_BYTES: usize = 1 << 20;

/// Whether the entries of an image are worth fetching.
#[inline(always)]
pub(crate) fn is_large_image<T>(entries: &[T]) -> bool {
    size_of_val(entries) >= MANY_BYTES
}

/// Reads a number.
#[inline(always)]
pub(crate) fn fetch<E: Copy>(entry: E) {
    black_box(entry);
}

/// Reads entries that lie side by side, one from each cache line.
#[inline(always)]
pub(crate) fn fetch_all<E, N: Copy>(entries: &[E], number: impl Fn(&E) -> N) {
    const CACHE_LINE: usize = 64;
    let step = (CACHE_LINE / size_of::<E>()).max(1);
    entries.iter().step_by(step).for_each(|entry| fetch(number(entry)));
}
