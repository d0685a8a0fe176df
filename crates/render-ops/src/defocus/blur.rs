//! A rung's blur, of a part of the image.
//!
//! # Forward
//! `b = D .. D N K H .. H c`. H is the mean of the 2 x 2 pixels of a larger one, or of those that the image has;
//! what fills a rung has taken it. K are the weights of the iris, and N divides by what of them lies in the
//! image (`iris`). D doubles: along each axis a pixel is 3/4 of the one that it lies in and 1/4 of the nearer
//! neighbour; at the ends it is its own neighbour.
//!
//! K is summed by look-ups of running sums down columns. Columns are worked on in strips, so that these sums stay
//! in a core's own cache, and numbers side by side, in registers.
//!
//! # Backward
//! `c_bar = H^T .. K^T N D^T .. b_bar`. D^T is taken as soon as a band has its gradients, and reaches less than
//! two rows beyond it: these add up where K^T reads them.

use std::ops::Range;

use bokashi_core::Scalar;

use super::iris::Weights;
use super::strips::{Bands, halved};
use crate::size::Size;

/// Numbers summed at a time: they stay in registers through all look-ups.
const BLOCK: usize = 32;
/// Columns whose running sums are worked on at a time.
const COLUMNS: usize = 8 * BLOCK;

/// Memory for a blur.
#[derive(Debug, Default)]
pub(crate) struct Memory<T> {
    sums: Vec<T>,
    /// Images of one channel: of a blur, and twice as large.
    images: [Vec<T>; 2],
    look_ups: Vec<(usize, T)>,
    line: Vec<T>,
}

impl<T: Scalar> Memory<T> {
    /// A line of some numbers.
    fn line(line: &mut Vec<T>, length: usize) -> &mut [T] {
        if line.len() < length {
            line.resize(length, T::ZERO);
        }
        &mut line[..length]
    }

    /// Puts images back, the larger one last: it is taken for the larger image again.
    fn put_back(&mut self, mut images: [Vec<T>; 2]) {
        images.sort_by_key(Vec::capacity);
        self.images = images;
    }
}

/// A blur of a rung.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Blur<'a> {
    pub(crate) rung: usize,
    /// The size of the image, before it is halved.
    pub(crate) size: Size,
    pub(crate) halvings: usize,
    pub(crate) weights: &'a Weights,
}

/// Rows and columns.
pub(crate) type Part = [Range<usize>; 2];

