//! Long sums that are accurate and the same for any number of threads.
//!
//! Entries are summed in pieces of a fixed size, in [`Scalar::Wide`], and the pieces' sums are
//! added in order. In `f32` the result is the rounded sum; in `f64` the error is below
//! `(ENTRIES_PER_PIECE / LANES + pieces) eps sum |x|`.

use std::ops::Range;

use crate::parallel::{ENTRIES_PER_PIECE, merge_ranges};
use crate::scalar::Scalar;

/// Independent partial sums within a piece, so that additions overlap in the processor.
const LANES: usize = 8;

/// From so many products on an inner product is formed in several parts side by side.
const LONG: usize = 8;

/// The sum of `term(k)` over `0..length`.
pub fn sum<T: Scalar>(length: usize, term: impl Fn(usize) -> T::Wide + Send + Sync) -> T::Wide {
    let piece = |range: Range<usize>| {
        let mut lanes = [T::Wide::default(); LANES];
        let mut k = range.start;
        while k + LANES <= range.end {
            for (lane, sum) in lanes.iter_mut().enumerate() {
                *sum += term(k + lane);
            }
            k += LANES;
        }
        for rest in k..range.end {
            lanes[rest - k] += term(rest);
        }
        lanes.into_iter().sum()
    };
    let mut total = T::Wide::ZERO;
    merge_ranges(length, ENTRIES_PER_PIECE, piece, |partial: T::Wide| total += partial);
    total
}

/// `sum_k x_k y_k` of two vectors of one length, formed in [`Scalar::Wide`].
#[inline(always)]
pub(crate) fn inner_product<T: Scalar>(x: &[T], y: &[T]) -> T::Wide {
    let y = &y[..x.len()];
    let term = |k: usize| x[k].widen() * y[k].widen();
    if x.len() < LONG {
        (0..x.len()).fold(T::Wide::ZERO, |total, k| total + term(k))
    } else {
        sum::<T>(x.len(), term)
    }
}
