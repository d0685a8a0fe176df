//! The gradients of texels: the adjoint of samples at scattered places.
//!
//! Each sample adds to the four texels of a cell, on one or two levels, for each of its probes. Two
//! samples may add to the same texel, so the cells of a level are cut into square *tiles*. Samples are
//! sorted by tile, piece of samples by piece. A tile's terms are summed in wide numbers, in the order of
//! the samples, and then added to the level. So the sums are the same for any number of threads.
//!
//! A tile's sums hold a row and a column of texels more than it has cells, which belong to the next
//! tiles as well. Rows of tiles are therefore added in two rounds, the even rows first. What lies beyond
//! the border of a face is added last, to the texels that stand for it.

use bokashi_core::Scalar;
use bokashi_core::parallel::{for_each_item_mut, is_shared, merge_ranges_into};

use super::cell::Cell;
use super::chart::Chart;

/// Samples whose touches are sorted together: as many as leave three bits of 16 for a probe.
const SAMPLES_PER_PIECE: usize = 1 << 13;

/// Touches of a tile that are summed in one go; of a tile with more they are summed in parts.
const TOUCHES_PER_PART: usize = 1 << 14;

/// A level has at most so many tiles along an axis.
const MOST_TILES: usize = 64;

/// Cells along a tile's side at least, where a texel has a few channels and where it has many: the sums
/// of a tile shall stay in a processor's first cache.
const SIDES: [usize; 2] = [32, 12];

/// A texel of more channels has many.
const FEW_CHANNELS: usize = 4;

/// How the cells of a level are cut.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tiles {
    /// Rows and columns of texels.
    extents: [usize; 2],
    /// Cells along a tile's side.
    side: usize,
    /// Rows and columns of tiles of a face.
    counts: [usize; 2],
    /// The number of the first tile.
    first: usize,
    faces: usize,
}

impl Tiles {
    /// The tiles of all levels: each has such `extents` of texels of `channels`, on so many `faces`.
    pub(super) fn of_levels(
        tiles: &mut Vec<Self>,
        extents: impl Iterator<Item = [usize; 2]>,
        faces: usize,
        channels: usize,
    ) {
        tiles.clear();
        let mut first = 0;
        let least = SIDES[usize::from(channels > FEW_CHANNELS)];
        for extents in extents {
            // Cells start one texel before the border, and end with the last texel.
            let most = extents[0].max(extents[1]) + 1;
            let side = least.max(most.div_ceil(MOST_TILES));
            let counts = extents.map(|extent| (extent + 1).div_ceil(side));
            tiles.push(Self { extents, side, counts, first, faces });
            first += faces * counts[0] * counts[1];
        }
    }

    fn count(&self) -> usize {
        self.faces * self.counts[0] * self.counts[1]
    }

    /// The number of the tile of a cell.
    #[inline(always)]
    fn tile_of<T>(&self, cell: &Cell<T>) -> usize {
        let [row, column] = cell.at.map(|at| (at + 1) as usize / self.side);
        self.first + (cell.face * self.counts[0] + row) * self.counts[1] + column
    }

    /// Texels along a side of a tile's sums.
    fn texels(&self) -> usize {
        self.side + 1
    }

    /// The rows of texels of a face that row `row` of tiles adds to.
    fn texel_rows(&self, row: usize) -> std::ops::Range<usize> {
        let first = row * self.side;
        first.saturating_sub(1)..(first + self.side).min(self.extents[0])
    }
}

/// What a touch adds: bars times `weight`, spread over a cell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Touch<T> {
    pub(super) cell: Cell<T>,
    pub(super) weight: T,
}

/// Which samples touch which texels.
pub(super) trait Touches<T: Scalar>: Sync {
    /// Calls `touch(probe, level, cell)` for each cell that sample `n` adds to.
    fn for_each(&self, n: usize, touch: impl FnMut(usize, usize, Cell<T>));

    /// What sample `n` adds to the cell that its probe touches on a level.
    fn touch(&self, n: usize, probe: usize, level: usize) -> Touch<T>;
}

/// The touches of a piece of samples, by tile.
#[derive(Debug, Default)]
struct Piece {
    /// Tile, sample and probe, in the order of the samples.
    found: Vec<(u32, u16)>,
    /// Sample and probe, by tile.
    sorted: Vec<u16>,
    /// The tiles that are touched: a tile, and where its touches end in `sorted`.
    tiles: Vec<(u32, u32)>,
    /// Per tile its place in `tiles`, or [`UNTOUCHED`].
    places: Vec<u32>,
}