impl Blur<'_> {
    /// The size that it works at.
    pub(crate) fn small_size(&self) -> Size {
        halved(self.size, self.halvings)
    }

    /// The part that doubling looks at for a part of the image, before each doubling: the last is the smallest.
    fn smaller_part(&self, part: &Part, halvings: usize) -> Part {
        let mut part = part.clone();
        for count in 1..=halvings {
            let Size { width, height } = halved(self.size, count);
            let half = |range: &Range<usize>, extent: usize| {
                (range.start / 2).saturating_sub(1)..(range.end.div_ceil(2) + 1).min(extent)
            };
            part = [half(&part[0], height), half(&part[1], width)];
        }
        part
    }

    /// The part at the rung's size that a part of the image has gradients for.
    pub(crate) fn small_part(&self, part: &Part) -> Part {
        self.smaller_part(part, self.halvings)
    }

    /// The columns of the image that see something of a rung, for some of its rows.
    pub(crate) fn columns_in_sight<T: Scalar>(
        &self,
        source: Bands<'_, T>,
        rows: &Range<usize>,
    ) -> Range<usize> {
        let small = self.smaller_part(&[rows.clone(), 0..self.size.width], self.halvings);
        let reach = self.weights.reach;
        let rows = small[0].start.saturating_sub(reach)..small[0].end + reach;
        let strips = source.strips(self.rung, self.halvings, rows);
        let (mut first, mut end) = (usize::MAX, 0);
        for strip in strips {
            first = first.min(strip.held.start);
            end = end.max(strip.held.end);
        }
        if first >= end {
            return 0..0;
        }
        // Each doubling looks one pixel farther.
        let [first, end] = [first.saturating_sub(reach + 2), end + reach + 2];
        (first << self.halvings)..(end << self.halvings).min(self.size.width)
    }

    /// Whether some rows at the rung's size see nothing of it.
    pub(crate) fn is_out_of_sight<T: Scalar>(
        &self,
        source: Bands<'_, T>,
        rows: &Range<usize>,
    ) -> bool {
        let rows = rows.start.saturating_sub(self.weights.reach)..rows.end + self.weights.reach;
        source.strips(self.rung, self.halvings, rows).next().is_none()
    }

    /// Blurs a channel of a rung into a part of the image.
    pub(crate) fn apply<S: Scalar>(
        &self,
        source: Bands<'_, S>,
        channel: usize,
        part: &Part,
        memory: &mut Memory<S>,
        out: &mut [S],
    ) {
        if self.halvings == 0 {
            self.convolve(source, channel, part, memory, out);
            return self.divide(part, out);
        }
        let mut small = self.small_part(part);
        let [mut image, mut larger] = std::mem::take(&mut memory.images);
        let pixels = |part: &Part| part[0].len() * part[1].len();
        image.resize(pixels(&small), S::ZERO);
        self.convolve(source, channel, &small, memory, &mut image);
        self.divide(&small, &mut image);
        for halvings in (1..self.halvings).rev() {
            let next = self.smaller_part(part, halvings);
            larger.resize(pixels(&next), S::ZERO);
            let line = Memory::line(&mut memory.line, small[1].len() + 2);
            let size = halved(self.size, halvings + 1);
            double(&image, &small, size, &next, [line, &mut larger]);
            std::mem::swap(&mut image, &mut larger);
            small = next;
        }
        let line = Memory::line(&mut memory.line, small[1].len() + 2);
        double(&image, &small, halved(self.size, 1), part, [line, out]);
        memory.put_back([image, larger]);
    }

    /// `out = N D^T .. D^T image`: from a part of the image to [`Blur::small_part`] of it.
    pub(crate) fn pull_back_size<T: Scalar>(
        &self,
        image: &[T],
        part: &Part,
        memory: &mut Memory<T>,
        out: &mut [T],
    ) {
        if self.halvings == 0 {
            out.copy_from_slice(image);
            return self.divide(part, out);
        }
        let [mut to, mut from] = std::mem::take(&mut memory.images);
        from.clear();
        from.extend_from_slice(image);
        let mut larger = part.clone();
        for count in 1..=self.halvings {
            let next = self.smaller_part(part, count);
            to.clear();
            to.resize(next[0].len() * next[1].len(), T::ZERO);
            let line = Memory::line(&mut memory.line, next[1].len());
            double_adjoint(&from, &larger, halved(self.size, count), &next, [line, &mut to]);
            std::mem::swap(&mut from, &mut to);
            larger = next;
        }
        out.copy_from_slice(&from);
        memory.put_back([from, to]);
        self.divide(&larger, out);
    }

    /// Divides by the weights that lie in the image.
    fn divide<T: Scalar>(&self, [rows, columns]: &Part, out: &mut [T]) {
        let (reach, size) = (self.weights.reach, self.small_size());
        let is_near = |index: usize, extent: usize| index < reach || index + reach >= extent;
        for (row, out) in rows.clone().zip(out.chunks_exact_mut(columns.len().max(1))) {
            let is_row_near = is_near(row, size.height);
            for (column, out) in columns.clone().zip(out) {
                if is_row_near || is_near(column, size.width) {
                    let sum = self.weights.sum_inside([row, column], size);
                    *out = *out / T::from_f64(sum);
                }
            }
        }
    }

    /// `out = K source`, of a part at the rung's size.
    pub(crate) fn convolve<S: Scalar>(
        &self,
        source: Bands<'_, S>,
        channel: usize,
        part: &Part,
        memory: &mut Memory<S>,
        out: &mut [S],
    ) {
        let [rows, columns] = part;
        let reach = self.weights.reach;
        if reach == 0 {
            out.fill(S::ZERO);
            return self.copy(source, channel, part, out);
        }
        for start in columns.clone().step_by(COLUMNS) {
            let strip = start..columns.end.min(start + COLUMNS);
            let stride = strip.len().next_multiple_of(BLOCK) + 2 * reach;
            let Memory { sums, look_ups, .. } = memory;
            sums.clear();
            sums.resize((rows.len() + 2 * reach + 1) * stride, S::ZERO);
            let is_empty = !self.add_rows(source, channel, [rows, &strip], stride, sums);
            let width = columns.len();
            let first = start - columns.start;
            if is_empty {
                for out in out.chunks_exact_mut(width) {
                    out[first..first + strip.len()].fill(S::ZERO);
                }
                continue;
            }
            let is_direct = self.weights.is_direct;
            look_ups.clear();
            look_ups.extend(self.weights.look_ups.iter().map(|look_up| {
                // The first row of sums stands before the first row of pixels.
                let row = (look_up.row + reach as isize) as usize + usize::from(is_direct);
                let column = (look_up.column + reach as isize) as usize;
                (row * stride + column, S::from_f64(look_up.weight))
            }));
            let added = if is_direct { 0 } else { rows.len() + 2 * reach };
            let work = Sums { sums, look_ups, stride, added };
            let out = Target { values: out, width, first, length: strip.len() };
            crate::dispatch::dispatch_256::<S, _>(
                #[inline(always)]
                || work.run(out),
            );
        }
    }

    /// Adds what a rung holds to rows that the first row of `sums` stands before; whether there is anything.
    fn add_rows<S: Scalar>(
        &self,
        source: Bands<'_, S>,
        channel: usize,
        [rows, columns]: [&Range<usize>; 2],
        stride: usize,
        sums: &mut [S],
    ) -> bool {
        let reach = self.weights.reach;
        let seen = rows.start.saturating_sub(reach)..rows.end + reach;
        let mut is_any = false;
        for strip in source.strips(self.rung, self.halvings, seen.clone()) {
            let first = strip.held.start.max(columns.start.saturating_sub(reach));
            let end = strip.held.end.min(columns.end + reach);
            if first >= end {
                continue;
            }
            is_any = true;
            for row in strip.rows.start.max(seen.start)..strip.rows.end.min(seen.end) {
                let start = (row + reach + 1 - rows.start) * stride + first + reach - columns.start;
                let from = strip.row(channel, row, first..end);
                let to = &mut sums[start..start + from.len()];
                to.iter_mut().zip(from).for_each(|(to, &from)| *to += from);
            }
        }
        is_any
    }

    /// Adds what a rung holds, where its blur is the identity.
    fn copy<S: Scalar>(
        &self,
        source: Bands<'_, S>,
        channel: usize,
        [rows, columns]: &Part,
        out: &mut [S],
    ) {
        for strip in source.strips(self.rung, self.halvings, rows.clone()) {
            let held = strip.held.start.max(columns.start)..strip.held.end.min(columns.end);
            if held.is_empty() {
                continue;
            }
            for row in strip.rows.start.max(rows.start)..strip.rows.end.min(rows.end) {
                let start = (row - rows.start) * columns.len() + held.start - columns.start;
                let from = strip.row(channel, row, held.clone());
                let to = &mut out[start..start + from.len()];
                to.iter_mut().zip(from).for_each(|(to, &from)| *to += from);
            }
        }
    }
}

