//! A disc as sums along columns.
//!
//! # Forward
//! The column k pixels beside a disc's centre is a sum of steps: `sum_s c_s B_s`, where `B_s` is the sum of
//! the 2 `reach_s` + 1 pixels around the middle row. One running sum P down the image gives each of them by
//! two look-ups, `B_s = P(y + reach_s + 1) - P(y - reach_s)`. Pixels within the disc are one step, and the rim
//! has two or three more per column. The slope by sigma uses the same sums with other coefficients.
//!
//! # Borders that keep constants
//! The weights sum to 1, so `K c = a + K (c - a)` for any colour a, and the derivative needs no a. With a
//! pixel of the image for a, running sums stay small, and a constant image is kept to the last bit.
//!
//! # Adjoint
//! `K^T = K` for the zero and the mirror border. For the clamp border, `K^T` is K of the image between zeros,
//! as far out as the disc reaches, and what lies outside is added to the nearest pixel.
//!
//! # Order of work
//! Bands of rows are shared by threads. In a band, strips of columns are summed down the band and as far
//! above and below it as the disc reaches, so running sums are short, and stay in a core's own cache. Look-ups
//! begin anywhere in a cache line: vectors of 512 bits lie across two lines, and took up to twice the time.

use bokashi_core::Scalar;
use bokashi_core::parallel::for_each_two_pieces_mut;

use crate::border::Border;
use crate::copy::{copy, put};
use crate::scratch::Workbench;
use crate::taps::disc::{DiscTaps, Step};

/// Entries summed at a time: their sums stay in registers through all steps.
const BLOCK: usize = 32;
/// Entries of a row in a strip, at least and at most: as many as the disc adds on both sides, between these.
const STRIP: [usize; 2] = [4 * BLOCK, 32 * BLOCK];
/// Rows in a band, likewise.
const BAND: [usize; 2] = [32, 128];

/// Memory for a strip of a band.
#[derive(Debug, Default)]
pub(super) struct Strip<T> {
    /// Running sums: row 0 is zero, and row i + 1 is row i and the i-th row.
    sums: Vec<T>,
    /// A row of the strip, with what the disc sees on both sides.
    line: Vec<T>,
    /// The colour that is taken off, again and again.
    reference: Vec<T>,
    /// The steps of the column in the middle, and of pairs of columns beside it.
    middle: Vec<SpanEnds<T>>,
    beside: Vec<SpanEnds<T>>,
}

impl<T: Scalar> Strip<T> {
    /// How many entries there is memory for.
    pub(super) fn len(&self) -> usize {
        self.sums.len() + self.line.len() + self.reference.len()
    }
}

/// A disc over images of one shape.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spans<'a, T: Scalar> {
    height: usize,
    width: usize,
    channels: usize,
    border: Border,
    taps: &'a DiscTaps<T>,
}

impl<'a, T: Scalar> Spans<'a, T> {
    pub(super) fn new(shape: [usize; 3], border: Border, taps: &'a DiscTaps<T>) -> Self {
        let [height, width, channels] = shape;
        Self { height, width, channels, border, taps }
    }

    /// `out = K image`, and `slope = dK/dsigma image`, unless it is empty.
    pub(super) fn apply(
        &self,
        image: &[T],
        bench: &Workbench<Strip<T>>,
        out: &mut [T],
        slope: &mut [T],
    ) {
        let rows = (2 * self.taps.reach()).clamp(BAND[0], BAND[1]);
        let piece = rows * self.width * self.channels;
        for_each_two_pieces_mut(out, slope, [piece; 2], |band, out, slope| {
            bench.with(|memory| {
                let first = band * rows;
                let work = BandWork { spans: self, image, first, memory, out, slope };
                crate::dispatch::dispatch_256::<T, _>(work);
            });
        });
    }

