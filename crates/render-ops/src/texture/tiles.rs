//! Which probes add to which part of a level.
//!
//! The cells of a level are cut into square *tiles*. The probes of neighbouring samples mostly lie in
//! the same tile: they are a *run*. A run names its first probe and their number, for the rest is worked
//! out again with less work than to read it from memory. Runs are found and sorted by tile piece of
//! samples by piece.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::merge_ranges_into;

use super::cells::{Cells, Extents};
use super::chart::{Chart, Places};
use super::lanes::{LANES, Lanes};
use super::lookup::{Lookup, Probe, Probes};
use crate::dispatch::dispatch_256;

/// Samples whose runs are sorted together.
const SAMPLES_PER_PIECE: usize = 1 << 13;

/// The logarithm of the number of cells along a tile's side, where a texel has a few channels and where
/// it has many: the sums of a tile shall stay in a processor's first cache.
const SHIFTS: [u32; 2] = [5, 4];

/// A texel of more channels has many.
const FEW_CHANNELS: usize = 4;

/// How the cells of a level are cut.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tiles {
    /// Rows and columns of texels.
    pub(super) extents: [usize; 2],
    /// Of the number of cells along a tile's side, the logarithm.
    shift: u32,
    /// Rows and columns of tiles of a face.
    pub(super) counts: [usize; 2],
    /// The number of the first tile.
    pub(super) first: usize,
    pub(super) faces: usize,
    /// The numbers of a texel in a tile's sums: more than it has channels where that makes a vector.
    pub(super) width: usize,
}

/// No tile: the probe touches no texel.
const NO_TILE: u32 = u32::MAX;

impl Tiles {
    /// Of a level, whose first tile has the number `first`.
    fn new(extents: [usize; 2], [faces, channels]: [usize; 2], first: usize) -> Self {
        let shift = SHIFTS[usize::from(channels > FEW_CHANNELS)];
        // Cells start one texel before the border, and end with the last texel.
        let counts = extents.map(|extent| (extent >> shift) + 1);
        let width = if channels == 3 { 4 } else { channels };
        Self { extents, shift, counts, first, faces, width }
    }

    /// The number of its tiles.
    pub(super) fn count(&self) -> usize {
        self.faces * self.counts[0] * self.counts[1]
    }

    /// Rows of tiles on all faces.
    pub(super) fn rows(&self) -> usize {
        self.faces * self.counts[0]
    }

    /// Texels along a side of a tile's sums.
    pub(super) fn texels(&self) -> usize {
        (1 << self.shift) + 1
    }

    /// Row and column of a tile's first texel, from -1 on.
    pub(super) fn origin(&self, tile: usize) -> [i32; 2] {
        let of_face = (tile - self.first) % (self.counts[0] * self.counts[1]);
        [of_face / self.counts[1], of_face % self.counts[1]].map(|k| (k << self.shift) as i32 - 1)
    }

    /// The rows of texels of a face that row `row` of tiles adds to.
    pub(super) fn texel_rows(&self, row: usize) -> Range<usize> {
        let first = row << self.shift;
        first.saturating_sub(1)..(first + (1 << self.shift)).min(self.extents[0])
    }

    /// Finds the tiles of some cells.
    #[inline(always)]
    fn find<T: Scalar>(
        &self,
        places: &Places<T>,
        cells: &Cells<T>,
        lanes: Range<usize>,
        tiles: &mut Lanes<u32>,
    ) {
        let [rows_of_face, columns] = self.counts.map(|count| count as u32);
        let first = self.first as u32;
        let (faces, tiles) = (&places.faces[lanes.clone()], &mut tiles[lanes.clone()]);
        let [rows, lines] = [0, 1].map(|k| &cells.corners[k][lanes.clone()]);
        let count = tiles.len();
        let (faces, rows, lines) = (&faces[..count], &rows[..count], &lines[..count]);
        let shift = self.shift;
        for i in 0..count {
            let [row, column] = [rows[i] + 1, lines[i] + 1];
            // Where there is no cell, one of them is negative.
            let none = ((row | column) >> 31) as u32;
            let [row, column] = [row as u32 >> shift, column as u32 >> shift];
            let row_of_tiles = u32::from(faces[i]).wrapping_mul(rows_of_face).wrapping_add(row);
            let tile = row_of_tiles.wrapping_mul(columns).wrapping_add(column);
            tiles[i] = first.wrapping_add(tile) | none;
        }
    }
}

/// Neighbouring probes in one tile, by tile and in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Run {
    tile: u32,
    /// The sample of the first probe, within its piece.
    sample: u16,
    /// The number of the first probe among the probes of its sample.
    number: u8,
    /// The number of probes.
    count: u8,
}

/// The runs of a tile within a piece of samples.
#[derive(Debug, Clone, Copy)]
struct Touched {
    tile: u32,
    /// Where its runs end.
    end: u32,
    /// The number of its probes.
    probes: u32,
}

/// The runs of a piece of samples, by tile.
#[derive(Debug, Default)]
struct Piece {
    runs: Vec<Run>,
    tiles: Vec<Touched>,
}