const UNTOUCHED: u32 = u32::MAX;

impl Piece {
    /// Finds the touches of samples `range`, of `tiles` tiles.
    fn find<T: Scalar>(
        &mut self,
        touches: &impl Touches<T>,
        levels: &[Tiles],
        is_wanted: impl Fn(usize) -> bool,
        range: std::ops::Range<usize>,
        count: usize,
    ) {
        let Self { found, sorted, tiles, places } = self;
        found.clear();
        tiles.clear();
        places.clear();
        places.resize(count, UNTOUCHED);
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let (start, range) = (range.start, range);
                for n in range {
                    let sample = (n - start) as u16;
                    touches.for_each(
                        n,
                        #[inline(always)]
                        |probe, level, cell| {
                            if !is_wanted(level) {
                                return;
                            }
                            let tile = levels[level].tile_of(&cell);
                            let place = &mut places[tile];
                            if *place == UNTOUCHED {
                                *place = tiles.len() as u32;
                                tiles.push((tile as u32, 0));
                            }
                            tiles[*place as usize].1 += 1;
                            found.push((*place, sample | (probe as u16) << 13));
                        },
                    );
                }
            },
        );
        let mut start = 0;
        for (_, end) in tiles.iter_mut() {
            let count = *end;
            *end = start;
            start += count;
        }
        sorted.clear();
        sorted.resize(found.len(), 0);
        for &(place, key) in found.iter() {
            let end = &mut tiles[place as usize].1;
            sorted[*end as usize] = key;
            *end += 1;
        }
    }

    /// The touches of the tile at `place`.
    fn of(&self, place: usize) -> std::ops::Range<usize> {
        let start = place.checked_sub(1).map_or(0, |before| self.tiles[before].1);
        start as usize..self.tiles[place].1 as usize
    }
}

/// Memory for the sums, and what is known of all touches.
#[derive(Debug)]
pub(super) struct TexelSums<T: Scalar> {
    levels: Vec<Tiles>,
    pieces: Vec<Piece>,
    /// By tile: the pieces that touch it, each with the tile's place in that piece.
    touched: Vec<[u32; 2]>,
    /// Where in `touched` each tile ends.
    ends: Vec<u32>,
    /// The sums of a tile's parts, of tiles of one level with more touches than a part has.
    parts: Vec<Vec<T::Wide>>,
    /// Which parts these are: tile and number.
    part_names: Vec<[u32; 2]>,
    rows: Vec<Row<T>>,
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
            levels: Vec::new(),
            pieces: Vec::new(),
            touched: Vec::new(),
            ends: Vec::new(),
            parts: Vec::new(),
            part_names: Vec::new(),
            rows: Vec::new(),
        }
    }
}

impl<T: Scalar> TexelSums<T> {
    /// Sorts the touches of `count` samples by tile.
    pub(super) fn sort(
        &mut self,
        touches: &impl Touches<T>,
        count: usize,
        extents: impl Iterator<Item = [usize; 2]>,
        [faces, channels]: [usize; 2],
        is_wanted: impl Fn(usize) -> bool + Sync,
    ) {
        let Self { levels, pieces, touched, ends, .. } = self;
        Tiles::of_levels(levels, extents, faces, channels);
        let levels = &*levels;
        let tiles = levels.last().map_or(0, |last| last.first + last.count());
        ends.clear();
        ends.resize(tiles + 1, 0);
        merge_ranges_into(
            pieces,
            count,
            SAMPLES_PER_PIECE,
            |range, piece| piece.find(touches, levels, &is_wanted, range, tiles),
            |piece| piece.tiles.iter().for_each(|&(tile, _)| ends[tile as usize + 1] += 1),
        );
        for tile in 0..tiles {
            ends[tile + 1] += ends[tile];
        }
        touched.clear();
        touched.resize(ends[tiles] as usize, [0; 2]);
        for (k, piece) in pieces[..count.div_ceil(SAMPLES_PER_PIECE)].iter().enumerate() {
            for (place, &(tile, _)) in piece.tiles.iter().enumerate() {
                let at = &mut ends[tile as usize];
                touched[*at as usize] = [k as u32, place as u32];
                *at += 1;
            }
        }
    }