    /// `out = K^T image`; `padded` is memory.
    pub(super) fn apply_adjoint(
        &self,
        image: &[T],
        bench: &Workbench<Strip<T>>,
        padded: &mut [Vec<T>; 2],
        out: &mut [T],
    ) {
        if self.border != Border::Clamp {
            return self.apply(image, bench, out, &mut []);
        }
        let reach = self.taps.reach();
        let Self { height, width, channels, taps, .. } = *self;
        let [wide, tall] = [width + 2 * reach, height + 2 * reach];
        let [from, to] = padded;
        from.clear();
        from.resize(tall * wide * channels, T::ZERO);
        to.resize(from.len(), T::ZERO);
        let row = width * channels;
        for (y, line) in image.chunks_exact(row).enumerate() {
            from[((y + reach) * wide + reach) * channels..][..row].copy_from_slice(line);
        }
        Spans::new([tall, wide, channels], Border::Zero, taps).apply(from, bench, to, &mut []);
        out.fill(T::ZERO);
        for (y, line) in to.chunks_exact(wide * channels).enumerate() {
            let y = y.saturating_sub(reach).min(height - 1);
            let out = &mut out[y * row..][..row];
            for (x, pixel) in line.chunks_exact(channels).enumerate() {
                let x = x.saturating_sub(reach).min(width - 1);
                let out = &mut out[x * channels..][..channels];
                out.iter_mut().zip(pixel).for_each(|(out, &entry)| *out += entry);
            }
        }
    }

    /// Sums a strip, `strip` entries from pixel `start` of a row on, down `rows` rows from row `first` on.
    #[inline(always)]
    fn sum_strip(
        &self,
        image: &[T],
        [first, rows]: [usize; 2],
        [start, stride]: [usize; 2],
        memory: &mut Strip<T>,
    ) {
        let Strip { sums, line, reference, .. } = memory;
        let (reach, channels, row) = (self.taps.reach(), self.channels, self.width * self.channels);
        let count = rows + 2 * reach;
        enough(sums, (count + 1) * stride);
        enough(line, stride);
        line[..stride].fill(T::ZERO);
        sums[..stride].fill(T::ZERO);
        // The colour of the strip's first pixel; nothing, where the border is black.
        enough(reference, stride);
        let color = &image[first * row + start * channels..][..channels];
        for pixel in reference[..stride].chunks_mut(channels) {
            match self.border {
                Border::Zero => pixel.fill(T::ZERO),
                _ => pixel.copy_from_slice(&color[..pixel.len()]),
            }
        }
        // Whole pixels as far as the disc sees, and up to a whole block.
        let pixels = (stride / channels).min(self.width - start + 2 * reach);
        for k in 0..count {
            let position = (first + k) as isize - reach as isize;
            let (before, after) = sums.split_at_mut((k + 1) * stride);
            let (before, after) = (&before[k * stride..], &mut after[..stride]);
            let Some(y) = self.border.source(position, self.height) else {
                after.copy_from_slice(before);
                continue;
            };
            let line_pixels = &mut line[..pixels * channels];
            let from = start as isize - reach as isize;
            extend(&image[y * row..][..row], channels, self.border, from, line_pixels);
            let (line, reference) = (&line[..stride], &reference[..stride]);
            for i in 0..stride {
                after[i] = before[i] + (line[i] - reference[i]);
            }
        }
    }

    /// Lists where the steps of all columns look up their sums, in rows of `stride` entries.
    #[inline(always)]
    fn list_steps(&self, stride: usize, memory: &mut Strip<T>) {
        let Strip { middle, beside, .. } = memory;
        middle.clear();
        beside.clear();
        let reach = self.taps.reach();
        for k in 0..=reach {
            let columns = [reach - k, reach + k].map(|column| column * self.channels);
            for &Step { reach: span, weight, slope } in self.taps.column(k) {
                let low = columns.map(|column| (reach - span) * stride + column);
                let high = (2 * span + 1) * stride;
                let list = if k == 0 { &mut *middle } else { &mut *beside };
                list.push(SpanEnds { low, high, weight, slope });
            }
        }
    }
}

/// A step of a pair of columns.
#[derive(Debug, Clone, Copy)]
struct SpanEnds<T> {
    /// Where the sums above the span stand, in the left and in the right column.
    low: [usize; 2],
    /// How much farther those at its end stand.
    high: usize,
    weight: T,
    slope: T,
}

