//! Inner products of two arrays along an axis: `s_(o,c) = sum_k x_(o,k,c) y_(o,k,c)`.
//!
//! Summed in [`Scalar::Wide`]. Either array may be repeated along any of the three axes, by steps of 0.

use std::array;

use crate::axis::sum_rows;
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::scalar::Scalar;
use crate::summation::sum;

/// From so many terms on a sum is formed in several parts side by side.
const LONG: usize = 8;
/// From so many inner products in a row on they are enough to share among threads; fewer long ones are
/// shared term by term.
const MANY: usize = 512;

/// An array seen as `[outer, extent, inner]`: its entries, and how far a step along each axis moves.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Operand<'a, T> {
    pub(crate) entries: &'a [T],
    pub(crate) steps: [usize; 3],
}

impl<'a, T> Operand<'a, T> {
    /// An array of `[outer, extent, inner]`, row-major.
    pub(crate) fn whole(entries: &'a [T], [_, extent, inner]: [usize; 3]) -> Self {
        Self { entries, steps: [extent * inner, inner, 1] }
    }
}

/// Computes the inner products of `x` and `y` over the middle axis of `[outer, extent, inner]`, and puts
/// `finish(place, inner product)` at each place of `products: [outer, inner]`.
pub(crate) fn inner_products<T: Scalar, S: Send>(
    [x, y]: [Operand<'_, T>; 2],
    [_, extent, inner]: [usize; 3],
    products: &mut [S],
    finish: impl Fn(usize, T::Wide) -> S + Send + Sync,
) {
    if products.is_empty() {
        return;
    }
    let term = |i: usize, j: usize| x.entries[i].widen() * y.entries[j].widen();
    let is_few = inner < MANY && extent * inner > ENTRIES_PER_PIECE;
    if inner == 1 && x.steps[1] == 1 && y.steps[1] == 1 {
        match extent {
            2 => of_rows::<T, 2, S>([x, y], products, finish),
            3 => of_rows::<T, 3, S>([x, y], products, finish),
            4 => of_rows::<T, 4, S>([x, y], products, finish),
            _ => {
                let row = |row: usize| {
                    let x = &x.entries[row * x.steps[0]..][..extent];
                    let y = &y.entries[row * y.steps[0]..][..extent];
                    let term = |k: usize| x[k].widen() * y[k].widen();
                    let total = if extent < LONG {
                        (0..extent).fold(T::Wide::ZERO, |total, k| total + term(k))
                    } else {
                        sum::<T>(extent, term)
                    };
                    finish(row, total)
                };
                let piece = (ENTRIES_PER_PIECE / extent.max(1)).max(1);
                for_each_piece_mut(products, piece, |k, products| {
                    (k * piece..).zip(products).for_each(|(at, product)| *product = row(at));
                });
            }
        }
    } else if is_few {
        for (block, products) in products.chunks_mut(inner).enumerate() {
            let at =
                |of: Operand<'_, T>, k, c| block * of.steps[0] + k * of.steps[1] + c * of.steps[2];
            let term = |k, c| term(at(x, k, c), at(y, k, c));
            let put = |c, total| products[c] = finish(block * inner + c, total);
            sum_rows::<T>(extent, inner, term, put);
        }
    } else {
        let piece = (ENTRIES_PER_PIECE / extent.max(1)).max(1);
        for_each_piece_mut(products, piece, |k, products| {
            let first = k * piece;
            let (mut block, mut c) = (first / inner, first % inner);
            for (place, product) in (first..).zip(products) {
                let at = |of: Operand<'_, T>| block * of.steps[0] + c * of.steps[2];
                let (mut i, mut j, mut total) = (at(x), at(y), T::Wide::ZERO);
                for _ in 0..extent {
                    total += term(i, j);
                    (i, j) = (i + x.steps[1], j + y.steps[1]);
                }
                *product = finish(place, total);
                c += 1;
                if c == inner {
                    (block, c) = (block + 1, 0);
                }
            }
        });
    }
}

/// The inner products of rows of `E` entries that lie side by side.
fn of_rows<T: Scalar, const E: usize, S: Send>(
    operands: [Operand<'_, T>; 2],
    products: &mut [S],
    finish: impl Fn(usize, T::Wide) -> S + Send + Sync,
) {
    let piece = ENTRIES_PER_PIECE / E;
    for_each_piece_mut(products, piece, |k, products| {
        for (row, product) in (k * piece..).zip(products) {
            let [x, y]: [[T; E]; 2] = operands.map(|of| {
                let entries = &of.entries[row * of.steps[0]..][..E];
                array::from_fn(|k| entries[k])
            });
            let mut total = T::Wide::ZERO;
            for k in 0..E {
                total += x[k].widen() * y[k].widen();
            }
            *product = finish(row, total);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inner_products_are_exact_on_integers_however_the_arrays_lie() {
        let extents = [0, 1, 2, 3, 4, 7, 9, 130, 600];
        for [o, e, i] in (0..729).map(|k| [k / 81, k / 9 % 9, k % 9].map(|at| extents[at])) {
            if o * e * i > 1 << 20 {
                continue;
            }
            let number = |k: usize| (k * 31 % 17) as f32 - 8.0;
            let x: Vec<f32> = (0..o * e * i).map(number).collect();
            // As it is, a row beside all, a column, and transposed.
            let layouts = [
                [e * i, i, 1],
                [0, i, 1],
                [0, 1, 0],
                [e, 1, 0],
                [1, 0, 0],
                [i, 0, 1],
                [1, o, o * e],
            ];
            for steps in layouts {
                let y: Vec<f32> = (0..=o * steps[0] + e * steps[1] + i * steps[2])
                    .map(|k| number(k + 5))
                    .collect();
                let operands = [Operand::whole(&x, [o, e, i]), Operand { entries: &y, steps }];
                let mut found = vec![f64::NAN; o * i];
                inner_products(operands, [o, e, i], &mut found, |place, total| {
                    total + 1000.0 * place as f64
                });
                for place in 0..o * i {
                    let (block, c) = (place / i, place % i);
                    let expected: f32 = (0..e)
                        .map(|k| {
                            let at = block * steps[0] + k * steps[1] + c * steps[2];
                            x[(block * e + k) * i + c] * y[at]
                        })
                        .sum();
                    let expected = f64::from(expected) + 1000.0 * place as f64;
                    assert_eq!(found[place], expected, "{:?} {steps:?} {place}", [o, e, i]);
                }
            }
        }
    }
}