/// Rows, and look-ups of them.
struct Sums<'a, T> {
    sums: &'a mut [T],
    look_ups: &'a [(usize, T)],
    stride: usize,
    /// To how many rows, from the second one on, those above are to be added.
    added: usize,
}

/// Columns of an image.
struct Target<'a, T> {
    values: &'a mut [T],
    width: usize,
    first: usize,
    length: usize,
}

impl<T: Scalar> Sums<'_, T> {
    #[inline(always)]
    fn run(self, target: Target<'_, T>) {
        let Self { sums, look_ups, stride, added } = self;
        for row in 0..added {
            let (before, after) = sums.split_at_mut((row + 1) * stride);
            let (before, after) = (&before[row * stride..], &mut after[..stride]);
            for i in 0..stride {
                after[i] += before[i];
            }
        }
        let Target { values, width, first, length } = target;
        for (row, out) in values.chunks_exact_mut(width).enumerate() {
            let out = &mut out[first..first + length];
            for (k, out) in out.chunks_mut(BLOCK).enumerate() {
                let start = row * stride + k * BLOCK;
                let mut sum = [T::ZERO; BLOCK];
                for &(offset, weight) in look_ups {
                    let entries = &sums[start + offset..start + offset + BLOCK];
                    let entries: &[T; BLOCK] = entries.try_into().expect("a block");
                    for i in 0..BLOCK {
                        sum[i] += weight * entries[i];
                    }
                }
                match out.first_chunk_mut::<BLOCK>() {
                    Some(out) => *out = sum,
                    None => out.copy_from_slice(&sum[..out.len()]),
                }
            }
        }
    }
}