/// The values of a block from `place` on, and their slopes where `SLOPE` is true; `memory.sums[row..]` begin with
/// the highest row that the disc sees.
#[inline(always)]
fn sum_block<T: Scalar, const SLOPE: bool>(
    memory: &Strip<T>,
    row: usize,
    place: usize,
) -> [[T; BLOCK]; 2] {
    let (mut values, mut slopes) = ([T::ZERO; BLOCK], [T::ZERO; BLOCK]);
    let sums = &memory.sums[row + place..];
    for &SpanEnds { low: [low, _], high, weight, slope } in &memory.middle {
        let (above, below) = (block(sums, low), block(sums, low + high));
        for i in 0..BLOCK {
            let span = below[i] - above[i];
            values[i] += weight * span;
            if SLOPE {
                slopes[i] += slope * span;
            }
        }
    }
    for &SpanEnds { low: [left, right], high, weight, slope } in &memory.beside {
        let (above_left, below_left) = (block(sums, left), block(sums, left + high));
        let (above_right, below_right) = (block(sums, right), block(sums, right + high));
        for i in 0..BLOCK {
            let spans = (below_left[i] - above_left[i]) + (below_right[i] - above_right[i]);
            values[i] += weight * spans;
            if SLOPE {
                slopes[i] += slope * spans;
            }
        }
    }
    // The block's first entry need not be a pixel's first.
    let reference = block(&memory.reference, place);
    for i in 0..BLOCK {
        values[i] += reference[i];
    }
    [values, slopes]
}

/// A band's work, compiled for the vectors that the processor has.
struct BandWork<'a, 'b, T: Scalar> {
    spans: &'a Spans<'b, T>,
    image: &'a [T],
    first: usize,
    memory: &'a mut Strip<T>,
    out: &'a mut [T],
    slope: &'a mut [T],
}

impl<T: Scalar> pulp::WithSimd for BandWork<'_, '_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { spans, image, first, memory, out, slope } = self;
        let channels = spans.channels;
        let row = spans.width * channels;
        let rows = out.len() / row;
        let beside = 2 * spans.taps.reach() * channels;
        // Whole pixels, and whole blocks.
        let strip = beside.clamp(STRIP[0], STRIP[1]).next_multiple_of(BLOCK * channels);
        for start in (0..row).step_by(strip) {
            let end = row.min(start + strip);
            let stride = (end - start).next_multiple_of(BLOCK) + beside;
            spans.sum_strip(image, [first, rows], [start / channels, stride], memory);
            spans.list_steps(stride, memory);
            for y in 0..rows {
                for at in (0..end - start).step_by(BLOCK) {
                    let range = y * row + start + at..y * row + end.min(start + at + BLOCK);
                    if slope.is_empty() {
                        let [values, _] = sum_block::<T, false>(memory, y * stride, at);
                        put(&mut out[range], &values);
                    } else {
                        let [values, slopes] = sum_block::<T, true>(memory, y * stride, at);
                        put(&mut out[range.clone()], &values);
                        put(&mut slope[range], &slopes);
                    }
                }
            }
        }
    }
}

/// Writes to `line` the pixels from `from` on of the endless line that `row` is a part of.
#[inline(always)]
pub(super) fn extend<T: Scalar>(
    row: &[T],
    channels: usize,
    border: Border,
    from: isize,
    line: &mut [T],
) {
    let (width, count) = (row.len() / channels, line.len() / channels);
    let inside = |at: isize| (at - from).clamp(0, count as isize) as usize;
    let (start, end) = (inside(0), inside(width as isize));
    for k in (0..start).chain(end..count) {
        let pixel = &mut line[k * channels..][..channels];
        match border.source(from + k as isize, width) {
            Some(x) => copy(&row[x * channels..][..channels], pixel),
            None => pixel.fill(T::ZERO),
        }
    }
    if start < end {
        let x = (from + start as isize) as usize;
        let entries = (end - start) * channels;
        line[start * channels..][..entries].copy_from_slice(&row[x * channels..][..entries]);
    }
}

/// Makes `memory` hold at least `length` entries; what is there is written over.
pub(super) fn enough<T: Scalar>(memory: &mut Vec<T>, length: usize) {
    if memory.len() < length {
        memory.resize(length, T::ZERO);
    }
}

#[inline(always)]
fn block<T>(entries: &[T], start: usize) -> &[T; BLOCK] {
    entries[start..start + BLOCK].try_into().expect("the range is a block")
}
