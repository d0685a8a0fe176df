//! Analytic antialiasing of silhouettes: it blends neighbouring pixels by where a silhouette edge
//! passes between their centres, and so gives silhouettes a gradient.
//!
//! # Forward
//! Take each pixel with its right and its lower neighbour, of colours `c_0` and `c_1`, where triangle
//! ids differ. The edge between them belongs to the triangle that covers a pixel; where both are
//! covered, to the nearer triangle. Of its edges that cross the line through the two centres take the
//! edge that lies farthest towards the other pixel. Use it only if it is a silhouette, runs more
//! across the line than along it, and crosses between the two centres. A silhouette has no face on its
//! other side, or a face seen edge-on, or both faces lie on the same side of it in the image.
//!
//! Let d be the distance of the crossing from the covered centre, and `s = 1` where the triangle
//! covers the first pixel, -1 where it covers the second. Then `alpha = s (1/2 - d)`: where positive
//! `out_0 += alpha (c_1 - c_0)`, else `out_1 += alpha (c_1 - c_0)`. All reads are from the aliased
//! picture, so up to four blends add at a pixel, each with a share `a_k = |alpha_k|` of at most 1/2.
//! Where `s = sum a_k` is above 1, at specks around a centre, the shares are divided by s. So a pixel
//! is always a mean of its neighbours and itself, and never leaves their range: where several blends add,
//! their sum is held within it, against rounding.
//!
//! # Backward
//! `alpha_bar = out_bar . (c_1 - c_0)` at the blended pixel; `c_bar_0 -= alpha out_bar`,
//! `c_bar_1 += alpha out_bar`, beside `c_bar = out_bar`; from alpha to the edge's vertices as in
//! `discontinuity`. Where shares were divided, `out = c + m` with `m = sum a_k d_k / s`, `d_k` the steps
//! to the neighbours: then `(d_k - m) / s` stands in the place of `d_k`.
//!
//! # Where it is not smooth
//! Where a crossing reaches a pixel centre, an edge passes through 45 degrees, shares begin to add up to
//! more than 1, or an edge starts or stops being a silhouette. An intersection of two faces is no edge of either: it gets no
//! gradient. The gradient is that of this image; from that of the true area coverage it differs
//! in first order of the pixel size.
//!
//! # Source
//! Laine et al., *Modular primitives for high-performance differentiable rendering*, ACM TOG 39(6),
//! 2020, section 3.5.

mod dense;
mod discontinuity;
mod pairs;
mod sorting;

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::parallel::{for_each_zipped_mut, is_shared, join, merge_each};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar};

pub use self::dense::antialias_image;
use self::discontinuity::{Blend, Outline};
use self::pairs::Pair;
use self::sorting::Sorting;
use crate::background::Kind;
use crate::coverage::Coverage;
use crate::dispatch::dispatch_256;
use crate::edge_functions::depth_at;
use crate::error::RenderError;
use crate::face_sums::add_term;
use crate::picture::{Composite, Picture};
use crate::runs::Run;
use crate::scratch::Workbench;
use crate::size::Size;

/// The picture with the silhouettes of its faces antialiased, for pictures of one fragment per pixel,
/// as [`rasterize`](crate::rasterize()) gives them unless it is asked for exact coverage.
///
/// Uncovered pixels beside a silhouette become part of the picture. The cost is that of the pixels
/// along silhouettes, and of a copy of the values; where no silhouette is in sight there is none.
///
/// # Errors
/// [`RenderError::ExactCoverage`] for fragments with exact coverage; [`RenderError::NoOrientations`] for coverage of ids
/// alone.
#[inline(never)]
pub fn antialias<'t, T: Scalar>(
    composite: Composite<'t, T>,
) -> Result<Picture<'t, T>, RenderError> {
    let Composite(picture) = composite;
    let Picture { values, backdrop, clip, coverage, .. } = &picture;
    coverage.check_silhouettes("antialias")?;
    let op = Antialias { coverage: Arc::clone(coverage), kind: backdrop.kind };
    let inputs = [*clip, *values, backdrop.values];
    let (outputs, rim) =
        values.tape().record_with(op, &inputs, |saved: &SavedBlends<T>| saved.rim.clone())?;
    Ok(Picture { values: outputs[0], rim, ..picture })
}

/// Inputs: clip `[V, 4]`, values `[N, C]`, a background `[C]` or `[H, W, C]`. Output: values `[P, C]`
/// of the fragments and the rim.
struct Antialias {
    coverage: Arc<Coverage>,
    kind: Kind,
}

