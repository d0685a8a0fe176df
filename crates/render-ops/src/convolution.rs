//! Convolution of an image with a separable symmetric window, along the columns and then along the
//! rows, and its derivative with respect to sigma.
//!
//! # Forward
//! `b = K_x K_y c` and `db/dsigma = K'_x K_y c + K_x K'_y c`, with
//! `(K c)_i = w_0 c_i + sum_k w_k (c_(i-k) + c_(i+k))` and
//! `(K' c)_i = s c_i + sum_k w'_k ((c_(i-k) + c_(i+k)) - 2 c_i)`, where s is the sum of all slopes
//! w'. In this form a constant cancels exactly where s = 0. Taps are added in pairs, and weights
//! and slopes use the same loads.
//!
//! # Adjoint
//! `K^T = K` for the zero and the mirror border. For the clamp border, what leaves the image is
//! added to the border pixels. So `K^T` is `K` with a zero border, plus `sum_j g_j sum_(k > j) w_k`
//! at the first pixel, and likewise at the last.
//!
//! # Order of work
//! An image is cut into bands of rows. A band is copied in strips of columns, with what the window
//! sees above and below. In a strip the rows are neighbours in memory; in the image they often lie
//! a power of two apart, and then all share a few places of the cache. The strips, blurred along
//! the columns, make rows, with what the window sees to the left and right. These are blurred along
//! the rows. So an image is read and written once, and all that lies between stays in a core's own
//! cache.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::for_each_two_pieces_mut;

use crate::border::Border;
use crate::copy::{copy, put};
use crate::scratch::Workbench;
use crate::taps::{Taps, Window};

/// Entries summed at a time: their sums stay in registers through all taps.
const BLOCK: usize = 32;
/// Entries of a row in a strip of columns: with a window of 60 pixels to either side, a strip of a
/// band fits a core's first cache.
const STRIP: usize = 2 * BLOCK;
/// Entries in a band of rows: 256 kB in `f32`, so that blurred rows and their slopes fit a core's
/// second cache.
const BAND: usize = 1 << 16;

/// Memory for a band.
#[derive(Debug, Default)]
pub(crate) struct Band<T> {
    /// A strip of columns.
    strip: Vec<T>,
    /// The rows after the blur along the columns, and after the slopes along the columns.
    rows: Vec<T>,
    slopes: Vec<T>,
}

impl<T> Band<T> {
    /// How many entries there is memory for.
    pub(crate) fn len(&self) -> usize {
        self.strip.len() + self.rows.len() + self.slopes.len()
    }
}

/// A convolution of images of one shape.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Convolution<'a, T: Scalar> {
    height: usize,
    /// Pixels in a row.
    width: usize,
    channels: usize,
    border: Border,
    along_rows: &'a Taps<T>,
    along_columns: &'a Taps<T>,
    /// Weights that the adjoint of a clamp border adds up at the border, by distance from it.
    overhangs: Option<[&'a [T]; 2]>,
}

impl<'a, T: Scalar> Convolution<'a, T> {
    /// The convolution with the windows `[along_rows, along_columns]` of images `[H, W, C]`.
    pub(crate) fn new(shape: &[usize], border: Border, taps: &'a [Taps<T>; 2]) -> Self {
        let &[height, width, channels] = shape else { unreachable!("an image has three axes") };
        let [along_rows, along_columns] = taps;
        Self { height, width, channels, border, along_rows, along_columns, overhangs: None }
    }

    /// Its adjoint.
    pub(crate) fn adjoint(self) -> Self {
        match self.border {
            Border::Clamp => {
                let overhangs = Some([&self.along_rows.tails[..], &self.along_columns.tails]);
                Self { border: Border::Zero, overhangs, ..self }
            }
            Border::Zero | Border::Mirror => self,
        }
    }

    /// `out = K image`, and `slope = dK/dsigma image`, unless it is empty.
    pub(crate) fn apply(
        &self,
        image: &[T],
        bench: &Workbench<Band<T>>,
        out: &mut [T],
        slope: &mut [T],
    ) {
        self.apply_from((image, 0), 0, bench, out, slope);
    }

