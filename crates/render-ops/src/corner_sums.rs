//! Sums over the corners at vertices.

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulator, Scalar};

use crate::corners::Corners;

/// Vertices in one piece of work.
const VERTICES_PER_PIECE: usize = 1 << 11;

/// Adds `row(v, corners at v)` to row v of `gradient: [V, N]`.
#[inline(always)]
pub(crate) fn add_by_vertex<T: Scalar, const N: usize>(
    gradient: &mut Accumulator<T>,
    corners: &Corners,
    row: impl Fn(usize, &[usize]) -> [T::Wide; N] + Sync + Send,
) {
    let (entries, fresh) = gradient.entries_or_fresh();
    for_each_piece_mut(entries, N * VERTICES_PER_PIECE, |piece, entries| {
        for (k, entries) in entries.as_chunks_mut::<N>().0.iter_mut().enumerate() {
            let vertex = piece * VERTICES_PER_PIECE + k;
            let row = row(vertex, corners.around(vertex)).map(T::narrow);
            if fresh {
                *entries = row;
            } else {
                entries.iter_mut().zip(row).for_each(|(entry, term)| *entry += term);
            }
        }
    });
}

/// Adds to row v of `gradient: [V, N]` the sum of the rows of the corners at v.
pub(crate) fn add_rows_by_vertex<T: Scalar, const N: usize>(
    gradient: &mut Accumulator<T>,
    corners: &Corners,
    rows: &[[T::Wide; N]],
) {
    add_by_vertex(gradient, corners, |_, corners| sum_over(corners, |corner| rows[corner]));
}

/// The sum of the rows of some corners, in their order.
#[inline(always)]
pub(crate) fn sum_over<S: Scalar, const N: usize>(
    corners: &[usize],
    row: impl Fn(usize) -> [S; N],
) -> [S; N] {
    let mut sum = [S::ZERO; N];
    for &corner in corners {
        sum.iter_mut().zip(row(corner)).for_each(|(sum, term)| *sum += term);
    }
    sum
}
