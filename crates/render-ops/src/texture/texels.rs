//! The gradients of texels: the adjoint of samples at scattered places.
//!
//! # Backward
//! A probe with share p in its sample adds to the four texels of its cell, on one or two levels:
//! `t_bar += p (1 - |lambda - l|) w s_bar` on level l, with the bilinear weight w of the texel.
//!
//! Two samples may add to the same texel. So a tile's terms are summed in wide numbers, in the order of
//! the samples, and then added to the level. The sums are the same for any number of threads. A tile
//! with many probes is summed in parts.
//!
//! A tile's sums hold a row and a column of texels more than it has cells, which belong to the next
//! tiles as well. Rows of tiles are therefore added in two rounds, the even rows first. What lies beyond
//! the border of a face is added last, to the texels that stand for it.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::{for_each_item_mut, is_shared, merge_ranges_into};

use super::cells::Cells;
use super::chart::Chart;
use super::lanes::{LANES, Lanes};
use super::lookup::{Lookup, Probes};
use super::tiles::{Runs, Tiles};
use crate::dispatch::dispatch_special;

/// A part has at least so many probes.
const PROBES_PER_PART: usize = 1 << 14;

/// Upstream gradients of samples, and the level of a texture that they are to be added to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Terms<'a, T, C, const K: usize> {
    pub(super) lookup: Lookup<'a, T, C, K>,
    pub(super) level: usize,
    pub(super) bars: &'a [T],
    pub(super) channels: usize,
}

/// Memory for the sums, and the probes by tile.
#[derive(Debug)]
pub(super) struct TexelSums<T: Scalar> {
    pub(super) runs: Runs,
    parts: Vec<Part>,
    sums_of_parts: Vec<Vec<T::Wide>>,
    rows: Vec<Row<T>>,
}

/// Some of a tile's probes: those in some of the pieces that touch it.
#[derive(Debug)]
struct Part {
    tile: usize,
    pieces: Range<usize>,
}

/// A row of tiles.
#[derive(Debug)]
struct Row<T: Scalar> {
    /// A tile's sums.
    sums: Vec<T::Wide>,
    /// Face, row and column of what lies beyond the border, and where its sums are in `beyond_sums`.
    beyond: Vec<(usize, [isize; 2])>,
    beyond_sums: Vec<T>,
}

impl<T: Scalar> Default for Row<T> {
    fn default() -> Self {
        Self { sums: Vec::new(), beyond: Vec::new(), beyond_sums: Vec::new() }
    }
}

impl<T: Scalar> Default for TexelSums<T> {
    fn default() -> Self {
        Self {
            runs: Runs::default(),
            parts: Vec::new(),
            sums_of_parts: Vec::new(),
            rows: Vec::new(),
        }
    }
}

/// The weights of a block of probes in the texels of their cells, which are in the order of rows.
struct Weights<S> {
    by_corner: [Lanes<S>; 4],
    /// Where the first texel is among the texels of a tile's sums.
    first_texels: Lanes<u32>,
    count: usize,
}

impl<S: Scalar<Wide = S>> Weights<S> {
    fn new() -> Self {
        Self { by_corner: [[S::ZERO; LANES]; 4], first_texels: [0; LANES], count: 0 }
    }

    /// Finds the weights of probes on a level.
    #[inline(always)]
    fn find<T: Scalar<Wide = S>, const K: usize>(
        &mut self,
        probes: &Probes<T, K>,
        cells: &Cells<T>,
        level: usize,
        origin: [i32; 2],
        texels: usize,
    ) {
        let level = T::from_f64(level as f64);
        self.count = probes.count.min(LANES);
        for i in 0..self.count {
            let [f, g] = cells.fractions_of(i);
            let weight = probes.shares[i] * (T::ONE - (probes.levels[i] - level).abs());
            // By differences, so that all of the weight is given away.
            let lower = weight * g;
            let upper = weight - lower;
            let rights = [upper * f, lower * f];
            self.by_corner[0][i] = (upper - rights[0]).widen();
            self.by_corner[1][i] = rights[0].widen();
            self.by_corner[2][i] = (lower - rights[1]).widen();
            self.by_corner[3][i] = rights[1].widen();
            let [row, column] = [0, 1].map(|k| (cells.corners[k][i] - origin[k]) as u32);
            self.first_texels[i] = row * texels as u32 + column;
        }
    }

