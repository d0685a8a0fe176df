//! Convolution of padded lines with a symmetric window.
//!
//! A picture is `lines` lines of `extent` cells of `cell` entries: for a blur along rows a line is
//! a row and a cell a pixel; for one along columns the line is the whole picture and a cell a row.
//! From tap to tap the entries under a window lie one cell apart, so both directions are sums of
//! shifted slices.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut, merge_ranges};

use crate::taps::Window;

/// Entries summed at a time: their sums stay in registers while the taps go by.
const BLOCK: usize = 32;

/// The geometry of a pass.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lines {
    pub(super) lines: usize,
    pub(super) extent: usize,
    pub(super) cell: usize,
    /// Cells of padding at either end of a line.
    pub(super) pad: usize,
}

impl Lines {
    /// `out_i = w_0 p_i + sum_k w_k (p_(i-k) + p_(i+k))` over padded lines p.
    pub(super) fn convolve<T: Scalar>(&self, padded: &[T], weights: &[T], out: &mut [T]) {
        let windows = Windows { lines: *self, padded, own: weights[0], weights: &weights[1..] };
        let pair = |left, _, right| left + right;
        for_each_piece_mut(out, ENTRIES_PER_PIECE, |piece, out| {
            let first = piece * ENTRIES_PER_PIECE;
            windows.for_each_sum(first..first + out.len(), pair, |at, sums| {
                out[at - first..][..sums.len()].copy_from_slice(sums);
            });
        });
    }

    /// `sum_i g_i (s p_i + sum_k w'_k ((p_(i-k) - p_i) + (p_(i+k) - p_i)))`, with s the sum of all
    /// slopes w': the derivative of the convolution with respect to sigma, against g. In this form
    /// a constant cancels exactly where s = 0.
    pub(super) fn slope_product<T: Scalar>(
        &self,
        padded: &[T],
        window: &Window<'_, T>,
        g: &[T],
    ) -> T::Wide {
        let weights = &window.slopes[1..];
        let windows = Windows { lines: *self, padded, own: window.slope_sum, weights };
        let pair = |left, center, right| (left - center) + (right - center);
        let work = |range: Range<usize>| {
            let mut total = T::Wide::ZERO;
            windows.for_each_sum(range, pair, |at, sums| {
                for (sum, g) in sums.iter().zip(&g[at..]) {
                    total += sum.widen() * g.widen();
                }
            });
            total
        };
        let mut total = T::Wide::ZERO;
        merge_ranges(g.len(), ENTRIES_PER_PIECE, work, |piece| total += piece);
        total
    }
}

/// Windows of one set of weights over padded lines.
struct Windows<'a, T> {
    lines: Lines,
    padded: &'a [T],
    /// The weight of the centre.
    own: T,
    /// The weights of the pairs at distance 1 and on.
    weights: &'a [T],
}

impl<T: Scalar> Windows<'_, T> {
    /// Calls `visit(i, sums)` with runs of `own p_i + sum_k weights_k pair(p_(i-k), p_i, p_(i+k))`
    /// until all outputs i in `range` are covered.
    fn for_each_sum(
        &self,
        range: Range<usize>,
        pair: impl Fn(T, T, T) -> T + Copy,
        mut visit: impl FnMut(usize, &[T]),
    ) {
        let Lines { extent, cell, pad, .. } = self.lines;
        let line_length = extent * cell;
        let mut at = range.start;
        while at < range.end {
            let line = at / line_length;
            let end = range.end.min((line + 1) * line_length);
            let offset = (2 * line + 1) * pad * cell;
            // A length known to the compiler lets it keep the sums in registers.
            while at + BLOCK <= end {
                visit(at, &self.sums::<BLOCK>(at + offset, pair));
                at += BLOCK;
            }
            while at + 4 <= end {
                visit(at, &self.sums::<4>(at + offset, pair));
                at += 4;
            }
            while at < end {
                visit(at, &self.sums::<1>(at + offset, pair));
                at += 1;
            }
        }
    }

    /// The sums of N neighbouring windows, the first one centred at `start` of the padded lines.
    #[inline(always)]
    fn sums<const N: usize>(&self, start: usize, pair: impl Fn(T, T, T) -> T) -> [T; N] {
        let entries = |start: usize| -> &[T; N] {
            self.padded[start..start + N].try_into().expect("the range has N entries")
        };
        let center = entries(start);
        let mut sums = center.map(|entry| self.own * entry);
        let mut offset = 0;
        for &weight in self.weights {
            offset += self.lines.cell;
            let (left, right) = (entries(start - offset), entries(start + offset));
            for i in 0..N {
                sums[i] += weight * pair(left[i], center[i], right[i]);
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths below, at and above the block size, one line and several.
    const LINES: [Lines; 3] = [
        Lines { lines: 3, extent: 5, cell: 2, pad: 2 },
        Lines { lines: 2, extent: 16, cell: 2, pad: 2 },
        Lines { lines: 1, extent: 4, cell: 37, pad: 2 },
    ];

    fn numbers(count: usize) -> Vec<f64> {
        (0..count).map(|k| ((k * 7919) % 101) as f64 / 101.0 - 0.3).collect()
    }

    fn padded_size(lines: Lines) -> usize {
        lines.lines * (lines.extent + 2 * lines.pad) * lines.cell
    }

    /// The entry of padded line `line`, cell `cell` (negative in the padding), at `offset` in it.
    fn entry(padded: &[f64], lines: Lines, line: usize, cell: isize, offset: usize) -> f64 {
        let cell = (cell + lines.pad as isize) as usize;
        padded[(line * (lines.extent + 2 * lines.pad) + cell) * lines.cell + offset]
    }

    #[test]
    fn every_output_is_the_weighted_sum_of_its_window() {
        for lines in LINES {
            let padded = numbers(padded_size(lines));
            let mut out = vec![0.0; lines.lines * lines.extent * lines.cell];
            lines.convolve(&padded, &[0.5, 0.25, -0.125], &mut out);
            for (at, &value) in out.iter().enumerate() {
                let (line, rest) =
                    (at / (lines.extent * lines.cell), at % (lines.extent * lines.cell));
                let (cell, offset) = ((rest / lines.cell) as isize, rest % lines.cell);
                let p = |k: isize| entry(&padded, lines, line, cell + k, offset);
                let expected = 0.5 * p(0) + 0.25 * (p(-1) + p(1)) - 0.125 * (p(-2) + p(2));
                approx::assert_relative_eq!(value, expected, epsilon = 1e-15);
            }
        }
    }

    #[test]
    fn the_slope_product_is_linear_in_the_slopes_and_ignores_constants() {
        for lines in LINES {
            let mut padded = numbers(padded_size(lines));
            let g = numbers(lines.lines * lines.extent * lines.cell);
            let slopes = [f64::NAN, 0.75, -0.5];
            let window = Window { slopes: &slopes, slope_sum: 0.0 };
            let product = lines.slope_product(&padded, &window, &g);
            // The same through a convolution: w'_0 is minus the sum of all others.
            let mut blurred = vec![0.0; g.len()];
            lines.convolve(&padded, &[-0.5, 0.75, -0.5], &mut blurred);
            let expected: f64 = blurred.iter().zip(&g).map(|(b, g)| b * g).sum();
            approx::assert_relative_eq!(product, expected, max_relative = 1e-12);

            padded.fill(0.1);
            assert_eq!(lines.slope_product(&padded, &window, &g), 0.0);
        }
    }
}
