//! The signs of a field, a bit for each point of the grid, and the edges of the grid that cross the surface.
//!
//! A cube is split along its diagonal into six tetrahedra. So a point is the lower end of up to seven edges. Edges lead
//! to the corners `d` of the cell above the point, with `d` from 1 to 7. Bit 4 of `d` is a step along x, bit 2 along y,
//! bit 1 along z. A word has the bits of 64 points along z, so that 64 cells are compared at once.
//!
//! Vertices are numbered by word, then by `d`, then by point. So the number of a vertex is the number of the first
//! vertex of its word and `d`, plus a count of bits.

use std::sync::atomic::{AtomicBool, Ordering};

use bokashi_core::Scalar;
use bokashi_core::parallel::{for_each_piece_mut, write_each};

use crate::error::MeshError;
use crate::grid::Grid;

/// The number of points in a word.
pub(super) const POINTS: usize = 64;

/// The number of words in one piece of work.
const WORDS_PER_PIECE: usize = 1 << 9;

/// The number of directions of edges from their lower end.
pub(super) const DIRECTIONS: usize = 7;

/// The signs of a field.
#[derive(Debug)]
pub(super) struct Signs {
    pub(super) shape: [usize; 3],
    /// The number of words in a row along z.
    pub(super) words: usize,
    /// By row and word: a bit for each point inside. Bits beyond the row are 0.
    inside: Vec<u64>,
    /// By row, word and direction: the number of the first vertex. The last entry is the number of all vertices.
    starts: Vec<u32>,
}

impl Signs {
    /// Reads the signs of `field` at the points of `grid`.
    ///
    /// # Errors
    /// [`MeshError::FieldValue`] for a number that is not finite.
    pub(super) fn new<T: Scalar>(field: &[T], grid: &Grid) -> Result<Self, MeshError> {
        let shape = grid.shape();
        let [nx, ny, nz] = shape;
        let words = nz.div_ceil(POINTS);
        let mut inside = vec![0; nx * ny * words];
        let is_finite = AtomicBool::new(true);
        write_each(&mut inside, WORDS_PER_PIECE, |at| {
            let (row, first) = (at / words, at % words * POINTS);
            let values = &field[row * nz..][first..nz.min(first + POINTS)];
            // Without a branch for each value, so that the loop is vectorized.
            let (mut bits, mut all) = (0, true);
            for (k, value) in values.iter().enumerate() {
                bits |= u64::from(*value < T::ZERO) << k;
                all &= value.is_finite();
            }
            if !all {
                is_finite.store(false, Ordering::Relaxed);
            }
            bits
        });
        if is_finite.into_inner() {
            return Ok(Self { shape, words, inside, starts: Vec::new() });
        }
        let point = field.iter().position(|value| !value.is_finite()).unwrap_or_default();
        Err(MeshError::FieldValue { point: grid.place(point), value: field[point].to_f64() })
    }

    /// Numbers the vertices, and returns their number: counts by word and direction, then an exclusive prefix sum.
    pub(super) fn number(&mut self) -> u64 {
        let mut starts = std::mem::take(&mut self.starts);
        starts.clear();
        starts.resize(self.inside.len() * DIRECTIONS + 1, 0);
        let counts = &mut starts[..self.inside.len() * DIRECTIONS];
        for_each_piece_mut(counts, WORDS_PER_PIECE * DIRECTIONS, |piece, counts| {
            let words = counts.as_chunks_mut::<DIRECTIONS>().0;
            for (at, counts) in (piece * WORDS_PER_PIECE..).zip(words) {
                for (direction, count) in (1..).zip(counts) {
                    *count = self.crossed(at, direction).count_ones();
                }
            }
        });
        let mut sum = 0;
        for start in &mut starts {
            let count = u64::from(*start);
            *start = sum as u32;
            sum += count;
        }
        self.starts = starts;
        sum
    }

    /// The row of points one step further along x and y, by the bits of `direction`. `None` beyond the grid.
    pub(super) fn row_beside(&self, row: usize, direction: usize) -> Option<usize> {
        let [nx, ny, _] = self.shape;
        let [along_x, along_y] = [direction >> 2 & 1, direction >> 1 & 1];
        let is_there = row / ny + along_x < nx && row % ny + along_y < ny;
        is_there.then_some(row + along_x * ny + along_y)
    }

    /// The bits of a word. With `is_shifted`, each point has the bit of the next point along z.
    pub(super) fn word(&self, row: usize, word: usize, is_shifted: bool) -> u64 {
        let at = row * self.words + word;
        if !is_shifted {
            return self.inside[at];
        }
        let next = if word + 1 < self.words { self.inside[at + 1] << (POINTS - 1) } else { 0 };
        self.inside[at] >> 1 | next
    }

    /// The bits of a word that are points. With `is_shifted`, those with a next point along z.
    pub(super) fn valid(&self, word: usize, is_shifted: bool) -> u64 {
        let left = self.shape[2] - word * POINTS - usize::from(is_shifted);
        if left < POINTS { (1 << left) - 1 } else { u64::MAX }
    }

    /// The points of the word `at` whose edge in `direction` crosses the surface: its ends have other bits.
    fn crossed(&self, at: usize, direction: usize) -> u64 {
        let (row, word) = (at / self.words, at % self.words);
        let is_shifted = direction & 1 == 1;
        let Some(other) = self.row_beside(row, direction) else { return 0 };
        (self.inside[at] ^ self.word(other, word, is_shifted)) & self.valid(word, is_shifted)
    }

    /// The number of the vertex on the edge in `direction` from point `k` of a row. The edge must cross the surface.
    pub(super) fn vertex(&self, row: usize, k: usize, direction: usize) -> u32 {
        let at = row * self.words + k / POINTS;
        let before = self.crossed(at, direction) & ((1 << (k % POINTS)) - 1);
        self.starts[at * DIRECTIONS + direction - 1] + before.count_ones()
    }

    /// The edges of a range of rows that cross the surface, in the order of their vertices, each with the inner end
    /// first.
    pub(super) fn crossed_edges(&self, rows: std::ops::Range<usize>) -> Vec<[u32; 2]> {
        let [_, ny, nz] = self.shape;
        let words = rows.start * self.words..rows.end * self.words;
        let [first, last] =
            [words.start, words.end].map(|at| self.starts[at * DIRECTIONS] as usize);
        let mut edges = Vec::with_capacity(last - first);
        for at in words {
            let is_crossed = self.starts[at * DIRECTIONS] < self.starts[(at + 1) * DIRECTIONS];
            if !is_crossed {
                continue;
            }
            let start = at / self.words * nz + at % self.words * POINTS;
            for direction in 1..=DIRECTIONS {
                let [x, y, z] = [2, 1, 0].map(|bit| direction >> bit & 1);
                let step = (x * ny + y) * nz + z;
                for bit in bits(self.crossed(at, direction)) {
                    let [lower, upper] = [start + bit, start + bit + step].map(|end| end as u32);
                    let is_inside = self.inside[at] >> bit & 1 == 1;
                    edges.push(if is_inside { [lower, upper] } else { [upper, lower] });
                }
            }
        }
        edges
    }
}

/// The indices of the bits of a word that are set, from the lowest.
pub(super) fn bits(mut word: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let bit = word.trailing_zeros() as usize;
        word &= word.wrapping_sub(1);
        (bit < POINTS).then_some(bit)
    })
}