impl Piece {
    /// Finds the runs of `samples`.
    fn find<T: Scalar, C: Chart<K>, const K: usize>(
        &mut self,
        lookup: &Lookup<'_, T, C, K>,
        levels: &[Tiles],
        is_wanted: impl Fn(usize) -> bool,
        samples: Range<usize>,
    ) {
        let Self { runs, tiles } = self;
        runs.clear();
        dispatch_256::<T, _>(
            #[inline(always)]
            || {
                // Moved, so that the closure can run only once and is inlined here.
                let (start, samples) = (samples.start, samples);
                let (mut probes, mut cells) = (Probes::new(), Cells::new());
                let (mut next, mut tiles) = (Probe::first_of(start), [0; LANES]);
                while next.sample < samples.end {
                    next = lookup.fill(&mut probes, next, samples.end);
                    let mut lane = 0;
                    while lane < probes.count {
                        let segment = probes.segment(lane);
                        lane = segment.lanes.end;
                        for level in segment.levels() {
                            if !is_wanted(level) {
                                continue;
                            }
                            let (lanes, extents) = (segment.lanes.clone(), &lookup.extents[level]);
                            cells.find(&probes.places, lanes, extents, lookup.rounding());
                            let lanes = segment.lanes.clone();
                            levels[level].find(&probes.places, &cells, lanes, &mut tiles);
                            push_runs(&probes, &tiles, start, segment.lanes.clone(), runs);
                        }
                    }
                }
            },
        );
        runs.sort_unstable();
        tiles.clear();
        for (k, run) in runs.iter().enumerate() {
            match tiles.last_mut() {
                Some(last) if last.tile == run.tile => {
                    last.end += 1;
                    last.probes += u32::from(run.count);
                }
                _ => {
                    let (end, probes) = (k as u32 + 1, u32::from(run.count));
                    tiles.push(Touched { tile: run.tile, end, probes });
                }
            }
        }
    }

    /// The runs of the tile at `index`.
    fn runs(&self, index: usize) -> &[Run] {
        let start = index.checked_sub(1).map_or(0, |before| self.tiles[before].end);
        &self.runs[start as usize..self.tiles[index].end as usize]
    }
}

/// Adds the runs of some probes of a block, whose first possible sample is `start`.
#[inline(always)]
fn push_runs<T: Scalar, const K: usize>(
    probes: &Probes<T, K>,
    tiles: &Lanes<u32>,
    start: usize,
    lanes: Range<usize>,
    runs: &mut Vec<Run>,
) {
    let mut first = lanes.start;
    while first < lanes.end {
        let tile = tiles[first];
        let mut end = first + 1;
        while end < lanes.end && tiles[end] == tile {
            end += 1;
        }
        if tile != NO_TILE {
            let sample = (probes.samples[first] - start) as u16;
            runs.push(Run {
                tile,
                sample,
                number: probes.numbers[first],
                count: (end - first) as u8,
            });
        }
        first = end;
    }
}

/// The runs of all samples, by tile.
#[derive(Debug, Default)]
pub(super) struct Runs {
    levels: Vec<Tiles>,
    pieces: Vec<Piece>,
    /// By tile: the pieces that touch it, each with the tile's place in that piece.
    touched: Vec<[u32; 2]>,
    /// Where in `touched` each tile ends.
    ends: Vec<u32>,
}

impl Runs {
    /// Finds the runs of `count` samples on the levels that are wanted, of texels of `channels` numbers.
    pub(super) fn find<T: Scalar, C: Chart<K>, const K: usize>(
        &mut self,
        lookup: &Lookup<'_, T, C, K>,
        count: usize,
        channels: usize,
        is_wanted: impl Fn(usize) -> bool + Sync,
    ) {
        let Self { levels, pieces, touched, ends } = self;
        levels.clear();
        let mut tiles = 0;
        for Extents { counts, .. } in lookup.extents {
            let level = Tiles::new(*counts, [C::FACES, channels], tiles);
            tiles += level.count();
            levels.push(level);
        }
        let levels = &*levels;
        ends.clear();
        ends.resize(tiles + 1, 0);
        merge_ranges_into(
            pieces,
            count,
            SAMPLES_PER_PIECE,
            |range, piece| piece.find(lookup, levels, &is_wanted, range),
            |piece| piece.tiles.iter().for_each(|touched| ends[touched.tile as usize + 1] += 1),
        );
        // By tile, the pieces in their order: so a tile's sum has the same order for any number of threads.
        for tile in 0..tiles {
            ends[tile + 1] += ends[tile];
        }
        touched.clear();
        touched.resize(ends[tiles] as usize, [0; 2]);
        for (k, piece) in pieces[..count.div_ceil(SAMPLES_PER_PIECE)].iter().enumerate() {
            for (position, &Touched { tile, .. }) in piece.tiles.iter().enumerate() {
                let end = &mut ends[tile as usize];
                touched[*end as usize] = [k as u32, position as u32];
                *end += 1;
            }
        }
    }

    /// How a level is cut.
    pub(super) fn tiles(&self, level: usize) -> Tiles {
        self.levels[level]
    }

    /// The pieces that touch a tile, by number.
    pub(super) fn pieces_of(&self, tile: usize) -> Range<usize> {
        let start = tile.checked_sub(1).map_or(0, |before| self.ends[before]);
        start as usize..self.ends[tile] as usize
    }

    /// The number of probes of a tile in a piece that touches it.
    pub(super) fn probes_of(&self, piece: usize) -> usize {
        let [piece, position] = self.touched[piece].map(|k| k as usize);
        self.pieces[piece].tiles[position].probes as usize
    }

    /// The runs of a tile in some pieces that touch it: their first probes, and how many there are.
    #[inline(always)]
    pub(super) fn runs(&self, pieces: Range<usize>) -> impl Iterator<Item = (Probe, usize)> {
        self.touched[pieces].iter().flat_map(move |touched| {
            let [piece, position] = touched.map(|k| k as usize);
            self.pieces[piece].runs(position).iter().map(move |run| {
                let sample = piece * SAMPLES_PER_PIECE + run.sample as usize;
                (Probe { sample, number: run.number as usize }, run.count as usize)
            })
        })
    }

    /// The bytes that it holds, for reports.
    pub(super) fn bytes(&self) -> usize {
        self.pieces.iter().map(|piece| size_of_val(piece.runs.as_slice())).sum()
    }
}