    /// Adds the gradients `bars` of samples, of `groups` of `N` channels, to `sums` with `texels` along
    /// a side and `width` numbers in a texel.
    ///
    /// The compiler must not know that texels side by side are so in memory, too: as a single vector they
    /// would straddle what the sample before has stored, and wait for it.
    #[inline(always)]
    fn add<T: Scalar<Wide = S>, const N: usize, const L: usize>(
        &self,
        samples: &Lanes<usize>,
        bars: &[T],
        groups: usize,
        [texels, width]: [usize; 2],
        sums: &mut [S],
    ) {
        // The last sample of all may have no `L` numbers.
        let mut last = [T::ZERO; L];
        for i in 0..self.count.min(LANES) {
            let bars = &bars[samples[i] * groups * N..];
            let (upper, lower) =
                sums[self.first_texels[i] as usize * width..].split_at_mut(texels * width);
            let (upper_left, upper_right) = upper[..2 * width].split_at_mut(width);
            let (lower_left, lower_right) = lower[..2 * width].split_at_mut(width);
            for group in 0..groups {
                let bars = &bars[group * N..];
                let bars: &[T; L] = match bars.first_chunk() {
                    Some(bars) => bars,
                    None => {
                        last[..N].copy_from_slice(&bars[..N]);
                        &last
                    }
                };
                let mut wide = [S::ZERO; L];
                for k in 0..L {
                    wide[k] = bars[k].widen();
                }
                let entries = group * L..(group + 1) * L;
                add_share(&mut upper_left[entries.clone()], self.by_corner[0][i], wide);
                add_share(&mut upper_right[entries.clone()], self.by_corner[1][i], wide);
                add_share(&mut lower_left[entries.clone()], self.by_corner[2][i], wide);
                add_share(&mut lower_right[entries], self.by_corner[3][i], wide);
            }
        }
    }
}

impl<T: Scalar> TexelSums<T> {
    /// Sums some of a tile's terms into `sums`: groups of `N` channels, in `L` numbers each.
    fn sum<C: Chart<K>, const K: usize, const N: usize, const L: usize>(
        &self,
        terms: &Terms<'_, T, C, K>,
        tile: usize,
        pieces: Range<usize>,
        sums: &mut Vec<T::Wide>,
    ) {
        let tiles = self.runs.tiles(terms.level);
        let (texels, width) = (tiles.texels(), tiles.width);
        sums.clear();
        sums.resize(texels * texels * width, T::Wide::ZERO);
        dispatch_special::<T, _, _>(
            (pieces, sums.as_mut_slice()),
            #[inline(always)]
            |(pieces, sums)| self.sum_pieces::<C, K, N, L>(terms, tile, pieces, sums),
            |(pieces, sums)| self.sum_by_channel(terms, tile, pieces, sums),
        );
    }

    /// Sums channel by channel. Numbers lie where they lie in groups: only a last group of three has a number more.
    #[inline(never)]
    fn sum_by_channel<C: Chart<K>, const K: usize>(
        &self,
        terms: &Terms<'_, T, C, K>,
        tile: usize,
        pieces: Range<usize>,
        sums: &mut [T::Wide],
    ) {
        self.sum_pieces::<C, K, 1, 1>(terms, tile, pieces, sums);
    }

    #[inline(always)]
    fn sum_pieces<C: Chart<K>, const K: usize, const N: usize, const L: usize>(
        &self,
        terms: &Terms<'_, T, C, K>,
        tile: usize,
        pieces: Range<usize>,
        sums: &mut [T::Wide],
    ) {
        let &Terms { lookup, level, bars, channels } = terms;
        let tiles = self.runs.tiles(level);
        let (texels, width) = (tiles.texels(), tiles.width);
        let mut runs = self.runs.runs(pieces).peekable();
        let (mut probes, mut cells) = (Probes::new(), Cells::new());
        let (mut weights, origin) = (Weights::new(), tiles.origin(tile));
        while runs.peek().is_some() {
            probes.count = 0;
            while let Some((first, count)) =
                runs.next_if(|(_, count)| probes.count + count <= LANES)
            {
                lookup.add(&mut probes, first, usize::MAX, count);
            }
            lookup.settle(&mut probes);
            let extents = &lookup.extents[level];
            cells.find(&probes.places, 0..probes.count, extents, lookup.rounding());
            weights.find(&probes, &cells, level, origin, texels);
            let (samples, shape) = (&probes.samples, [texels, width]);
            match channels / N {
                // Known beforehand, it costs nothing.
                1 => weights.add::<T, N, L>(samples, bars, 1, shape, sums),
                groups => weights.add::<T, N, L>(samples, bars, groups, shape, sums),
            }
        }
    }