    /// [`Convolution::apply`] for the rows of `out` and `slope`, from row `first` on. The image has the
    /// rows that the window sees, from the row beside it on.
    pub(crate) fn apply_from(
        &self,
        (image, from): (&[T], usize),
        first: usize,
        bench: &Workbench<Band<T>>,
        out: &mut [T],
        slope: &mut [T],
    ) {
        let rows = self.rows_per_band();
        let piece = rows * self.row();
        let work = |band: usize, out: &mut [T], slope: &mut [T]| {
            let first = first + band * rows;
            bench.with(|memory| self.rows(image, from, first, memory, out, slope));
        };
        for_each_two_pieces_mut(out, slope, [piece; 2], work);
    }

    /// How many rows the window sees above and below its own.
    pub(crate) fn reach(&self) -> usize {
        self.border.reach(self.along_columns.radius(), self.height)
    }

    /// Entries in a row of pixels.
    fn row(&self) -> usize {
        self.width * self.channels
    }

    fn rows_per_band(&self) -> usize {
        (BAND / self.row()).max(1)
    }

    /// The rows `out` from row `first` on, and, unless it is empty, their slopes. `image` has the rows that
    /// the window sees, from row `from` on.
    pub(crate) fn rows(
        &self,
        image: &[T],
        from: usize,
        first: usize,
        memory: &mut Band<T>,
        out: &mut [T],
        slope: &mut [T],
    ) {
        crate::dispatch::dispatch::<T, _>(BandWork {
            convolution: self,
            image,
            from,
            first,
            memory,
            out,
            slope,
        });
    }

    /// Entries between the starts of two rows in a band's memory: with what the window sees at
    /// either end, and up to a whole block.
    #[inline(always)]
    fn stride(&self) -> usize {
        self.row().next_multiple_of(BLOCK) + 2 * self.overlap()
    }

    /// Entries that the window along the rows sees beyond either end of a row.
    #[inline(always)]
    fn overlap(&self) -> usize {
        self.border.reach(self.along_rows.radius(), self.width) * self.channels
    }

    /// Blurs `rows` rows of the image from row `first` on along its columns; `image` begins with row `from`.
    #[inline(always)]
    fn blur_columns(
        &self,
        (image, from): (&[T], usize),
        first: usize,
        rows: usize,
        memory: &mut Band<T>,
        with_slope: bool,
    ) {
        let Band { strip, rows: blurred, slopes } = memory;
        let (row, stride, overlap) = (self.row(), self.stride(), self.overlap());
        let reach = self.reach();
        let weights = &self.along_columns.weights[..=reach];
        let window = self.along_columns.window(reach);
        // What is there is written over.
        let enough = |memory: &mut Vec<T>| memory.resize(memory.len().max(rows * stride), T::ZERO);
        enough(blurred);
        if with_slope {
            enough(slopes);
        }
        for start in (0..row).step_by(STRIP) {
            let end = row.min(start + STRIP);
            let width = (end - start).next_multiple_of(BLOCK);
            let strip = aligned(strip, (rows + 2 * reach) * width);
            // The strip: these columns of the band's rows, and of as many rows as the window sees above and
            // below.
            for (k, to) in strip.chunks_exact_mut(width).enumerate() {
                let position = (first + k) as isize - reach as isize;
                match self.border.source(position, self.height) {
                    Some(y) => {
                        to[..end - start].copy_from_slice(&image[(y - from) * row..][start..end])
                    }
                    None => to.fill(T::ZERO),
                }
            }
            for k in 0..rows {
                let to = k * stride + overlap + start;
                for offset in (0..width).step_by(BLOCK) {
                    let center = (k + reach) * width + offset;
                    if with_slope {
                        let [sums, by_sigma] = window_sums(strip, center, width, weights, &window);
                        *block_mut(blurred, to + offset) = sums;
                        *block_mut(slopes, to + offset) = by_sigma;
                    } else {
                        let sums = window_sum(strip, center, width, weights);
                        *block_mut(blurred, to + offset) = sums;
                    }
                }
            }
        }
        if let Some([_, tails]) = self.overhangs {
            self.add_overhang_of_columns(image, first..first + rows, tails, memory);
        }
        for k in 0..rows {
            self.extend(&mut memory.rows[k * stride..][..stride]);
            if with_slope {
                self.extend(&mut memory.slopes[k * stride..][..stride]);
            }
        }
    }

