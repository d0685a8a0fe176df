//! Weighed sums of rows, and of pixels along a row; and their adjoints.

use bokashi_core::Scalar;

use crate::border::Border;
use crate::copy::copy;
use crate::error::RenderError;
use crate::filter::Filter;

/// Entries summed at a time: their sums stay in registers through all weights.
const BLOCK: usize = 64;
/// Weights whose terms are summed on their own: the sum of a thousand numbers has the rounding errors of
/// some sixty.
const TERMS: usize = 32;

/// The pixels of a line that an output pixel sees.
#[derive(Debug, Default)]
pub(super) struct Window<T> {
    factor: usize,
    border: Border,
    weights: Vec<T>,
    /// The place of the first pixel, from the output pixel's own first pixel on.
    first: isize,
    /// Memory: the weights in `f64`.
    exact: Vec<f64>,
}

impl<T: Scalar> Window<T> {
    pub(super) fn fill(
        &mut self,
        filter: &Filter,
        factor: usize,
        border: Border,
    ) -> Result<(), RenderError> {
        self.first = filter.fill_weights(factor, &mut self.exact)?;
        (self.factor, self.border) = (factor, border);
        self.weights.clear();
        self.weights.extend(self.exact.iter().map(|&weight| T::from_f64(weight)));
        Ok(())
    }

    /// Whether an output pixel is the first pixel of its own.
    pub(super) fn is_one_pixel(&self) -> bool {
        self.first == 0 && *self.exact == [1.0]
    }

    pub(super) fn len(&self) -> usize {
        self.weights.len() + self.exact.len()
    }

    /// How many output pixels a line of `width` pixels has.
    pub(super) fn count(&self, width: usize) -> usize {
        width / self.factor
    }

    /// How many pixels before a line are seen.
    fn before(&self) -> usize {
        self.first.min(0).unsigned_abs()
    }

    /// The place of the first output pixel's first pixel, in a line with those before it.
    fn shift(&self) -> usize {
        self.first.max(0).unsigned_abs()
    }

    /// How many pixels are seen of a line of `width` pixels and of what is before and after it.
    fn seen_pixels(&self, width: usize) -> usize {
        width - self.factor + self.shift() + self.weights.len()
    }

    /// How many steps of `factor` pixels such a line has.
    fn steps(&self, width: usize) -> usize {
        self.seen_pixels(width).max(self.before() + width).div_ceil(self.factor)
    }

    /// The places before and after the line's own, and the pixels of the line that stand there.
    fn outside(&self, width: usize) -> impl Iterator<Item = (usize, Option<usize>)> {
        let before = self.before();
        (0..before).chain(before + width..self.seen_pixels(width)).map(move |position| {
            (position, self.border.source(position as isize - before as isize, width))
        })
    }
}

/// For each row of a result, rows that it is the sum of, and their weights.
#[derive(Debug, Default)]
pub(super) struct Lists<T> {
    starts: Vec<usize>,
    entries: Vec<(u32, T)>,
}

impl<T: Scalar> Lists<T> {
    /// The rows of an image of `height` rows that each output row sees.
    pub(super) fn fill(&mut self, window: &Window<T>, height: usize) {
        self.starts.clear();
        self.entries.clear();
        for j in 0..height / window.factor {
            self.starts.push(self.entries.len());
            let first = (j * window.factor) as isize + window.first;
            for (position, &weight) in (first..).zip(&window.weights) {
                if let Some(row) = window.border.source(position, height) {
                    self.entries.push((row as u32, weight));
                }
            }
        }
        self.starts.push(self.entries.len());
    }