    /// Adds the terms of a level to its gradient, `[faces, rows, columns, channels]`.
    pub(super) fn add_level<C: Chart<K>, const K: usize>(
        &mut self,
        terms: &Terms<'_, T, C, K>,
        gradient: &mut [T],
    ) {
        match terms.channels {
            3 => self.add::<C, K, 3, 4>(terms, gradient),
            channels if channels % 4 == 0 => self.add::<C, K, 4, 4>(terms, gradient),
            _ => self.add::<C, K, 1, 1>(terms, gradient),
        }
    }

    fn add<C: Chart<K>, const K: usize, const N: usize, const L: usize>(
        &mut self,
        terms: &Terms<'_, T, C, K>,
        gradient: &mut [T],
    ) {
        let (tiles, channels) = (self.runs.tiles(terms.level), terms.channels);
        self.sum_parts::<C, K, N, L>(terms);
        let mut rows = std::mem::take(&mut self.rows);
        rows.resize_with(tiles.rows().max(rows.len()), Row::default);
        let this = &*self;
        let line = tiles.extents[1] * channels;
        // Rows of tiles overlap by a row of texels. So even rows are added first, at the same time, and then
        // odd ones: no two at work share a texel, and the order of sums is fixed.
        for round in 0..2 {
            let (mut rest, mut start) = (&mut *gradient, 0);
            let work = rows[..tiles.rows()].iter_mut().enumerate().filter_map(|(k, row)| {
                let (face, of_face) = (k / tiles.counts[0], k % tiles.counts[0]);
                if of_face % 2 != round {
                    return None;
                }
                let texels = tiles.texel_rows(of_face);
                let [first, end] = [texels.start, texels.end]
                    .map(|texel| (face * tiles.extents[0] + texel) * line);
                let (_, from) = std::mem::take(&mut rest).split_at_mut(first - start);
                let (lines, others) = from.split_at_mut(end.max(first) - first);
                (rest, start) = (others, end.max(first));
                Some((k, row, lines))
            });
            let add = |k: usize, row: &mut Row<T>, lines: &mut [T]| {
                this.add_row::<C, K, N, L>(terms, k, row, lines);
            };
            if is_shared(tiles.rows().div_ceil(2), 1) {
                let mut work: Vec<_> = work.collect();
                for_each_item_mut(&mut work, |_, (k, row, lines)| add(*k, row, lines));
            } else {
                work.for_each(|(k, row, lines)| add(k, row, lines));
            }
        }
        for row in &rows[..tiles.rows()] {
            for (&(face, position), sums) in
                row.beyond.iter().zip(row.beyond_sums.chunks_exact(channels))
            {
                let texels = terms.lookup.chart.beyond(tiles.extents, face, position);
                for &[face, row, column] in texels.iter() {
                    let texel = (face * tiles.extents[0] + row) * tiles.extents[1] + column;
                    let entries = &mut gradient[texel * channels..][..channels];
                    for (entry, &sum) in entries.iter_mut().zip(sums) {
                        *entry += match texels.count {
                            1 => sum,
                            count => sum / T::from_f64(count as f64),
                        };
                    }
                }
            }
        }
        self.rows = rows;
    }

    /// Sums the parts of tiles with many probes.
    fn sum_parts<C: Chart<K>, const K: usize, const N: usize, const L: usize>(
        &mut self,
        terms: &Terms<'_, T, C, K>,
    ) {
        let tiles = self.runs.tiles(terms.level);
        let mut parts = std::mem::take(&mut self.parts);
        let mut sums_of_parts = std::mem::take(&mut self.sums_of_parts);
        parts.clear();
        for tile in tiles.first..tiles.first + tiles.count() {
            let (before, pieces) = (parts.len(), self.runs.pieces_of(tile));
            let (mut start, mut probes) = (pieces.start, 0);
            for piece in pieces.clone() {
                probes += self.runs.probes_of(piece);
                if probes >= PROBES_PER_PART || piece + 1 == pieces.end {
                    parts.push(Part { tile, pieces: start..piece + 1 });
                    (start, probes) = (piece + 1, 0);
                }
            }
            // A tile of a single part is summed where it is added.
            if parts.len() == before + 1 {
                parts.pop();
            }
        }
        let this = &*self;
        let work = |range: Range<usize>, sums: &mut Vec<T::Wide>| {
            let Part { tile, pieces } = &parts[range.start];
            this.sum::<C, K, N, L>(terms, *tile, pieces.clone(), sums);
        };
        merge_ranges_into(&mut sums_of_parts, parts.len(), 1, work, |_| {});
        (self.parts, self.sums_of_parts) = (parts, sums_of_parts);
    }