/// Doubles a part of a smaller image, of a whole of size `size`, into a part of the larger one.
fn double<T: Scalar>(
    from: &[T],
    part: &Part,
    size: Size,
    larger: &Part,
    [line, out]: [&mut [T]; 2],
) {
    let width = part[1].len();
    let quarter = T::from_f64(0.25);
    let columns = larger[1].clone();
    // The line has a number more on both sides.
    let at = |column: usize| column / 2 + 1 - part[1].start;
    for (row, out) in larger[0].clone().zip(out.chunks_exact_mut(columns.len().max(1))) {
        let [near, far] =
            nearest(row, size.height).map(|row| &from[(row - part[0].start) * width..][..width]);
        for i in 0..width {
            line[i + 1] = near[i] + quarter * (far[i] - near[i]);
        }
        (line[0], line[width + 1]) = (line[1], line[width]);
        for side in 0..2 {
            let first = columns.start + (columns.start + side) % 2;
            let from = &line[at(first) - 1..];
            let out = out.get_mut(first - columns.start..).unwrap_or_default();
            for (out, from) in out.iter_mut().step_by(2).zip(from.windows(3)) {
                *out = from[1] + quarter * (from[2 * side] - from[1]);
            }
        }
    }
}

/// Adds to a part of a smaller image what doubling has to give back of a part of the larger one.
fn double_adjoint<T: Scalar>(
    from: &[T],
    larger: &Part,
    size: Size,
    part: &Part,
    [line, out]: [&mut [T]; 2],
) {
    let width = part[1].len();
    let [one, three] = [0.25, 0.75].map(T::from_f64);
    let columns = larger[1].clone();
    let line = &mut line[..width];
    for (row, from) in larger[0].clone().zip(from.chunks_exact(columns.len().max(1))) {
        line.fill(T::ZERO);
        for (column, &from) in columns.clone().zip(from) {
            let [near, far] = nearest(column, size.width).map(|at| at - part[1].start);
            line[near] += three * from;
            line[far] += one * from;
        }
        for (at, share) in nearest(row, size.height).into_iter().zip([three, one]) {
            let out = &mut out[(at - part[0].start) * width..][..width];
            out.iter_mut().zip(&*line).for_each(|(out, &sum)| *out += share * sum);
        }
    }
}

/// Of a pixel of a larger image the pixel that it lies in, and the nearer neighbour.
#[inline(always)]
fn nearest(index: usize, extent: usize) -> [usize; 2] {
    let near = index / 2;
    let far =
        if index.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(extent - 1) };
    [near, far]
}

#[cfg(test)]
mod tests {
    use super::super::iris::Iris;
    use super::super::strips::{ROWS, Strips};
    use super::*;

    const SIZE: Size = Size { width: 45, height: 39 };
    const RUNG: usize = 5;

    fn number(k: usize) -> f64 {
        ((k * 7919 + 13) % 1009) as f64 / 1009.0 - 0.3
    }

    /// Some numbers per pixel of a size, as bands hold them.
    fn bands(halvings: usize, values: &[f64]) -> Vec<Strips<f64>> {
        let size = halved(SIZE, halvings);
        let mut bands = vec![Strips::default(); SIZE.height.div_ceil(ROWS)];
        for (k, band) in bands.iter_mut().enumerate() {
            let rows = (k * ROWS) >> halvings..size.height.min(((k + 1) * ROWS) >> halvings);
            let strip = band.push(RUNG, 1, [rows.clone(), 0..size.width]);
            strip.values.copy_from_slice(&values[rows.start * size.width..rows.end * size.width]);
        }
        bands
    }

    fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    fn blurs() -> Vec<(usize, [Weights; 2])> {
        let irises = [Iris::Disc, Iris::Polygon { blades: 5, rotation: 0.3 }];
        let all = irises.into_iter().flat_map(|iris| {
            [(0, 0.0), (0, 0.03), (0, 2.1), (1, 5.0), (2, 4.1), (4, 3.0)]
                .map(|(halvings, variance)| (halvings, Weights::pair(iris, variance)))
        });
        all.collect()
    }