    /// Writes to a row in memory what the window sees beyond its ends.
    #[inline(always)]
    fn extend(&self, line: &mut [T]) {
        match self.channels {
            1 => self.extend_pixels::<1>(line),
            3 => self.extend_pixels::<3>(line),
            4 => self.extend_pixels::<4>(line),
            _ => self.extend_pixels::<0>(line),
        }
    }

    /// The same for pixels of `C` channels; 0 stands for any number.
    #[inline(always)]
    fn extend_pixels<const C: usize>(&self, line: &mut [T]) {
        let channels = if C == 0 { self.channels } else { C };
        let (before, rest) = line.split_at_mut(self.overlap());
        let (row, after) = rest.split_at_mut(self.row());
        let after = &mut after[..before.len()];
        // A window that sees more than the whole row has been folded: one reflection is enough.
        let (before, after) =
            (before.rchunks_exact_mut(channels), after.chunks_exact_mut(channels));
        match self.border {
            Border::Zero => before.chain(after).for_each(|pixel| pixel.fill(T::ZERO)),
            Border::Mirror => {
                for (to, from) in before.zip(row.chunks_exact(channels)) {
                    copy(from, to);
                }
                for (to, from) in after.zip(row.rchunks_exact(channels)) {
                    copy(from, to);
                }
            }
            Border::Clamp => {
                before.for_each(|pixel| copy(&row[..channels], pixel));
                after.for_each(|pixel| copy(&row[row.len() - channels..], pixel));
            }
        }
    }

    /// Blurs the rows in memory along themselves.
    #[inline(always)]
    fn blur_rows(&self, memory: &Band<T>, out: &mut [T], slope: &mut [T]) {
        let (row, stride, overlap) = (self.row(), self.stride(), self.overlap());
        let reach = overlap / self.channels;
        let weights = &self.along_rows.weights[..=reach];
        let window = self.along_rows.window(reach);
        for k in 0..out.len() / row {
            for offset in (0..row).step_by(BLOCK) {
                let center = k * stride + overlap + offset;
                let range = k * row + offset..k * row + row.min(offset + BLOCK);
                if slope.is_empty() {
                    let sums = window_sum(&memory.rows, center, self.channels, weights);
                    put(&mut out[range], &sums);
                } else {
                    let [sums, mut by_sigma] =
                        window_sums(&memory.rows, center, self.channels, weights, &window);
                    // The other term of the product rule: `K_x K'_y c`.
                    let rest = window_sum(&memory.slopes, center, self.channels, weights);
                    for i in 0..BLOCK {
                        by_sigma[i] += rest[i];
                    }
                    put(&mut out[range.clone()], &sums);
                    put(&mut slope[range], &by_sigma);
                }
            }
            if let Some([tails, _]) = self.overhangs {
                let line = &memory.rows[k * stride + overlap..][..row];
                let out = &mut out[k * row..][..row];
                for (x, &tail) in tails.iter().enumerate().take(self.width) {
                    for c in 0..self.channels {
                        out[c] += tail * line[x * self.channels + c];
                        out[row - self.channels + c] +=
                            tail * line[row - (x + 1) * self.channels + c];
                    }
                }
            }
        }
    }