    /// For each of `height` rows the lists it is in.
    pub(super) fn transpose(&mut self, other: &Self, height: usize) {
        self.starts.clear();
        self.starts.resize(height + 1, 0);
        for &(row, _) in &other.entries {
            self.starts[row as usize + 1] += 1;
        }
        for row in 0..height {
            self.starts[row + 1] += self.starts[row];
        }
        self.entries.clear();
        self.entries.resize(other.entries.len(), (0, T::ZERO));
        for j in 0..other.starts.len() - 1 {
            for &(row, weight) in other.row(j) {
                // Each start moves to the next one's place, and all of them back below.
                let position = &mut self.starts[row as usize];
                self.entries[*position] = (j as u32, weight);
                *position += 1;
            }
        }
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    pub(super) fn row(&self, row: usize) -> &[(u32, T)] {
        &self.entries[self.starts[row]..self.starts[row + 1]]
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(&self.starts[..]) + size_of_val(&self.entries[..])
    }
}

/// `out = sum w_i row_i`, with rows as long as `out`.
#[inline(always)]
pub(super) fn weigh<T: Scalar>(list: &[(u32, T)], rows: &[T], out: &mut [T]) {
    weigh_into(list, rows, out, |out, sum| *out = sum);
}

/// `out += sum w_i row_i`.
#[inline(always)]
pub(super) fn add_weighed<T: Scalar>(list: &[(u32, T)], rows: &[T], out: &mut [T]) {
    weigh_into(list, rows, out, |out, sum| *out += sum);
}

#[inline(always)]
fn weigh_into<T: Scalar>(
    list: &[(u32, T)],
    rows: &[T],
    out: &mut [T],
    mut put: impl FnMut(&mut T, T),
) {
    let length = out.len();
    for (start, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
        let row = |k: usize| {
            let (row, weight) = list[k];
            (weight, &rows[row as usize * length + start..])
        };
        if out.len() == BLOCK {
            let sums = block_sum::<_, BLOCK>(list.len(), row);
            out.iter_mut().zip(sums).for_each(|(out, sum)| put(out, sum));
            continue;
        }
        for (k, out) in out.iter_mut().enumerate() {
            let [sum] = block_sum(list.len(), |i| (list[i].1, &row(i).1[k..]));
            put(out, sum);
        }
    }
}

/// The sum of `count` terms: the first entries of a slice, times a weight.
#[inline(always)]
fn block_sum<'a, T: Scalar, const N: usize>(
    count: usize,
    mut term: impl FnMut(usize) -> (T, &'a [T]),
) -> [T; N] {
    let mut sums = [T::ZERO; N];
    for start in (0..count).step_by(TERMS) {
        let mut parts = [T::ZERO; N];
        for k in start..count.min(start + TERMS) {
            let (weight, entries) = term(k);
            for (part, &entry) in parts.iter_mut().zip(&entries[..N]) {
                *part += weight * entry;
            }
        }
        if start == 0 {
            sums = parts;
        } else {
            sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
        }
    }
    sums
}

/// Memory for a line.
#[derive(Debug, Default)]
pub(super) struct Band<T> {
    /// A line with the pixels before and after it.
    line: Vec<T>,
    /// Its pixels, sorted by their place modulo the factor.
    phases: Vec<T>,
    /// An output line between zeros.
    padded: Vec<T>,
}

impl<T: Scalar> Band<T> {
    /// How many entries there is memory for.
    pub(super) fn len(&self) -> usize {
        self.line.len() + self.phases.len() + self.padded.len()
    }

    /// The line of `width` pixels itself, without those before and after it.
    #[inline(always)]
    pub(super) fn line(&mut self, window: &Window<T>, width: usize, channels: usize) -> &mut [T] {
        let length = window.steps(width) * window.factor * channels + BLOCK;
        reserve(&mut self.line, length);
        &mut self.line[window.before() * channels..][..width * channels]
    }

    /// The weighted sums of the line's pixels: `out` has a pixel for every `factor` pixels of it.
    #[inline(always)]
    pub(super) fn gather(
        &mut self,
        window: &Window<T>,
        width: usize,
        channels: usize,
        out: &mut [T],
    ) {
        self.extend(window, width, channels);
        let (factor, steps) = (window.factor, window.steps(width));
        let stride = steps * channels + BLOCK;
        let phases = if factor == 1 {
            &self.line
        } else {
            reserve(&mut self.phases, factor * stride);
            let line = &self.line[..steps * factor * channels];
            match channels {
                1 => sort::<T, 1>(line, factor, 1, &mut self.phases),
                3 => sort::<T, 3>(line, factor, 3, &mut self.phases),
                4 => sort::<T, 4>(line, factor, 4, &mut self.phases),
                _ => sort::<T, 0>(line, factor, channels, &mut self.phases),
            }
            &self.phases
        };
        for (start, out) in (0..).step_by(BLOCK).zip(out.chunks_mut(BLOCK)) {
            let (mut phase, mut step) = (window.shift() % factor, window.shift() / factor);
            let sums: [T; BLOCK] = block_sum(window.weights.len(), |t| {
                let entries = &phases[phase * stride + step * channels + start..];
                phase += 1;
                if phase == factor {
                    (phase, step) = (0, step + 1);
                }
                (window.weights[t], entries)
            });
            out.copy_from_slice(&sums[..out.len()]);
        }
    }