    #[test]
    fn a_blur_at_its_own_size_is_the_mean_through_the_iris() {
        let values: Vec<_> = (0..SIZE.pixels()).map(number).collect();
        let source = bands(0, &values);
        for (halvings, [weights, _]) in blurs().into_iter().filter(|(halvings, _)| *halvings == 0) {
            let blur = Blur { rung: RUNG, size: SIZE, halvings, weights: &weights };
            let part = [3..34, 2..44];
            let mut out = vec![f64::NAN; 31 * 42];
            let source = Bands { bands: &source, first: 0 };
            blur.apply(source, 0, &part, &mut Memory::default(), &mut out);
            for (row, column) in [(3, 2), (33, 43), (17, 20), (5, 40)] {
                // A column's running sums, one change of weight after another; or its pixels.
                let below = |row: isize, column: isize| -> f64 {
                    let is_inside = (0..SIZE.width as isize).contains(&column);
                    let rows = 0..row.clamp(0, SIZE.height as isize) as usize;
                    let pixel = |row: usize| values[row * SIZE.width + column as usize];
                    if is_inside { rows.map(pixel).sum() } else { 0.0 }
                };
                let terms = weights.look_ups.iter().map(|look_up| {
                    let (row, column) =
                        (row as isize + look_up.row, column as isize + look_up.column);
                    let sum = match weights.is_direct {
                        true => below(row + 1, column) - below(row, column),
                        false => below(row, column),
                    };
                    look_up.weight * sum
                });
                let expected = terms.sum::<f64>() / weights.sum_inside([row, column], SIZE);
                let found = out[(row - 3) * 42 + column - 2];
                assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
            }
        }
    }

    #[test]
    fn a_constant_stays_constant_to_the_border() {
        for (halvings, [weights, _]) in blurs() {
            let blur = Blur { rung: RUNG, size: SIZE, halvings, weights: &weights };
            let source = bands(halvings, &vec![0.7; blur.small_size().pixels()]);
            let mut out = vec![f64::NAN; SIZE.pixels()];
            let source = Bands { bands: &source, first: 0 };
            let part = [0..SIZE.height, 0..SIZE.width];
            blur.apply(source, 0, &part, &mut Memory::default(), &mut out);
            assert!(out.iter().all(|value| (value - 0.7).abs() < 1e-13), "{halvings}");
        }
    }

    #[test]
    fn the_adjoint_has_the_same_dot_products() {
        for (halvings, [weights, turned]) in blurs() {
            let blur = Blur { rung: RUNG, size: SIZE, halvings, weights: &weights };
            let small = blur.small_size();
            let image: Vec<_> = (0..small.pixels()).map(number).collect();
            let source = bands(halvings, &image);
            let source = Bands { bands: &source, first: 0 };
            let memory = &mut Memory::default();
            // The picture lies within a margin.
            let first = 3;
            let (mut forward, mut bars) = (0.0, Vec::new());
            for start in (first..SIZE.height - 2).step_by(ROWS) {
                let part = [start..(start + ROWS).min(SIZE.height - 2), 4..SIZE.width - 1];
                let pixels = part[0].len() * part[1].len();
                let bar: Vec<_> = (0..pixels).map(|k| number(k + 31 * start)).collect();
                let mut out = vec![f64::NAN; pixels];
                blur.apply(source, 0, &part, memory, &mut out);
                forward += dot(&out, &bar);
                let small_part = blur.small_part(&part);
                let mut strips = Strips::default();
                let strip = strips.push(RUNG, 1, small_part);
                blur.pull_back_size(&bar, &part, memory, &mut strip.values);
                bars.push(strips);
            }
            let bars = Bands { bands: &bars, first };
            let turned = Blur { weights: &turned, ..blur };
            let mut image_bar = vec![f64::NAN; small.pixels()];
            let all = [0..small.height, 0..small.width];
            turned.convolve(bars, 0, &all, memory, &mut image_bar);
            let backward = dot(&image, &image_bar);
            assert!((forward - backward).abs() < 1e-11, "{halvings}: {forward}, {backward}");
        }
    }
}