    /// Adds to the rows of a band that lie at the border what the adjoint of a clamp puts there.
    fn add_overhang_of_columns(
        &self,
        image: &[T],
        rows: Range<usize>,
        tails: &[T],
        memory: &mut Band<T>,
    ) {
        let (row, stride, overlap) = (self.row(), self.stride(), self.overlap());
        for border in [0, self.height - 1] {
            if !rows.contains(&border) {
                continue;
            }
            let to = &mut memory.rows[(border - rows.start) * stride + overlap..][..row];
            for (j, &tail) in tails.iter().enumerate().take(self.height) {
                let from = &image[border.abs_diff(j) * row..][..row];
                for (to, &from) in to.iter_mut().zip(from) {
                    *to += tail * from;
                }
            }
        }
    }
}

/// The first `length` entries of `memory` that start on a cache line: a block that lies across two
/// lines has to read both.
#[inline(always)]
fn aligned<T: Scalar>(memory: &mut Vec<T>, length: usize) -> &mut [T] {
    const LINE: usize = 64;
    if memory.len() < length + LINE {
        memory.resize(length + LINE, T::ZERO);
    }
    let start = memory.as_ptr().align_offset(LINE).min(LINE);
    &mut memory[start..start + length]
}

#[inline(always)]
fn block<T>(entries: &[T], start: usize) -> &[T; BLOCK] {
    entries[start..start + BLOCK].try_into().expect("the range is a block")
}

#[inline(always)]
fn block_mut<T>(entries: &mut [T], start: usize) -> &mut [T; BLOCK] {
    (&mut entries[start..start + BLOCK]).try_into().expect("the range is a block")
}

/// `w_0 p_i + sum_k w_k (p_(i-k) + p_(i+k))` for a block of centres i that starts at `center`; from
/// tap to tap the entries p lie `step` apart.
#[inline(always)]
fn window_sum<T: Scalar>(entries: &[T], center: usize, step: usize, weights: &[T]) -> [T; BLOCK] {
    let middle = block(entries, center);
    let mut sums = [T::ZERO; BLOCK];
    for i in 0..BLOCK {
        sums[i] = weights[0] * middle[i];
    }
    let mut offset = 0;
    for &weight in &weights[1..] {
        offset += step;
        let (left, right) = (block(entries, center - offset), block(entries, center + offset));
        for i in 0..BLOCK {
            sums[i] += weight * (left[i] + right[i]);
        }
    }
    sums
}

/// The same, and `s p_i + sum_k w'_k ((p_(i-k) + p_(i+k)) - 2 p_i)`.
#[inline(always)]
fn window_sums<T: Scalar>(
    entries: &[T],
    center: usize,
    step: usize,
    weights: &[T],
    window: &Window<'_, T>,
) -> [[T; BLOCK]; 2] {
    let middle = block(entries, center);
    let (mut sums, mut slopes, mut twice) = ([T::ZERO; BLOCK], [T::ZERO; BLOCK], [T::ZERO; BLOCK]);
    for i in 0..BLOCK {
        sums[i] = weights[0] * middle[i];
        slopes[i] = window.slope_sum * middle[i];
        twice[i] = middle[i] + middle[i];
    }
    let mut offset = 0;
    for (&weight, &slope) in weights[1..].iter().zip(&window.slopes[1..]) {
        offset += step;
        let (left, right) = (block(entries, center - offset), block(entries, center + offset));
        for i in 0..BLOCK {
            let pair = left[i] + right[i];
            sums[i] += weight * pair;
            slopes[i] += slope * (pair - twice[i]);
        }
    }
    [sums, slopes]
}

/// A band's work, compiled for the vectors that the processor has.
struct BandWork<'a, T: Scalar> {
    convolution: &'a Convolution<'a, T>,
    image: &'a [T],
    from: usize,
    first: usize,
    memory: &'a mut Band<T>,
    out: &'a mut [T],
    slope: &'a mut [T],
}

impl<T: Scalar> pulp::WithSimd for BandWork<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { convolution, image, from, first, memory, out, slope } = self;
        convolution.blur_columns(
            (image, from),
            first,
            out.len() / convolution.row(),
            memory,
            !slope.is_empty(),
        );
        convolution.blur_rows(memory, out, slope);
    }
}
