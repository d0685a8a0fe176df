//! What samples are: the texels of cells, mixed, and how that changes.
//!
//! Channels are taken in groups of `N`, which are read as `L` numbers: three channels as four numbers,
//! the last of which is another texel's. Nobody looks at it, but four numbers are one vector.

use std::ops::Range;

use bokashi_core::Scalar;

use super::cells::{Cells, Extents};
use super::chart::Chart;
use super::lanes::{LANES, Lanes};
use super::lookup::{Lookup, Probe, Probes, Segment};

/// The texels of a level.
#[derive(Debug, Clone, Copy)]
pub(super) struct Level<'a, T> {
    /// `[faces, rows, columns, channels]`.
    pub(super) texels: &'a [T],
    pub(super) channels: usize,
    pub(super) extents: Extents<T>,
    /// The numbers of a row.
    line: usize,
}

impl<'a, T: Scalar> Level<'a, T> {
    pub(super) fn new(texels: &'a [T], channels: usize, extents: Extents<T>) -> Self {
        Self { texels, channels, extents, line: extents.counts[1] * channels }
    }
}

/// `a + share (b - a)`, number by number: what is the same in both comes out exactly.
#[inline(always)]
fn mix<T: Scalar, const L: usize>(a: [T; L], b: [T; L], share: T) -> [T; L] {
    let mut mixed = a;
    for k in 0..L {
        mixed[k] = a[k] + share * (b[k] - a[k]);
    }
    mixed
}

/// `b - a`, number by number.
#[inline(always)]
fn from_to<T: Scalar, const L: usize>(a: [T; L], b: [T; L]) -> [T; L] {
    let mut change = b;
    for k in 0..L {
        change[k] = b[k] - a[k];
    }
    change
}

/// `L` numbers of a texel and of the next one, where there are as many, of textures of `channels`.
#[inline(always)]
fn pair<T: Scalar, const N: usize, const L: usize>(
    texels: &[T],
    channels: usize,
) -> Option<[&[T; L]; 2]> {
    if channels == N {
        // Looked up once.
        let both = texels.get(..N + L)?;
        return Some([both.first_chunk()?, both[N..].first_chunk()?]);
    }
    Some([texels.first_chunk()?, texels.get(channels..)?.first_chunk()?])
}

/// The four texels of a cell, a group of channels: the upper left and right, the lower left and right.
/// Where they lie side by side in memory, they are not moved.
type Corners<'a, T, const L: usize> = [&'a [T; L]; 4];

impl<'a, T: Scalar> Level<'a, T> {
    /// The texels of cell `i` on a face, from channel `channel` on; in `spare` unless all four are on
    /// the face.
    #[inline(always)]
    fn corners<const K: usize, const N: usize, const L: usize>(
        &'a self,
        chart: impl Chart<K>,
        (face, cells, i): (u8, &Cells<T>, usize),
        channel: usize,
        spare: &'a mut [[T; L]; 4],
    ) -> Corners<'a, T, L> {
        let start = cells.texels[i] as usize * self.channels + channel;
        // The last texel of all may have no `L` numbers.
        if let Some(upper) = self.texels.get(start..)
            && let Some(lower) = upper.get(self.line..)
            && let Some([c, d]) = pair::<T, N, L>(lower, self.channels)
            && let Some([a, b]) = pair::<T, N, L>(upper, self.channels)
        {
            return [a, b, c, d];
        }
        let corner = [cells.corners[0][i], cells.corners[1][i]];
        *spare = self.corners_beyond::<K, N, L>(chart, face as usize, corner, channel);
        spare.each_ref()
    }

    #[cold]
    #[inline(never)]
    fn corners_beyond<const K: usize, const N: usize, const L: usize>(
        &self,
        chart: impl Chart<K>,
        face: usize,
        [row, column]: [i32; 2],
        channel: usize,
    ) -> [[T; L]; 4] {
        let ([row, column], extents) = ([row as isize, column as isize], self.extents.counts);
        [[row, column], [row, column + 1], [row + 1, column], [row + 1, column + 1]].map(|corner| {
            let beyond = chart.beyond(extents, face, corner);
            let mut sum = [T::ZERO; L];
            for &[face, row, column] in beyond.iter() {
                let texel = (face * extents[0] + row) * extents[1] + column;
                let texel = &self.texels[texel * self.channels + channel..][..N];
                sum.iter_mut().zip(texel).for_each(|(sum, &texel)| *sum += texel);
            }
            // Beyond a cube's corner three texels stand for a fourth; beyond a border of zeros there is none.
            match beyond.count {
                0 | 1 => sum,
                count => sum.map(|sum| sum / T::from_f64(count as f64)),
            }
        })
    }
}

