//! Sums up to each entry of an axis: `y_k = sum_(j <= k) x_j`; `x_bar_k += sum_(j >= k) y_bar_j`.
//!
//! Summed in [`Scalar::Wide`]. A long axis is cut into pieces of a fixed number of rows: the pieces are
//! summed, then their sums are added in order, then each piece is summed up from there. So threads share
//! it, and the result is the same for any number of them.

use std::array;

use crate::axis::blocks;
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut, for_each_two_pieces_mut, is_shared};
use crate::scalar::Scalar;
use crate::summation::sum;
use crate::var::Var;

/// Rows of a piece at least: what is kept for each piece is as wide as a row.
const ROWS_PER_PIECE: usize = 64;

struct CumulativeSum {
    axis: usize,
}

impl CumulativeSum {
    const NAME: &'static str = "cumulative_sum";
}

/// Sums of numbers along the middle axis of `[outer, extent, inner]`, from its start or from its end.
#[derive(Clone, Copy)]
struct Scan {
    extent: usize,
    inner: usize,
    is_backwards: bool,
}

impl Scan {
    /// Calls `put(entry of y, sum)` with the sum of `x` up to that entry.
    fn run<T: Scalar>(
        self,
        x: &[T],
        y: &mut [T],
        sums: &mut Vec<T::Wide>,
        put: impl Fn(&mut T, T::Wide) + Send + Sync,
    ) {
        let Self { extent, inner, .. } = self;
        if x.is_empty() {
            return;
        }
        let size = extent * inner;
        if size <= ENTRIES_PER_PIECE {
            let piece = ENTRIES_PER_PIECE / size * size;
            for_each_piece_mut(y, piece, |k, y| {
                let x = &x[k * piece..][..y.len()];
                for (x, y) in x.chunks(size).zip(y.chunks_mut(size)) {
                    self.run_columns(x, y, &put);
                }
            });
            return;
        }
        for (x, y) in x.chunks(size).zip(y.chunks_mut(size)) {
            if inner >= ENTRIES_PER_PIECE {
                self.run_rows(x, y, sums, &put);
            } else {
                self.run_pieces(x, y, sums, &put);
            }
        }
    }

    /// A small block, column by column.
    fn run_columns<T: Scalar>(self, x: &[T], y: &mut [T], put: impl Fn(&mut T, T::Wide)) {
        for column in 0..self.inner {
            let mut sum = T::Wide::ZERO;
            for row in 0..self.extent {
                let at = self.row(row, self.extent) * self.inner + column;
                sum += x[at].widen();
                put(&mut y[at], sum);
            }
        }
    }

    /// The k-th of `count` rows or pieces in the order of summation.
    fn row(self, k: usize, count: usize) -> usize {
        if self.is_backwards { count - 1 - k } else { k }
    }

    /// A block of rows so long that threads share each of them.
    fn run_rows<T: Scalar>(
        self,
        x: &[T],
        y: &mut [T],
        sums: &mut Vec<T::Wide>,
        put: impl Fn(&mut T, T::Wide) + Send + Sync,
    ) {
        sums.clear();
        sums.resize(self.inner, T::Wide::ZERO);
        for row in 0..self.extent {
            let first = self.row(row, self.extent) * self.inner;
            let (x, y) = (&x[first..], &mut y[first..][..self.inner]);
            for_each_two_pieces_mut(y, sums, [ENTRIES_PER_PIECE; 2], |k, y, sums| {
                add_row(&x[k * ENTRIES_PER_PIECE..], y, sums, &put);
            });
        }
    }

