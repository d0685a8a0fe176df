//! Sums over the copies of entries that an operation repeated: the adjoint of broadcasting.

use std::array;

use crate::axis::sum_rows;
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::scalar::Scalar;
use crate::summation::sum;
use crate::walk::Walk;

/// Adds to each entry of `sums` the terms of all its copies, summed in [`Scalar::Wide`].
///
/// `axes`, outermost first, are those of the array of all copies: their extents, and how far one step
/// along each moves in `sums`, 0 where its entries are repeated, and in arrays that `term` reads.
/// `term` gets the position in each.
pub(crate) fn add_over_copies<T: Scalar, const N: usize>(
    sums: &mut [T],
    axes: impl DoubleEndedIterator<Item = (usize, [usize; N])> + Clone,
    term: impl Fn([usize; N]) -> T::Wide + Send + Sync,
) {
    // An axis of extent 1 repeats nothing.
    let is_repeated = |&(extent, steps): &(usize, [usize; N])| extent != 1 && steps[0] == 0;
    let entries = Walk::new(axes.clone().filter(|axis| !is_repeated(axis)));
    let copies = Walk::new(axes.filter(is_repeated));
    let (entry_count, copy_count) = (entries.size(), copies.size());
    if entry_count == 0 || copy_count == 0 {
        return;
    }
    let both = |entry: [usize; N], copy: [usize; N]| array::from_fn(|i| entry[i] + copy[i]);
    if entry_count == 1 {
        let total = match *copies.axes() {
            [(_, steps)] => sum::<T>(copy_count, |copy| term(steps.map(|step| copy * step))),
            _ => sum::<T>(copy_count, |copy| term(copies.position(copy))),
        };
        sums[0] += T::narrow(total);
    } else if entry_count < copy_count {
        let put = |entry, total| sums[entry] += T::narrow(total);
        match (entries.axes(), copies.axes()) {
            // A row beside many rows.
            (&[(_, along)], &[(_, down)]) => {
                let term =
                    |row, column| term(array::from_fn(|i| row * down[i] + column * along[i]));
                sum_rows::<T>(copy_count, entry_count, term, put);
            }
            _ => {
                let term = |copy, entry| term(both(entries.position(entry), copies.position(copy)));
                sum_rows::<T>(copy_count, entry_count, term, put);
            }
        }
    } else {
        let piece = (ENTRIES_PER_PIECE / copy_count).max(1);
        for_each_piece_mut(sums, piece, |k, sums| {
            for (entry, sum) in (k * piece..).zip(sums) {
                let entry = entries.position(entry);
                let mut total = T::Wide::ZERO;
                match *copies.axes() {
                    [(count, steps)] => {
                        let mut position = entry;
                        for _ in 0..count {
                            total += term(position);
                            position = both(position, steps);
                        }
                    }
                    _ => copies.for_each(|copy| total += term(both(entry, copy))),
                }
                *sum += T::narrow(total);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_a_nest_of_loops_whichever_axes_are_repeated() {
        for extents in [[2, 3, 4], [1, 3, 1], [40, 30, 20], [3, 1, 9000], [9000, 1, 3], [2, 0, 3]] {
            let [a, b, c] = extents;
            let numbers: Vec<f32> = (0..a * b * c).map(|k| ((k * 7919) % 1009) as f32).collect();
            let full = [b * c, c, 1];
            for repeated in 0..8 {
                let kept: [usize; 3] =
                    array::from_fn(|k| if repeated >> k & 1 == 1 { 1 } else { extents[k] });
                let steps = [kept[1] * kept[2], kept[2], 1];
                let step = |k: usize| if kept[k] == extents[k] { steps[k] } else { 0 };
                let axes = (0..3).map(|k| (extents[k], [step(k), full[k]]));
                let mut expected = vec![1.0; kept.iter().product()];
                let mut sums = expected.clone();
                for k in 0..a * b * c {
                    let at = [k / (b * c), k / c % b, k % c];
                    expected[(0..3).map(|axis| at[axis] * step(axis)).sum::<usize>()] += numbers[k];
                }
                add_over_copies(&mut sums, axes, |[_, k]| f64::from(numbers[k]));
                assert_eq!(sums, expected, "{extents:?} {repeated:b}");
            }
        }
    }
}