    /// The adjoint of [`Band::gather`]: fills in the line with what each of its pixels gave to `out`.
    #[inline(always)]
    pub(super) fn spread(&mut self, window: &Window<T>, width: usize, channels: usize, out: &[T]) {
        self.line(window, width, channels);
        let (factor, steps, shift) = (window.factor, window.steps(width), window.shift());
        let (stride, pixels_seen) = (steps * channels + BLOCK, shift + window.weights.len());
        // So many output pixels before a pixel's own see it, too.
        let margin = (pixels_seen - 1) / factor;
        self.padded.clear();
        self.padded.resize(margin * channels, T::ZERO);
        self.padded.extend_from_slice(out);
        self.padded.resize(margin * channels + stride, T::ZERO);
        let phases = if factor == 1 {
            &mut self.line
        } else {
            reserve(&mut self.phases, factor * stride);
            &mut self.phases
        };
        for phase in 0..factor {
            // Of the places `phase + factor * step`, those that weights are at.
            let steps_seen = (pixels_seen + factor - 1).saturating_sub(phase) / factor;
            let first = shift.saturating_sub(phase).div_ceil(factor);
            let phases = &mut phases[phase * stride..][..stride];
            for (start, to) in (0..).step_by(BLOCK).zip(phases.as_chunks_mut::<BLOCK>().0) {
                *to = block_sum(steps_seen.saturating_sub(first), |k| {
                    let step = first + k;
                    let weight = window.weights[phase + factor * step - shift];
                    (weight, &self.padded[(margin - step) * channels + start..])
                });
            }
        }
        if factor > 1 {
            let line = &mut self.line[..steps * factor * channels];
            match channels {
                1 => unsort::<T, 1>(&self.phases, factor, 1, line),
                3 => unsort::<T, 3>(&self.phases, factor, 3, line),
                4 => unsort::<T, 4>(&self.phases, factor, 4, line),
                _ => unsort::<T, 0>(&self.phases, factor, channels, line),
            }
        }
        self.fold(window, width, channels);
    }

    /// Writes to the line what is seen before and after it.
    #[inline(always)]
    fn extend(&mut self, window: &Window<T>, width: usize, channels: usize) {
        for (position, source) in window.outside(width) {
            let to = position * channels;
            match source {
                Some(source) => {
                    let from = (window.before() + source) * channels;
                    self.line.copy_within(from..from + channels, to);
                }
                None => self.line[to..to + channels].fill(T::ZERO),
            }
        }
    }

    /// The adjoint of [`Band::extend`].
    #[inline(always)]
    fn fold(&mut self, window: &Window<T>, width: usize, channels: usize) {
        for (position, source) in window.outside(width) {
            let Some(source) = source else { continue };
            for c in 0..channels {
                let term = self.line[position * channels + c];
                self.line[(window.before() + source) * channels + c] += term;
            }
        }
    }
}

/// Makes `memory` hold at least `length` entries.
#[inline(always)]
fn reserve<T: Scalar>(memory: &mut Vec<T>, length: usize) {
    if memory.len() < length {
        memory.resize(length, T::ZERO);
    }
}

/// Sorts the pixels of a line by their place modulo `factor`: runs of pixels, each followed by a block.
/// Pixels of `C` channels; 0 stands for any number, `channels`.
#[inline(always)]
fn sort<T: Scalar, const C: usize>(line: &[T], factor: usize, channels: usize, phases: &mut [T]) {
    let channels = if C == 0 { channels } else { C };
    let stride = line.len() / factor + BLOCK;
    for (step, pixels) in line.chunks_exact(factor * channels).enumerate() {
        for (phase, pixel) in pixels.chunks_exact(channels).enumerate() {
            copy(pixel, &mut phases[phase * stride + step * channels..][..channels]);
        }
    }
}

/// The inverse of [`sort`].
#[inline(always)]
fn unsort<T: Scalar, const C: usize>(phases: &[T], factor: usize, channels: usize, line: &mut [T]) {
    let channels = if C == 0 { channels } else { C };
    let stride = line.len() / factor + BLOCK;
    for (step, pixels) in line.chunks_exact_mut(factor * channels).enumerate() {
        for (phase, pixel) in pixels.chunks_exact_mut(channels).enumerate() {
            copy(&phases[phase * stride + step * channels..][..channels], pixel);
        }
    }
}