    /// A long block in pieces of rows.
    fn run_pieces<T: Scalar>(
        self,
        x: &[T],
        y: &mut [T],
        sums: &mut Vec<T::Wide>,
        put: impl Fn(&mut T, T::Wide) + Send + Sync,
    ) {
        let Self { extent, inner, .. } = self;
        let rows = (ENTRIES_PER_PIECE / inner).max(ROWS_PER_PIECE);
        let (size, pieces) = (rows * inner, extent.div_ceil(rows));
        let of = |k: usize| &x[k * size..][..size.min(x.len() - k * size)];
        sums.clear();
        if is_shared(pieces, 1) {
            sums.resize(pieces * inner, T::Wide::ZERO);
            for_each_piece_mut(sums, inner, |k, sums| self.add_rows(of(k), sums));
            // Each piece starts with the sum of those before it.
            for column in 0..inner {
                let mut before = T::Wide::ZERO;
                for k in 0..pieces {
                    let sum = &mut sums[self.row(k, pieces) * inner + column];
                    (*sum, before) = (before, before + *sum);
                }
            }
            for_each_two_pieces_mut(y, sums, [size, inner], |k, y, sums| {
                self.put_rows(of(k), y, sums, &put);
            });
            return;
        }
        // The same sums while a piece is at hand.
        sums.resize(3 * inner, T::Wide::ZERO);
        let (before, sums) = sums.split_at_mut(inner);
        let (own, running) = sums.split_at_mut(inner);
        for k in 0..pieces {
            let k = self.row(k, pieces);
            let x = of(k);
            own.fill(T::Wide::ZERO);
            self.add_rows(x, own);
            running.copy_from_slice(before);
            self.put_rows(x, &mut y[k * size..][..x.len()], running, &put);
            before.iter_mut().zip(&*own).for_each(|(before, &own)| *before += own);
        }
    }

    /// Adds all rows of `x` to `sums`.
    fn add_rows<T: Scalar>(self, x: &[T], sums: &mut [T::Wide]) {
        match sums {
            [own] => *own += sum::<T>(x.len(), |k| x[k].widen()),
            _ => x.chunks(self.inner).for_each(|x| {
                sums.iter_mut().zip(x).for_each(|(sum, x)| *sum += x.widen());
            }),
        }
    }

    /// Adds row after row of `x` to `sums`, and puts them into the row of `y` beside it.
    fn put_rows<T: Scalar>(
        self,
        x: &[T],
        y: &mut [T],
        sums: &mut [T::Wide],
        put: impl Fn(&mut T, T::Wide),
    ) {
        match self.inner {
            1 => self.put_short_rows::<T, 1>(x, y, sums, put),
            2 => self.put_short_rows::<T, 2>(x, y, sums, put),
            3 => self.put_short_rows::<T, 3>(x, y, sums, put),
            4 => self.put_short_rows::<T, 4>(x, y, sums, put),
            inner => {
                let rows = x.chunks(inner).zip(y.chunks_mut(inner));
                if self.is_backwards {
                    rows.rev().for_each(|(x, y)| add_row(x, y, sums, &put));
                } else {
                    rows.for_each(|(x, y)| add_row(x, y, sums, &put));
                }
            }
        }
    }

    /// [`Scan::put_rows`] for rows of `W` entries.
    fn put_short_rows<T: Scalar, const W: usize>(
        self,
        x: &[T],
        y: &mut [T],
        sums: &mut [T::Wide],
        put: impl Fn(&mut T, T::Wide),
    ) {
        let mut totals: [T::Wide; W] = array::from_fn(|column| sums[column]);
        let ((x, _), (y, _)) = (x.as_chunks::<W>(), y.as_chunks_mut::<W>());
        let rows = x.iter().zip(y);
        if self.is_backwards {
            rows.rev().for_each(|(x, y)| add_row(x, y, &mut totals, &put));
        } else {
            rows.for_each(|(x, y)| add_row(x, y, &mut totals, &put));
        }
    }
}

/// Adds a row of `x` to `sums`, and puts them into that of `y`.
#[inline(always)]
fn add_row<T: Scalar>(x: &[T], y: &mut [T], sums: &mut [T::Wide], put: impl Fn(&mut T, T::Wide)) {
    for ((x, y), sum) in x.iter().zip(y).zip(sums) {
        *sum += x.widen();
        put(y, *sum);
    }
}