/// The blends, and memory.
#[derive(Debug, Default)]
struct SavedBlends<T: Scalar> {
    blends: Vec<Blend<T::Wide>>,
    /// Per blend: the rows of its two pixels in the output.
    rows: Vec<[u32; 2]>,
    /// Per blend and channel: `c_1 - c_0`, or where shares were divided, what stands in its place.
    steps: Vec<T>,
    /// The blends at pixels with several of them, pixel by pixel.
    joint: Vec<Joint<T::Wide>>,
    /// Memory: per pixel of these and channel, the range of what is blended there.
    ranges: Vec<[T; 2]>,
    /// Memory: per row of the output that is blended, the sum of the shares.
    sums: Vec<T::Wide>,
    /// The uncovered pixels of all blends, in order.
    rim: Option<Arc<Vec<u32>>>,
    /// Memory: per 64 pixels a bit for each pixel of the rim, and how many of them come before.
    marks: Vec<(u64, u32)>,
    /// Memory: per blend and channel, alpha times what is upstream of the blended pixel.
    shares: Vec<T>,
    /// Memory: per blend the gradients of its edge's vertices.
    bars: Vec<EdgeBars<T>>,
    /// Memory: what is found at all silhouettes, and at those of a band.
    found: Vec<Found<T::Wide>>,
    lists: Workbench<Vec<Found<T::Wide>>>,
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

/// A blend, and what it is found with.
#[derive(Debug, Clone, Copy)]
struct Found<S> {
    /// What the order of blends is by: first this, see [`Silhouettes::seen`], then the column.
    line: u32,
    column: u32,
    blend: Blend<S>,
    /// The fragments of its two pixels.
    fragments: [u32; 2],
}

/// The gradients with respect to clip (x, y, w) of an edge's two vertices.
type EdgeBars<T> = [[T; 3]; 2];

/// Blends in one piece of work: some microseconds.
const BLENDS_PER_PIECE: usize = 1 << 5;

/// From so many blends on they are shared by several threads.
const BLENDS_TO_SHARE: usize = 1 << 6;

/// From so many blends on one thread divides shares while another copies values.
const BLENDS_TO_DIVIDE: usize = 1 << 12;

/// The lines of blends in a row of the image.
const LINES: usize = 3;

/// The row of an uncovered pixel, as long as not all of them are known.
const MISSING: u32 = u32::MAX;

impl<T: Scalar> SavedBlends<T> {
    /// Finds all blends, row by row, and the fragments of their pixels.
    fn find(&mut self, coverage: &Coverage, clip: &[T]) {
        let Self { blends, rows, found, lists, order, .. } = self;
        let (view, centers) = (Silhouettes { coverage, clip }, &coverage.centers);
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
            view.find(0..centers.slots.len(), found);
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

    /// Finds the rim, and the rows of the blends' pixels.
    fn find_rows(&mut self, coverage: &Coverage) {
        let Self { blends, rows, rim, marks, .. } = self;
        if rim.as_mut().and_then(Arc::get_mut).is_none() {
            *rim = None;
        }
        let rim = Arc::get_mut(rim.get_or_insert_default()).expect("nobody else holds it");
        rim.clear();
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
            *before = rim.len() as u32;
            let mut rest = *bits;
            while rest != 0 {
                rim.push(64 * word as u32 + rest.trailing_zeros());
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
    fn divide_and_copy(&mut self, values: &mut [T], input: &[T]) {
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
    fn add_clip_bars(
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

    /// Adds the gradient of the background behind the rim, whose k-th pixel has its entries from
    /// `start_of(k)` on. The first `covered` entries of `out_bar` are those of fragments.
    fn add_background_bars(
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
                let Some(rim_entry) = entry.checked_sub(covered) else { continue };
                let start = start_of(rim_entry / channels);
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
                            *bars = blend
                                .pull_back(alpha_bar, clip, size)
                                .map(|bar| bar.map(T::narrow));
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
    fn pull_back_values(
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
    fn blend(&mut self, out: &mut [T], channels: usize) {
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
    fn bytes(&self) -> usize {
        size_of_val(self.blends.as_slice())
            + size_of_val(self.rows.as_slice())
            + size_of_val(self.steps.as_slice())
            + size_of_val(self.joint.as_slice())
            + size_of_val(self.found.as_slice())
            + self.lists.bytes()
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

/// Runs `work` with a number of channels, which the compiler knows where it is the usual one.
#[inline(always)]
fn with_channels(channels: usize, mut work: impl FnMut(usize)) {
    if channels == 3 { work(3) } else { work(channels) }
}

/// What is drawn.
struct Silhouettes<'a, T: Scalar> {
    coverage: &'a Coverage,
    clip: &'a [T],
}

impl<T: Scalar> Silhouettes<'_, T> {
    /// Finds the blends by the faces of some slots.
    fn find(&self, slots: Range<usize>, found: &mut Vec<Found<T::Wide>>) {
        dispatch_256::<T, _>(
            #[inline(always)]
            || {
                for slot in slots {
                    let face = self.coverage.centers.face(slot);
                    let silhouettes = self.coverage.silhouettes_of(face);
                    if silhouettes != 0 {
                        self.find_by_face(slot, face, silhouettes, found);
                    }
                }
            },
        );
    }

    /// Finds the blends by a face with silhouettes.
    #[inline(always)]
    fn find_by_face(
        &self,
        slot: usize,
        face: usize,
        silhouettes: u8,
        found: &mut Vec<Found<T::Wide>>,
    ) {
        let size = self.coverage.size();
        let indices = self.coverage.mesh().faces()[face];
        let outline = Outline::new(self.clip, indices, silhouettes, size);
        let runs = self.coverage.centers.in_slot(slot);
        outline.for_each_line(
            size,
            #[inline(always)]
            |corner, line| {
                for run in runs {
                    let [row, column] = size.row_and_column(run.pixel as usize);
                    let first = column as u32;
                    line.for_each_pair(
                        row as u32,
                        first..first + run.length,
                        size,
                        #[inline(always)]
                        |pair| {
                            if let Some(blend) = outline.blend(corner, &pair, size) {
                                let fragment = run.fragment + pair.covered_pixel()[1] - first;
                                found.extend(self.seen(&outline, face, fragment, pair, blend));
                            }
                        },
                    );
                }
            },
        );
    }

    /// A blend by a face at a pair, if the other pixel sees no other face, or a farther one. Of faces
    /// that are as near the blend is by the first pixel's.
    #[inline(always)]
    fn seen(
        &self,
        outline: &Outline<T::Wide>,
        face: usize,
        fragment: u32,
        pair: Pair,
        blend: Blend<T::Wide>,
    ) -> Option<Found<T::Wide>> {
        let (coverage, size) = (self.coverage, self.coverage.size());
        let [row, column] = pair.other_pixel();
        let mut other_fragment = MISSING;
        let mut is_outlined = false;
        if let Some(run) = coverage.run_in_row(row as usize, column) {
            let other = coverage.centers.face_of(run);
            if other == face {
                return None;
            }
            let indices = coverage.mesh().faces()[other];
            let vertices = Outline::corners(self.clip, indices, size);
            let own_depth = depth_at(&outline.vertices, pair.covered_pixel(), size);
            let other_depth = depth_at(&vertices, pair.other_pixel(), size);
            let (is_nearer, is_farther) = (own_depth < other_depth, other_depth < own_depth);
            let is_behind = if pair.covers_first { is_farther } else { !is_nearer };
            if is_behind {
                return None;
            }
            let Run { pixel, fragment, .. } = *run;
            other_fragment = fragment + (row * size.width as u32 + column - pixel);
            is_outlined = coverage.silhouettes_of(other) != 0;
        }
        // Row by row from the top: pairs beside each other, then those whose upper pixel sees a face with
        // silhouettes, then the others.
        let kind = match pair.below {
            false => 0,
            true if pair.covers_first || is_outlined => 1,
            true => 2,
        };
        let (line, column) = (LINES as u32 * pair.row + kind, pair.column);
        let fragments = [fragment, other_fragment];
        let fragments = if pair.covers_first { fragments } else { [other_fragment, fragment] };
        Some(Found { line, column, blend, fragments })
    }
}

impl<T: Scalar> Op<T> for Antialias {
    type Saved = SavedBlends<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        "antialias"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let coverage = &*self.coverage;
        saved.find(coverage, inputs.data(0));
        if saved.blends.is_empty() {
            saved.rim = None;
            outputs.pass(1, "no discontinuities");
            return Ok(());
        }
        saved.find_rows(coverage);
        let (input, background) = (inputs.data(1), inputs.data(2));
        let channels = inputs.shape(1)[1];
        let rim = saved.rim.clone().expect("it was just found");
        let out = outputs.push([coverage.count() + rim.len(), channels]);
        let (values, rim_values) = out.split_at_mut(input.len());
        saved.divide_and_copy(values, input);
        for (value, &pixel) in rim_values.chunks_exact_mut(channels).zip(&*rim) {
            self.kind.fill(value, background, channels, pixel as usize);
        }
        saved.blend(out, channels);
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input_if(0, inputs.needs(0)).upstream()
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let taken = gradients.take_upstream();
        let out_bar = taken.as_deref().unwrap_or_else(|| kept.only_upstream());
        let channels = kept.input_shape(1)[1];
        let covered = self.coverage.count() * channels;
        if let Some(clip_bar) = gradients.get(0) {
            let (clip, size) = (kept.input(0), self.coverage.size());
            saved.add_clip_bars(out_bar, channels, (clip, size), clip_bar.entries());
        }
        if let (Some(rim), Some(background_bar)) = (&saved.rim, gradients.get(2)) {
            let start_of = |k: usize| self.kind.entry(channels, rim[k] as usize);
            saved.add_background_bars(
                out_bar,
                [covered, channels],
                start_of,
                background_bar.entries(),
            );
        }
        saved.pull_back_values(taken, channels, covered, kept, gradients);
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        saved.bytes() + saved.rim.as_ref().map_or(0, |rim| size_of_val(rim.as_slice()))
    }
}
