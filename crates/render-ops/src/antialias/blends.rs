//! What antialiasing keeps of a step: the blends, and memory.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::parallel::{for_each_zipped_mut, is_shared, join, merge_each};
use bokashi_core::{Accumulators, Kept, Scalar};

use super::discontinuity::Blend;
use super::search::{Candidate, Found, LINES, MISSING, Search};
use super::sorting::Sorting;
use crate::coverage::Coverage;
use crate::dispatch::dispatch_256;
use crate::face_sums::add_term;
use crate::picture::with_channels;
use crate::scratch::Workbench;
use crate::size::Size;

/// The blends, and memory.
#[derive(Debug, Default)]
pub(super) struct SavedBlends<T: Scalar> {
    pub(super) blends: Vec<Blend<T::Wide>>,
    /// Per blend: the rows of its two pixels in the output.
    pub(super) rows: Vec<[u32; 2]>,
    /// Per blend and channel: `c_1 - c_0`, or where shares were divided, what stands in its place.
    steps: Vec<T>,
    /// The blends at pixels with several of them, pixel by pixel.
    joint: Vec<Joint<T::Wide>>,
    /// Memory: per pixel of these and channel, the range of what is blended there.
    ranges: Vec<[T; 2]>,
    /// Memory: per row of the output that is blended, the sum of the shares.
    sums: Vec<T::Wide>,
    /// The uncovered pixels of all blends, in order.
    pub(super) background_pixels: Option<Arc<Vec<u32>>>,
    /// Memory: per 64 pixels a bit for each background pixel, and how many of them come before.
    marks: Vec<(u64, u32)>,
    /// Memory: per blend and channel, alpha times what is upstream of the blended pixel.
    shares: Vec<T>,
    /// Memory: per blend the gradients of its edge's vertices.
    bars: Vec<EdgeBars<T>>,
    /// Memory: what is found at all silhouettes, and at those of a band.
    found: Vec<Found<T::Wide>>,
    lists: Workbench<Vec<Found<T::Wide>>>,
    candidates: Workbench<Vec<Candidate<T::Wide>>>,
    /// Memory: the order of what is found.
    order: Sorting,
}

/// A blend at a pixel where others blend, too.
#[derive(Debug, Clone, Copy)]
struct Joint<S> {
    /// The row of the pixel in the output.
    row: u32,
    blend: u32,
    /// Of all shares at the pixel; where it is above 1 they were divided by it.
    sum: S,
}

/// The gradients with respect to clip (x, y, w) of an edge's two vertices.
type EdgeBars<T> = [[T; 3]; 2];

/// Blends in one piece of work: some microseconds.
const BLENDS_PER_PIECE: usize = 1 << 5;

/// From so many blends on they are shared by several threads.
const BLENDS_TO_SHARE: usize = 1 << 6;

/// From so many blends on one thread divides shares while another copies values.
const BLENDS_TO_DIVIDE: usize = 1 << 12;

impl<T: Scalar> SavedBlends<T> {
    /// Finds all blends, row by row, and the fragments of their pixels.
    pub(super) fn find(&mut self, coverage: &Coverage, clip: &[T]) {
        let Self { blends, rows, found, lists, candidates, order, .. } = self;
        let (view, centers) = (Search { coverage, clip, candidates }, &coverage.centers);
        found.clear();
        if centers.is_shared() {
            let work = |slots: Range<usize>, _: usize, _: &mut [T]| {
                let mut of_band = lists.take();
                view.find(slots, &mut of_band);
                of_band
            };
            centers.merge_bands_mut(0, &mut [], work, |mut of_band| {
                found.append(&mut of_band);
                lists.put_back(of_band);
            });
        } else {
            (0..centers.bands())
                .for_each(|band| view.find(centers.slots_of(band..band + 1), found));
        }
        let Size { width, height } = coverage.size();
        order.start(found.len());
        order.sort_by(width, |index| found[index].column as usize);
        order.sort_by(LINES * height, |index| found[index].line as usize);
        let found = || order.indices.iter().map(|&index| &found[index as usize]);
        blends.clear();
        blends.extend(found().map(|found| found.blend));
        rows.clear();
        rows.extend(found().map(|found| found.fragments));
    }