impl<T: Scalar> Op<T> for CumulativeSum {
    /// The sums of pieces.
    type Saved = Vec<T::Wide>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let [_, extent, inner] = blocks(shape, self.axis, Self::NAME)?;
        let scan = Scan { extent, inner, is_backwards: false };
        scan.run(x, outputs.push(shape), saved, |y, sum| *y = T::narrow(sum));
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(x_bar) = gradients.get(0) else { return };
        let blocks = blocks(kept.input_shape(0), self.axis, Self::NAME);
        let [_, extent, inner] = blocks.expect("the forward pass found the axis");
        let scan = Scan { extent, inner, is_backwards: true };
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        scan.run(kept.only_upstream(), x_bar, saved, |x_bar, sum| {
            let sum = T::narrow(sum);
            *x_bar = if fresh { sum } else { *x_bar + sum };
        });
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The sums along `axis` up to each entry, that entry included; the shape stays.
    ///
    /// # Errors
    /// [`TensorError::Axis`] unless there is such an axis.
    pub fn cumulative_sum(self, axis: usize) -> Result<Self, TensorError> {
        self.tape.apply(CumulativeSum { axis }, &[self])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn sums_and_gradients_by_hand() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from([[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]]));
        let rows = x.cumulative_sum(1).unwrap();
        assert_eq!(rows.value(), Tensor::from([[1.0, 3.0, 6.0], [10.0, 30.0, 60.0]]));
        let upstream = Tensor::from([[1.0, 2.0, 4.0], [0.0, 0.0, 5.0]]);
        let gradients = tape.vjp(&[(rows, &upstream)]).unwrap();
        assert_eq!(gradients.get(x), Some(&Tensor::from([[7.0, 6.0, 4.0], [5.0, 5.0, 5.0]])));
        let columns = x.cumulative_sum(0).unwrap();
        assert_eq!(columns.value(), Tensor::from([[1.0, 2.0, 3.0], [11.0, 22.0, 33.0]]));
    }

    #[test]
    fn differences_of_cumulative_sums_are_the_entries_however_the_axis_is_cut() {
        let long = 5 * ENTRIES_PER_PIECE + 7;
        let shapes = [
            [1, long, 1],
            [2, 40_000, 3],
            [3, 70, 300],
            [1, 150, 9_000],
            [2, 5, ENTRIES_PER_PIECE + 3],
            [40_000, 3, 1],
            [9_000, 2, 3],
            [2, 1, 2],
            [2, 0, 3],
        ];
        for shape in shapes {
            let tape = Tape::<f32>::new();
            // Whole numbers: sums of them are exact.
            let x = tape.leaf(&Tensor::from_flat_fn(shape, |k| (k * 31 % 7) as f32 - 3.0));
            let y = x.cumulative_sum(1).unwrap();
            let gradients = tape.vjp(&[(y, &x.value())]).unwrap();
            let (x, y, x_bar) = (x.value(), y.value(), gradients.get_or_zeros(x));
            let [_, extent, inner] = shape;
            for k in 0..x.size() {
                let row = k / inner % extent;
                let before = if row == 0 { 0.0 } else { y.data()[k - inner] };
                assert_eq!(y.data()[k] - before, x.data()[k], "{shape:?} {k}");
                let after = if row + 1 == extent { 0.0 } else { x_bar.data()[k + inner] };
                assert_eq!(x_bar.data()[k] - after, x.data()[k], "{shape:?} {k}");
            }
        }
    }

    #[test]
    fn long_sums_keep_their_digits_in_f32() {
        let tape = Tape::<f32>::new();
        for shape in [[1, 1 << 18, 1], [1, 1 << 16, 5]] {
            let tenths = tape.leaf(&Tensor::full(shape, 0.1));
            let sums = tenths.cumulative_sum(1).unwrap().value();
            let exact = (f64::from(0.1_f32) * shape[1] as f64) as f32;
            assert_eq!(sums.data().last(), Some(&exact));
        }
    }

    #[test]
    fn an_axis_must_exist() {
        let tape = Tape::<f64>::new();
        let message = "cumulative_sum needs an axis below the rank 0, got axis 0 of shape []";
        let error = tape.leaf_scalar(1.0).cumulative_sum(0).unwrap_err();
        assert_eq!(error.to_string(), message);
    }
}
