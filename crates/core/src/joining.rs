//! Arrays one after another along an axis, and their shares of its gradient.
//!
//! Seen as `[outer, length]`, with a length of its own, each block of the joined array holds a block of
//! every part.

use std::ops::Range;

use crate::gradient::Accumulator;
use crate::op::Inputs;
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::scalar::Scalar;

/// Writes the blocks of all parts, of `length(i)` entries each, after one another.
pub(crate) fn join<T: Scalar>(
    parts: &Inputs<'_, T>,
    length: impl Fn(usize) -> usize + Send + Sync,
    joined: &mut [T],
) {
    if joined.is_empty() {
        return;
    }
    let lengths = || (0..parts.len()).map(&length).enumerate();
    let size = lengths().map(|(_, length)| length).sum();
    // Either a piece has several blocks, or a block several pieces.
    let blocks = ENTRIES_PER_PIECE / size;
    if blocks == 0 {
        for_each_piece_mut(joined, ENTRIES_PER_PIECE, |k, piece| {
            join_range(parts, lengths(), size, k * ENTRIES_PER_PIECE, piece);
        });
        return;
    }
    for_each_piece_mut(joined, blocks * size, |k, piece| {
        let (first, mut start) = (k * blocks, 0);
        for (i, length) in lengths() {
            let part = &parts.data(i)[first * length..];
            match length {
                0 => {}
                1 => piece[start..].iter_mut().step_by(size).zip(part).for_each(|(z, &x)| *z = x),
                _ => {
                    for (block, part) in piece.chunks_mut(size).zip(part.chunks(length)) {
                        block[start..start + length].copy_from_slice(part);
                    }
                }
            }
            start += length;
        }
    });
}

/// Writes entries from `first` on of the joined array, in blocks of `size`.
fn join_range<T: Scalar>(
    parts: &Inputs<'_, T>,
    lengths: impl Iterator<Item = (usize, usize)> + Clone,
    size: usize,
    first: usize,
    joined: &mut [T],
) {
    let end = first + joined.len();
    for block in first / size..=(end - 1) / size {
        let mut start = block * size;
        for (i, length) in lengths.clone() {
            let within: Range<usize> = start.max(first)..(start + length).min(end);
            if within.start < within.end {
                let part = &parts.data(i)[block * length + within.start - start..];
                joined[within.start - first..within.end - first]
                    .copy_from_slice(&part[..within.len()]);
            }
            start += length;
        }
    }
}

/// Adds the blocks of a part, `range` within each block of `size` entries of `joined_bar`, to the part's
/// gradient.
pub(crate) fn add_part<T: Scalar>(
    part_bar: &mut Accumulator<T>,
    joined_bar: &[T],
    range: Range<usize>,
    size: usize,
) {
    let length = range.len();
    let (part_bar, fresh) = part_bar.entries_or_fresh();
    let add = |x_bar: &mut T, &z_bar: &T| *x_bar = if fresh { z_bar } else { *x_bar + z_bar };
    if length == 1 {
        for_each_piece_mut(part_bar, ENTRIES_PER_PIECE, |k, part_bar| {
            let from = joined_bar[range.start + k * ENTRIES_PER_PIECE * size..].iter();
            part_bar
                .iter_mut()
                .zip(from.step_by(size))
                .for_each(|(x_bar, z_bar)| add(x_bar, z_bar));
        });
        return;
    }
    for_each_piece_mut(part_bar, ENTRIES_PER_PIECE, |k, mut part_bar| {
        let mut entry = k * ENTRIES_PER_PIECE;
        while !part_bar.is_empty() {
            let (block, within) = (entry / length, entry % length);
            let (head, rest) = part_bar.split_at_mut((length - within).min(part_bar.len()));
            let from = &joined_bar[block * size + range.start + within..];
            head.iter_mut().zip(from).for_each(|(x_bar, z_bar)| add(x_bar, z_bar));
            entry += head.len();
            part_bar = rest;
        }
    });
}