    /// Finds the background pixels that are blended, and the rows of the blends' pixels.
    pub(super) fn find_rows(&mut self, coverage: &Coverage) {
        let Self { blends, rows, background_pixels, marks, .. } = self;
        if background_pixels.as_mut().and_then(Arc::get_mut).is_none() {
            *background_pixels = None;
        }
        let background_pixels =
            Arc::get_mut(background_pixels.get_or_insert_default()).expect("nobody else holds it");
        background_pixels.clear();
        let size = coverage.size();
        let mut for_each_missing = |visit: &mut dyn FnMut(u32, &mut u32)| {
            for (blend, rows) in blends.iter().zip(rows.iter_mut()) {
                for (pixel, row) in blend.pixels(size).into_iter().zip(rows) {
                    if *row == MISSING {
                        visit(pixel, row);
                    }
                }
            }
        };
        // A bit for each pixel: in the order of pixels, each once, without sorting.
        let word_and_bit = |pixel: u32| (pixel as usize / 64, pixel % 64);
        marks.clear();
        marks.resize(size.pixels().div_ceil(64), (0, 0));
        for_each_missing(&mut |pixel, _| {
            let (word, bit) = word_and_bit(pixel);
            marks[word].0 |= 1 << bit;
        });
        for (word, (bits, before)) in
            marks.iter_mut().enumerate().filter(|(_, (bits, _))| *bits != 0)
        {
            *before = background_pixels.len() as u32;
            let mut rest = *bits;
            while rest != 0 {
                background_pixels.push(64 * word as u32 + rest.trailing_zeros());
                rest &= rest - 1;
            }
        }
        for_each_missing(&mut |pixel, row| {
            let (word, bit) = word_and_bit(pixel);
            let (bits, before) = marks[word];
            // Its place in the order of pixels: marks before its word, and before its bit.
            let index = before + (bits & ((1 << bit) - 1)).count_ones();
            *row = coverage.count() as u32 + index;
        });
    }

    /// [`SavedBlends::divide`], and beside it copies the aliased values.
    pub(super) fn divide_and_copy(&mut self, values: &mut [T], input: &[T]) {
        let are_shared = is_shared(self.blends.len(), BLENDS_TO_DIVIDE);
        let copy = || for_each_zipped_mut(values, [input], |value, [input]| *value = input);
        join(are_shared, || self.divide(), copy);
    }

    /// Divides shares at one pixel by their sum where that is above 1.
    fn divide(&mut self) {
        let Self { blends, rows, joint, sums, .. } = self;
        let target = |blend: &Blend<T::Wide>, rows: &[u32; 2]| rows[blend.target()];
        let most = rows.iter().flatten().max().map_or(0, |&row| row as usize + 1);
        if sums.len() < most {
            // Not resized, which would write to all of them: most rows are never blended.
            *sums = vec![T::Wide::ZERO; most.next_power_of_two()];
        }
        let placed = || blends.iter().zip(&*rows);
        placed().for_each(|(blend, rows)| sums[target(blend, rows) as usize] = T::Wide::ZERO);
        for (blend, rows) in placed() {
            sums[target(blend, rows) as usize] += blend.alpha.abs();
        }
        joint.clear();
        for (index, (blend, rows)) in (0..).zip(placed()) {
            let row = target(blend, rows);
            let sum = sums[row as usize];
            // The sum of one share is that share, to the bit.
            if sum != blend.alpha.abs() {
                joint.push(Joint { row, blend: index, sum });
            }
        }
        joint.sort_unstable_by_key(|joint| (joint.row, joint.blend));
        for &Joint { blend, sum, .. } in joint.iter().filter(|joint| joint.sum > T::Wide::ONE) {
            let alpha = &mut blends[blend as usize].alpha;
            *alpha = *alpha / sum;
        }
    }

    /// Each blend, the first entries of its two pixels, and which of the two is blended.
    fn placed(
        &self,
        channels: usize,
    ) -> impl Iterator<Item = (&Blend<T::Wide>, [usize; 2], usize)> {
        self.placed_from(0, channels)
    }

    /// [`SavedBlends::placed`], of the blends from `first` on.
    fn placed_from(
        &self,
        first: usize,
        channels: usize,
    ) -> impl Iterator<Item = (&Blend<T::Wide>, [usize; 2], usize)> {
        self.blends[first..].iter().zip(&self.rows[first..]).map(move |(blend, rows)| {
            let entries = rows.map(|row| row as usize * channels);
            (blend, entries, entries[blend.target()])
        })
    }