    /// Adds the terms of a row of tiles to `lines`, the texels' rows that it adds to.
    fn add_row<C: Chart<K>, const K: usize, const N: usize, const L: usize>(
        &self,
        terms: &Terms<'_, T, C, K>,
        k: usize,
        row: &mut Row<T>,
        lines: &mut [T],
    ) {
        let tiles = self.runs.tiles(terms.level);
        row.beyond.clear();
        row.beyond_sums.clear();
        for column in 0..tiles.counts[1] {
            let tile = tiles.first + k * tiles.counts[1] + column;
            let pieces = self.runs.pieces_of(tile);
            if pieces.is_empty() {
                continue;
            }
            let first = self.parts.partition_point(|part| part.tile < tile);
            let mut parts =
                (first..self.parts.len()).take_while(|&part| self.parts[part].tile == tile);
            match parts.next() {
                None => self.sum::<C, K, N, L>(terms, tile, pieces, &mut row.sums),
                Some(part) => {
                    row.sums.clone_from(&self.sums_of_parts[part]);
                    for part in parts {
                        let sums = row.sums.iter_mut().zip(&self.sums_of_parts[part]);
                        sums.for_each(|(sum, &part)| *sum += part);
                    }
                }
            }
            add_sums::<T, N, L>(&tiles, tile, terms.channels, row, lines);
        }
    }

    /// The bytes that it holds, for reports.
    pub(super) fn bytes(&self) -> usize {
        let sums = self.rows.iter().map(|row| &row.sums).chain(&self.sums_of_parts);
        self.runs.bytes() + sums.map(|sums| size_of_val(sums.as_slice())).sum::<usize>()
    }
}

/// `sums += weight bars`.
#[inline(always)]
fn add_share<S: Scalar, const L: usize>(sums: &mut [S], weight: S, bars: [S; L]) {
    if let Some(sums) = sums.first_chunk_mut::<L>() {
        for k in 0..L {
            sums[k] += weight * bars[k];
        }
    }
}

/// Adds a tile's sums to `lines`, the rows of texels that its row of tiles adds to, and keeps those
/// beyond the border.
fn add_sums<T: Scalar, const N: usize, const L: usize>(
    tiles: &Tiles,
    tile: usize,
    channels: usize,
    row: &mut Row<T>,
    lines: &mut [T],
) {
    let Row { sums, beyond, beyond_sums } = row;
    let (texels, width) = (tiles.texels(), tiles.width);
    let (rows_of_face, columns) = (tiles.counts[0], tiles.counts[1]);
    let row_of_tiles = (tile - tiles.first) / columns;
    let (face, of_face) = (row_of_tiles / rows_of_face, row_of_tiles % rows_of_face);
    let first_line = tiles.texel_rows(of_face).start as isize;
    let origin = tiles.origin(tile).map(|start| start as isize);
    let [last_row, last_column] = tiles.extents.map(|extent| extent as isize - 1);
    // The columns of the tile's sums that lie on the face.
    let left = (-origin[1]).max(0) as usize;
    let right = (last_column - origin[1] + 1).clamp(0, texels as isize) as usize;
    for (i, sums) in sums.chunks_exact(texels * width).enumerate() {
        let line = origin[0] + i as isize;
        let is_on_face = (0..=last_row).contains(&line);
        if is_on_face && left < right {
            let start = (line - first_line) as usize * tiles.extents[1] * channels;
            let start = start + (origin[1] + left as isize) as usize * channels;
            let entries = &mut lines[start..][..(right - left) * channels];
            let entries = entries.as_chunks_mut::<N>().0;
            let sums = sums[left * width..right * width].as_chunks::<L>().0;
            for (entries, sums) in entries.iter_mut().zip(sums) {
                for k in 0..N {
                    entries[k] += T::narrow(sums[k]);
                }
            }
        }
        let others = if is_on_face { [0..left, right..texels] } else { [0..texels, 0..0] };
        for j in others.into_iter().flatten() {
            let sums = &sums[j * width..][..width];
            let sums = sums.as_chunks::<L>().0.iter().flat_map(|sums| &sums[..N]);
            if sums.clone().all(|sum| sum.is_same(T::Wide::ZERO)) {
                continue;
            }
            beyond.push((face, [line, origin[1] + j as isize]));
            beyond_sums.extend(sums.map(|&sum| T::narrow(sum)));
        }
    }
}
