//! Numbers of fragments, an array for each of them.
//!
//! Fragments lie in memory one by one, `[N, C]`, and most faces have few. So loops over a face's fragments become
//! vectors where each number has an array of its own, a *plane*. Numbers of many fragments are copied at once.

use bokashi_core::Scalar;

/// So many fragments are copied at once, and stay in the first-level cache: a multiple of [`LANES`].
pub(crate) const CAPACITY: usize = 256;

/// Fragments that are worked on side by side: as many as the widest vectors hold wide numbers.
pub(crate) const LANES: usize = 8;

const _: () = assert!(CAPACITY.is_multiple_of(LANES));

/// A number of each fragment. Vectors may reach across the end.
pub(crate) type Plane<T> = [T; CAPACITY + LANES];

pub(crate) fn zeros<T: Scalar, const C: usize>() -> [Plane<T>; C] {
    [[T::ZERO; CAPACITY + LANES]; C]
}

/// Copies rows into planes.
#[inline(always)]
pub(crate) fn split<T: Scalar, const C: usize>(planes: &mut [Plane<T>; C], rows: &[[T; C]]) {
    let planes = planes.each_mut().map(|plane| &mut plane[..rows.len()]);
    for (k, row) in rows.iter().enumerate() {
        for c in 0..C {
            planes[c][k] = row[c];
        }
    }
}

/// Copies planes into rows.
#[inline(always)]
pub(crate) fn join<T: Scalar, const C: usize>(planes: &[Plane<T>; C], rows: &mut [[T; C]]) {
    let planes = planes.each_ref().map(|plane| &plane[..rows.len()]);
    for (k, row) in rows.iter_mut().enumerate() {
        for c in 0..C {
            row[c] = planes[c][k];
        }
    }
}

/// Reads some numbers, from `first` on.
#[inline(always)]
pub(crate) fn load<T: Scalar, const N: usize>(plane: &Plane<T>, first: usize) -> [T; N] {
    *plane[first..].first_chunk().expect("there is room")
}