    /// Adds the gradient of clip positions, `[V, 4]`: x, y and w of the vertices of blended edges.
    pub(super) fn add_clip_bars(
        &mut self,
        out_bar: &[T],
        channels: usize,
        (clip, size): (&[T], Size),
        clip_bar: &mut [T],
    ) {
        let mut bars = std::mem::take(&mut self.bars);
        bars.resize(self.blends.len(), [[T::ZERO; 3]; 2]);
        let work = |(piece, bars): (usize, _)| {
            let bars: &mut [EdgeBars<T>] = bars;
            let first = piece * BLENDS_PER_PIECE;
            self.pull_back(first, out_bar, channels, (clip, size), bars);
            (first, &*bars)
        };
        let pieces = bars.chunks_mut(BLENDS_PER_PIECE).enumerate();
        let are_shared = is_shared(self.blends.len(), BLENDS_TO_SHARE);
        merge_each(are_shared, pieces, work, |(first, bars)| {
            let blends = self.blends[first..].iter().zip(bars);
            for (blend, bars) in blends.filter(|(blend, _)| !blend.clamped) {
                for (&vertex, &[x_bar, y_bar, w_bar]) in blend.edge.iter().zip(bars) {
                    let row = &mut clip_bar[4 * vertex as usize..][..4];
                    add_term(&mut row[0], x_bar);
                    add_term(&mut row[1], y_bar);
                    add_term(&mut row[3], w_bar);
                }
            }
        });
        self.bars = bars;
    }

    /// Adds the gradient of the background at its blended pixels, whose k-th has its entries from
    /// `start_of(k)` on. The first `covered` entries of `out_bar` are those of fragments.
    pub(super) fn add_background_bars(
        &self,
        out_bar: &[T],
        [covered, channels]: [usize; 2],
        start_of: impl Fn(usize) -> usize,
        background_bar: &mut [T],
    ) {
        for (k, bar) in out_bar[covered..].chunks_exact(channels).enumerate() {
            let entries = &mut background_bar[start_of(k)..][..channels];
            entries.iter_mut().zip(bar).for_each(|(entry, &bar)| *entry += bar);
        }
        for (blend, entries, target) in self.placed(channels) {
            let alpha = T::narrow(blend.alpha);
            for (entry, sign) in entries.into_iter().zip([-T::ONE, T::ONE]) {
                let Some(background_entry) = entry.checked_sub(covered) else { continue };
                let start = start_of(background_entry / channels);
                for c in 0..channels {
                    background_bar[start + c] += sign * (alpha * out_bar[target + c]);
                }
            }
        }
    }