/// The bilinear sample of corners.
#[inline(always)]
fn sample<T: Scalar, const L: usize>([a, b, c, d]: Corners<'_, T, L>, [f, g]: [T; 2]) -> [T; L] {
    mix(mix(*a, *b, f), mix(*c, *d, f), g)
}

/// How a bilinear sample changes to the right and down.
#[inline(always)]
fn slopes<T: Scalar, const L: usize>(
    [a, b, c, d]: Corners<'_, T, L>,
    [f, g]: [T; 2],
) -> [[T; L]; 2] {
    [mix(from_to(*a, *b), from_to(*c, *d), g), mix(from_to(*a, *c), from_to(*b, *d), f)]
}

impl<T: Scalar> Level<'_, T> {
    /// Changes from texel to texel, as changes along the axes of a face.
    #[inline(always)]
    fn along_face<const L: usize>(self, mut changes: [[T; L]; 2]) -> [[T; L]; 2] {
        for k in 0..2 {
            for change in &mut changes[k] {
                *change = self.extents.scale[k] * *change;
            }
        }
        changes
    }
}

/// `a . b` over the first `N` channels.
#[inline(always)]
fn dot<T: Scalar, const L: usize, const N: usize>(a: &[T; L], b: &[T; N]) -> T {
    let mut sum = a[0] * b[0];
    for k in 1..N {
        sum += a[k] * b[k];
    }
    sum
}

/// The gradients that probes give to their places and to their levels.
#[derive(Debug)]
pub(super) struct Moves<T> {
    pub(super) positions: [Lanes<T>; 2],
    pub(super) levels: Lanes<T>,
}

impl<T: Scalar> Moves<T> {
    pub(super) fn new() -> Self {
        Self { positions: [[T::ZERO; LANES]; 2], levels: [T::ZERO; LANES] }
    }

    #[inline(always)]
    fn clear(&mut self) {
        *self = Self::new();
    }
}

/// Samples of levels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Values<'a, T, C, const K: usize> {
    pub(super) lookup: Lookup<'a, T, C, K>,
    pub(super) levels: &'a [Level<'a, T>],
}

/// The cells of a block of probes on two neighbouring levels, the finer level first.
type TwoCells<T> = [Cells<T>; 2];

/// A segment of a block of probes, with its cells; on the coarser level where it counts.
struct Part<'a, T, C, const K: usize> {
    chart: C,
    probes: &'a Probes<T, K>,
    segment: Segment,
    levels: [Level<'a, T>; 2],
    cells: &'a TwoCells<T>,
}

impl<T: Scalar, C: Chart<K>, const K: usize> Part<'_, T, C, K> {
    /// The channels that begin groups of `N`.
    #[inline(always)]
    fn groups<const N: usize>(&self) -> impl Iterator<Item = usize> + use<T, C, K, N> {
        (0..self.levels[0].channels / N).map(|group| group * N)
    }

    /// The corners of the cell of probe `i`, and where it lies among them, on the finer level or the
    /// coarser.
    #[inline(always)]
    fn corners<'a, const N: usize, const L: usize>(
        &'a self,
        coarser: usize,
        i: usize,
        channel: usize,
        spare: &'a mut [[T; L]; 4],
    ) -> (Corners<'a, T, L>, [T; 2]) {
        let (level, cells) = (&self.levels[coarser], &self.cells[coarser]);
        let cell = (self.probes.places.faces[i], cells, i);
        (level.corners::<K, N, L>(self.chart, cell, channel, spare), cells.fractions_of(i))
    }

    /// Finds the samples of its probes, in a group of channels.
    #[inline(always)]
    fn mix<const N: usize, const L: usize>(&self, channel: usize, samples: &mut Lanes<[T; L]>) {
        let mut spare = [[[T::ZERO; L]; 4]; 2];
        for i in self.segment.lanes.clone() {
            let [of_fine, of_coarse] = &mut spare;
            let (corners, fractions) = self.corners::<N, L>(0, i, channel, of_fine);
            let mut value = sample(corners, fractions);
            if self.segment.is_free {
                let (corners, fractions) = self.corners::<N, L>(1, i, channel, of_coarse);
                value = mix(value, sample(corners, fractions), self.probes.fractions[i]);
            }
            samples[i] = value;
        }
    }

    /// Finds how the samples of its probes change to the right, down and, `with_levels`, with the level.
    #[inline(always)]
    fn change<const N: usize, const L: usize>(
        &self,
        channel: usize,
        with_levels: bool,
        [right, down, coarser]: &mut [Lanes<[T; L]>; 3],
    ) {
        let mut spare = [[[T::ZERO; L]; 4]; 2];
        for i in self.segment.lanes.clone() {
            let [of_fine, of_coarse] = &mut spare;
            let (fine, fractions) = self.corners::<N, L>(0, i, channel, of_fine);
            let mut fine_slopes = self.levels[0].along_face(slopes(fine, fractions));
            if self.segment.is_free {
                let (coarse, fractions_coarse) = self.corners::<N, L>(1, i, channel, of_coarse);
                let others = self.levels[1].along_face(slopes(coarse, fractions_coarse));
                for k in 0..2 {
                    fine_slopes[k] = mix(fine_slopes[k], others[k], self.probes.fractions[i]);
                }
                if with_levels {
                    coarser[i] = from_to(sample(fine, fractions), sample(coarse, fractions_coarse));
                }
            }
            [right[i], down[i]] = fine_slopes;
        }
    }
}