    /// The pieces that touch a tile.
    fn of_tile(&self, tile: usize) -> &[[u32; 2]] {
        let start = tile.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.touched[start as usize..self.ends[tile] as usize]
    }

    /// The number of a tile's touches.
    fn touches_of(&self, tile: usize) -> usize {
        let of = |&[piece, place]: &[u32; 2]| self.pieces[piece as usize].of(place as usize).len();
        self.of_tile(tile).iter().map(of).sum()
    }

    /// Calls `visit(sample, probe)` for some of a tile's touches.
    #[inline(always)]
    fn visit(
        &self,
        tile: usize,
        range: std::ops::Range<usize>,
        mut visit: impl FnMut(usize, usize),
    ) {
        let mut before = 0;
        for &[piece, place] in self.of_tile(tile) {
            let keys = &self.pieces[piece as usize];
            let keys = &keys.sorted[keys.of(place as usize)];
            let [start, end] =
                [range.start, range.end].map(|at| at.clamp(before, before + keys.len()));
            for &key in &keys[start - before..end - before] {
                let (sample, probe) = (key as usize % SAMPLES_PER_PIECE, key >> 13);
                visit(piece as usize * SAMPLES_PER_PIECE + sample, probe as usize);
            }
            before += keys.len();
        }
    }

    /// Sums some of a tile's touches into `sums`.
    fn sum(
        &self,
        touches: &impl Touches<T>,
        level: usize,
        tile: usize,
        range: std::ops::Range<usize>,
        bars: &[T],
        channels: usize,
        sums: &mut Vec<T::Wide>,
    ) {
        let tiles = self.levels[level];
        let texels = tiles.texels();
        sums.clear();
        sums.resize(texels * texels * channels, T::Wide::ZERO);
        let within = (tile - tiles.first) % (tiles.counts[0] * tiles.counts[1]);
        let origin = [within / tiles.counts[1], within % tiles.counts[1]].map(|k| k * tiles.side);
        pulp::Arch::new().dispatch(
            #[inline(always)]
            || {
                self.visit(
                    tile,
                    range,
                    #[inline(always)]
                    |n: usize, probe: usize| {
                        let Touch { cell, weight } = touches.touch(n, probe, level);
                        let [row, column] = [0, 1].map(|k| (cell.at[k] + 1) as usize - origin[k]);
                        let bars = &bars[n * channels..][..channels];
                        let [f, g] = cell.fractions;
                        let lower = weight * g;
                        let upper = weight - lower;
                        let at = (row * texels + column) * channels;
                        for (weight, at) in [(upper, at), (lower, at + texels * channels)] {
                            let right = weight * f;
                            let weights = [weight - right, right].map(T::widen);
                            let (left, right) = sums[at..][..2 * channels].split_at_mut(channels);
                            for (sums, weight) in [(left, weights[0]), (right, weights[1])] {
                                match (sums, bars) {
                                    ([a, b, c], [x, y, z]) => {
                                        *a += weight * x.widen();
                                        *b += weight * y.widen();
                                        *c += weight * z.widen();
                                    }
                                    (sums, bars) => {
                                        let pairs = sums.iter_mut().zip(bars);
                                        pairs.for_each(|(sum, bar)| *sum += weight * bar.widen());
                                    }
                                }
                            }
                        }
                    },
                );
            },
        );
    }