    /// The gradients of the edges of some blends from `first` on, in their order, as if none were clamped.
    fn pull_back(
        &self,
        first: usize,
        out_bar: &[T],
        channels: usize,
        (clip, size): (&[T], Size),
        bars: &mut [EdgeBars<T>],
    ) {
        dispatch_256::<T, _>(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let bars = bars;
                with_channels(
                    channels,
                    #[inline(always)]
                    |channels| {
                        let steps = self.steps[first * channels..].chunks_exact(channels);
                        let placed = self.placed_from(first, channels).zip(steps);
                        for (((blend, _, target), steps), bars) in placed.zip(&mut *bars) {
                            let terms = steps.iter().zip(&out_bar[target..][..channels]);
                            let alpha_bar =
                                terms.map(|(step, bar)| bar.widen() * step.widen()).sum();
                            let of_ends = blend.pull_back(alpha_bar, clip, size);
                            let pairs = bars.as_flattened_mut().iter_mut();
                            pairs
                                .zip(of_ends.as_flattened())
                                .for_each(|(to, &bar)| *to = T::narrow(bar));
                        }
                    },
                );
            },
        );
    }

    /// Finds alpha times what is upstream of the blended pixels.
    fn find_shares(&mut self, out_bar: &[T], channels: usize) {
        let mut shares = std::mem::take(&mut self.shares);
        shares.resize(self.blends.len() * channels, T::ZERO);
        with_channels(
            channels,
            #[inline(always)]
            |channels| {
                let shares = shares.chunks_exact_mut(channels);
                for ((blend, _, target), shares) in self.placed(channels).zip(shares) {
                    let alpha = T::narrow(blend.alpha);
                    let bars = &out_bar[target..][..channels];
                    shares.iter_mut().zip(bars).for_each(|(share, &bar)| *share = alpha * bar);
                }
            },
        );
        self.shares = shares;
    }

    /// Adds the shares to the gradient of the values of fragments. What leads to the background is in
    /// [`SavedBlends::add_background_bars`].
    fn add_shares(&self, channels: usize, values_bar: &mut [T]) {
        with_channels(
            channels,
            #[inline(always)]
            |channels| {
                let shares = self.shares.chunks_exact(channels);
                for (rows, shares) in self.rows.iter().zip(shares) {
                    for (&row, sign) in rows.iter().zip([-T::ONE, T::ONE]) {
                        let entry = row as usize * channels;
                        let Some(bars) = values_bar.get_mut(entry..entry + channels) else {
                            continue;
                        };
                        bars.iter_mut().zip(shares).for_each(|(bar, &share)| *bar += sign * share);
                    }
                }
            },
        );
    }

    /// Adds the gradient of input 1, the values, whose entries are the first `covered` of the output. It comes last: the
    /// upstream gradient is changed in place, if it was `taken` since nobody else reads it.
    pub(super) fn pull_back_values(
        &mut self,
        taken: Option<Vec<T>>,
        channels: usize,
        covered: usize,
        kept: &Kept<'_, T>,
        gradients: &mut Accumulators<'_, T>,
    ) {
        if !gradients.needs(1) {
            // The memory goes back to the tape.
            if let Some(out_bar) = taken {
                gradients.give(1, out_bar);
            }
            return;
        }
        self.find_shares(taken.as_deref().unwrap_or_else(|| kept.only_upstream()), channels);
        match taken {
            Some(mut out_bar) => {
                out_bar.truncate(covered);
                gradients.give(1, out_bar);
            }
            None => {
                let values_bar = gradients.get(1).expect("it is wanted");
                values_bar.add(&kept.only_upstream()[..covered]);
            }
        }
        self.add_shares(channels, gradients.get(1).expect("it is wanted").entries());
    }

    /// Blends pixels of `out`, which holds the aliased values.
    pub(super) fn blend(&mut self, out: &mut [T], channels: usize) {
        let mut steps = std::mem::take(&mut self.steps);
        steps.resize(self.blends.len() * channels, T::ZERO);
        let mut ranges = std::mem::take(&mut self.ranges);
        self.find_ranges(out, channels, &mut ranges);
        with_channels(
            channels,
            #[inline(always)]
            |channels| {
                let rows = self.rows.iter().map(|rows| rows.map(|row| row as usize * channels));
                for (steps, [first, second]) in steps.chunks_exact_mut(channels).zip(rows) {
                    let (from, to) = (&out[first..][..channels], &out[second..][..channels]);
                    for ((step, &from), &to) in steps.iter_mut().zip(from).zip(to) {
                        *step = to - from;
                    }
                }
                let steps = steps.chunks_exact(channels);
                for ((blend, _, target), steps) in self.placed(channels).zip(steps) {
                    let alpha = T::narrow(blend.alpha);
                    let out = &mut out[target..][..channels];
                    out.iter_mut().zip(steps).for_each(|(out, &step)| *out += alpha * step);
                }
            },
        );
        let pixels = self.joint.chunk_by(|one, other| one.row == other.row);
        for (same, ranges) in pixels.zip(ranges.chunks_exact(channels.max(1))) {
            let first = same[0].row as usize * channels;
            for (out, &[least, most]) in out[first..].iter_mut().zip(ranges) {
                let off = out.maximum_or_nan(least).minimum_or_nan(most) - *out;
                // Rounding alone: the sum has the value of the bound, and keeps its slope.
                if off != T::ZERO && off.is_finite() {
                    *out += T::from_f64(off.to_f64());
                }
            }
            if same[0].sum <= T::Wide::ONE {
                continue;
            }
            let blend = |joint: &Joint<_>| &self.blends[joint.blend as usize];
            // A share a_k was divided by S, the sum of all |a_k| here. So with a_k the pixel changes by
            // `(step_k - sign(a_k) moved) / S`, where `moved` is by how much it was moved in all.
            for c in 0..channels {
                let index = |joint: &Joint<_>| joint.blend as usize * channels + c;
                let moved = same.iter().map(|k| blend(k).alpha * steps[index(k)].widen());
                let moved: T::Wide = moved.sum();
                for k in same {
                    let moved = if blend(k).target() == 0 { moved } else { -moved };
                    steps[index(k)] = T::narrow((steps[index(k)].widen() - moved) / k.sum);
                }
            }
        }
        self.steps = steps;
        self.ranges = ranges;
    }

    /// The bytes that the blends hold, for reports.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.blends.as_slice())
            + size_of_val(self.rows.as_slice())
            + size_of_val(self.steps.as_slice())
            + size_of_val(self.joint.as_slice())
            + size_of_val(self.found.as_slice())
            + self.lists.bytes()
            + self.candidates.bytes()
    }

    /// The ranges of what is blended at pixels with several blends, from the aliased values `out`.
    fn find_ranges(&self, out: &[T], channels: usize, ranges: &mut Vec<[T; 2]>) {
        ranges.clear();
        for same in self.joint.chunk_by(|one, other| one.row == other.row) {
            let first = ranges.len();
            let values = &out[same[0].row as usize * channels..][..channels];
            ranges.extend(values.iter().map(|&value| [value; 2]));
            for joint in same {
                let (blend, rows) =
                    (&self.blends[joint.blend as usize], self.rows[joint.blend as usize]);
                let other = rows[1 - blend.target()] as usize * channels;
                for ([least, most], &other) in ranges[first..].iter_mut().zip(&out[other..]) {
                    *least = least.minimum_or_nan(other);
                    *most = most.maximum_or_nan(other);
                }
            }
        }
    }
}