impl<T: Scalar, C: Chart<K>, const K: usize> Values<'_, T, C, K> {
    /// The part of a block that begins with a lane.
    #[inline(always)]
    fn part<'a>(
        &'a self,
        probes: &'a Probes<T, K>,
        lane: usize,
        cells: &'a mut TwoCells<T>,
    ) -> Part<'a, T, C, K> {
        let segment = probes.segment(lane);
        let count = 1 + usize::from(segment.is_free);
        let levels = [0, count - 1].map(|k| self.levels[segment.level + k]);
        for k in 0..count {
            let (lanes, extents) = (segment.lanes.clone(), &levels[k].extents);
            cells[k].find(&probes.places, lanes.clone(), extents, self.lookup.rounding());
            cells[k].find_texels(&probes.places, lanes, extents);
        }
        Part { chart: self.lookup.chart, probes, segment, levels, cells }
    }

    /// Writes some samples.
    #[inline(always)]
    pub(super) fn write<const N: usize, const L: usize>(
        &self,
        samples: Range<usize>,
        out: &mut [T],
    ) {
        let (mut probes, mut cells) = (Probes::new(), [Cells::new(), Cells::new()]);
        let (mut next, start) = (Probe::first_of(samples.start), samples.start);
        let (mut values, channels) = ([[T::ZERO; L]; LANES], self.levels[0].channels);
        let are_sums = self.lookup.filter.probes() > 1;
        if are_sums {
            out.fill(T::ZERO);
        }
        while next.sample < samples.end {
            next = self.lookup.fill(&mut probes, next, samples.end);
            let mut lane = 0;
            while lane < probes.count {
                let part = self.part(&probes, lane, &mut cells);
                let lanes = part.segment.lanes.clone();
                lane = lanes.end;
                for channel in part.groups::<N>() {
                    part.mix::<N, L>(channel, &mut values);
                    // One probe per sample: neighbours in the block are neighbours in `out`.
                    if !are_sums {
                        let first = (probes.samples[lanes.start] - start) * channels + channel;
                        let out = out[first..].chunks_mut(channels);
                        for (out, value) in out.zip(&values[lanes.clone()]) {
                            out[..N].copy_from_slice(&value[..N]);
                        }
                        continue;
                    }
                    for i in lanes.clone() {
                        let first = (probes.samples[i] - start) * channels + channel;
                        for (out, value) in out[first..first + N].iter_mut().zip(values[i]) {
                            *out += probes.shares[i] * value;
                        }
                    }
                }
            }
        }
    }

    /// Calls `visit(probes, moves)` for all probes of some samples, block by block, with the gradients
    /// that they give; without those of levels unless `with_levels`.
    #[inline(always)]
    pub(super) fn pull_back<const N: usize, const L: usize>(
        &self,
        samples: Range<usize>,
        bars: &[T],
        with_levels: bool,
        mut visit: impl FnMut(&Probes<T, K>, &Moves<T>),
    ) {
        let (mut probes, mut cells) = (Probes::new(), [Cells::new(), Cells::new()]);
        let (mut next, mut moves) = (Probe::first_of(samples.start), Moves::new());
        let (mut changes, channels) = ([[[T::ZERO; L]; LANES]; 3], self.levels[0].channels);
        while next.sample < samples.end {
            next = self.lookup.fill(&mut probes, next, samples.end);
            moves.clear();
            let mut lane = 0;
            while lane < probes.count {
                let part = self.part(&probes, lane, &mut cells);
                lane = part.segment.lanes.end;
                for channel in part.groups::<N>() {
                    part.change::<N, L>(channel, with_levels, &mut changes);
                    for i in part.segment.lanes.clone() {
                        let bars = &bars[probes.samples[i] * channels + channel..];
                        let bars: &[T; N] = bars.first_chunk().expect("whole groups");
                        let share = probes.shares[i];
                        moves.positions[0][i] += share * dot(&changes[0][i], bars);
                        moves.positions[1][i] += share * dot(&changes[1][i], bars);
                        if with_levels && part.segment.is_free {
                            moves.levels[i] += share * dot(&changes[2][i], bars);
                        }
                    }
                }
            }
            visit(&probes, &moves);
        }
    }
}