    /// Adds the terms of all touches of a level to its gradient, `[faces, rows, columns, channels]`.
    pub(super) fn add_level<const K: usize>(
        &mut self,
        chart: impl Chart<K>,
        touches: &impl Touches<T>,
        level: usize,
        bars: &[T],
        channels: usize,
        gradient: &mut [T],
    ) {
        self.sum_parts(touches, level, bars, channels);
        let mut rows = std::mem::take(&mut self.rows);
        let tiles = self.levels[level];
        let count = tiles.faces * tiles.counts[0];
        rows.resize_with(count.max(rows.len()), Row::default);
        let own = &*self;
        let line = tiles.extents[1] * channels;
        for round in 0..2 {
            let (mut rest, mut start) = (&mut *gradient, 0);
            let work = rows[..count].iter_mut().enumerate().filter_map(|(k, row)| {
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
                own.add_row(touches, level, k, bars, channels, row, lines);
            };
            if is_shared(count.div_ceil(2), 1) {
                let mut work: Vec<_> = work.collect();
                for_each_item_mut(&mut work, |_, (k, row, lines)| add(*k, row, lines));
            } else {
                work.for_each(|(k, row, lines)| add(k, row, lines));
            }
        }
        for row in &rows[..count] {
            for (&(face, at), sums) in row.beyond.iter().zip(row.beyond_sums.chunks_exact(channels))
            {
                let texels = chart.beyond(tiles.extents, face, at);
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

    /// Sums the parts of tiles with many touches.
    fn sum_parts(&mut self, touches: &impl Touches<T>, level: usize, bars: &[T], channels: usize) {
        let tiles = self.levels[level];
        let mut names = std::mem::take(&mut self.part_names);
        let mut parts = std::mem::take(&mut self.parts);
        names.clear();
        for tile in tiles.first..tiles.first + tiles.count() {
            let count = self.touches_of(tile).div_ceil(TOUCHES_PER_PART);
            if count > 1 {
                names.extend((0..count).map(|part| [tile as u32, part as u32]));
            }
        }
        let own = &*self;
        let work = |range: std::ops::Range<usize>, sums: &mut Vec<T::Wide>| {
            let [tile, part] = names[range.start].map(|name| name as usize);
            let touched = part * TOUCHES_PER_PART..(part + 1) * TOUCHES_PER_PART;
            own.sum(touches, level, tile, touched, bars, channels, sums);
        };
        merge_ranges_into(&mut parts, names.len(), 1, work, |_| {});
        (self.part_names, self.parts) = (names, parts);
    }

    /// Adds the terms of a row of tiles to `lines`, the texels' rows that it adds to.
    fn add_row(
        &self,
        touches: &impl Touches<T>,
        level: usize,
        k: usize,
        bars: &[T],
        channels: usize,
        row: &mut Row<T>,
        lines: &mut [T],
    ) {
        let tiles = self.levels[level];
        let Row { sums, beyond, beyond_sums } = row;
        beyond.clear();
        beyond_sums.clear();
        let (face, of_face) = (k / tiles.counts[0], k % tiles.counts[0]);
        let first_line = tiles.texel_rows(of_face).start as isize;
        let texels = tiles.texels();
        for column in 0..tiles.counts[1] {
            let tile = tiles.first + k * tiles.counts[1] + column;
            let count = self.touches_of(tile);
            if count == 0 {
                continue;
            }
            if count <= TOUCHES_PER_PART {
                self.sum(touches, level, tile, 0..count, bars, channels, sums);
            } else {
                let first = self.part_names.partition_point(|name| (name[0] as usize) < tile);
                let parts = count.div_ceil(TOUCHES_PER_PART);
                sums.clone_from(&self.parts[first]);
                for part in &self.parts[first + 1..first + parts] {
                    sums.iter_mut().zip(part).for_each(|(sum, &part)| *sum += part);
                }
            }
            let origin = [of_face, column].map(|k| (k * tiles.side) as isize - 1);
            let [last_row, last_column] = tiles.extents.map(|extent| extent as isize - 1);
            // The columns of the tile's sums that lie on the face.
            let left = (-origin[1]).max(0) as usize;
            let right = (last_column - origin[1] + 1).clamp(0, texels as isize) as usize;
            for (i, sums) in sums.chunks_exact(texels * channels).enumerate() {
                let line = origin[0] + i as isize;
                let is_on_face = (0..=last_row).contains(&line);
                if is_on_face && left < right {
                    let start = (line - first_line) as usize * tiles.extents[1] * channels;
                    let start = start + (origin[1] + left as isize) as usize * channels;
                    let entries = &mut lines[start..][..(right - left) * channels];
                    let sums = &sums[left * channels..right * channels];
                    entries.iter_mut().zip(sums).for_each(|(e, &sum)| *e += T::narrow(sum));
                }
                for (j, sums) in sums.chunks_exact(channels).enumerate() {
                    if is_on_face && (left..right).contains(&j) {
                        continue;
                    }
                    if sums.iter().all(|sum| sum.is_same(T::Wide::ZERO)) {
                        continue;
                    }
                    beyond.push((face, [line, origin[1] + j as isize]));
                    beyond_sums.extend(sums.iter().map(|&sum| T::narrow(sum)));
                }
            }
        }
    }

    /// The bytes that it holds, for reports.
    pub(super) fn bytes(&self) -> usize {
        self.pieces.iter().map(|piece| size_of_val(piece.sorted.as_slice())).sum()
    }
}
