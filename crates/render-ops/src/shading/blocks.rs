//! Rows of numbers in blocks: number by number on the stack, for vectors, and back.
//!
//! A row is a normal, a view, a position and the `M` numbers of a material, in this order.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::join;
use smallvec::SmallVec;

use super::direction::{pull_back_unit, unit};
use super::model::{Bars, ShadingPoint};
use crate::vector::{Vector3, dot};

/// Rows of a block.
pub(super) const BLOCK: usize = 64;

/// Rows in one piece of work.
pub(super) const PIECE: usize = 32 * BLOCK;

/// The most inputs that have rows: normals, views, positions, and three of a material.
pub(super) const MOST_PARTS: usize = 6;

/// Where the numbers of each part begin in a row.
pub(super) const NORMAL: usize = 0;
pub(super) const VIEW: usize = 3;
pub(super) const POSITION: usize = 6;
pub(super) const MATERIAL: usize = 9;

/// `K` numbers of each row of a block.
pub(super) type Lanes<T, const K: usize> = [[T; BLOCK]; K];

/// The numbers of a row.
#[inline(always)]
pub(super) fn row<T: Copy, const K: usize>(lanes: &Lanes<T, K>, k: usize) -> [T; K] {
    std::array::from_fn(|i| lanes[i][k])
}

/// Sets the numbers of a row.
#[inline(always)]
pub(super) fn set_row<T: Copy, const K: usize>(lanes: &mut Lanes<T, K>, k: usize, row: [T; K]) {
    for i in 0..K {
        lanes[i][k] = row[i];
    }
}

/// Adds to the numbers of a row.
#[inline(always)]
pub(super) fn add_row<T: Scalar, const K: usize>(lanes: &mut Lanes<T, K>, k: usize, row: [T; K]) {
    for i in 0..K {
        lanes[i][k] += row[i];
    }
}

/// Numbers `[N, width]` of rows, or `[width]` of all rows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column<'a, T> {
    pub(super) entries: &'a [T],
    /// The first of the numbers among those of a row.
    pub(super) first: usize,
    pub(super) width: usize,
    pub(super) is_uniform: bool,
}

impl<T: Scalar> Column<'_, T> {
    /// Loads the numbers of `rows`; rows beyond their end are as the last of them.
    #[inline(always)]
    pub(super) fn load(&self, rows: &Range<usize>, lanes: &mut [[T; BLOCK]]) {
        let width = self.width;
        if self.is_uniform {
            for (lane, &entry) in lanes.iter_mut().zip(self.entries) {
                lane.fill(entry);
            }
            return;
        }
        let entries = &self.entries[rows.start * width..rows.end * width];
        match (lanes, rows.len()) {
            ([x, y, z], BLOCK) => {
                let entries: &[[T; 3]] = entries.as_chunks().0;
                let entries: &[[T; 3]; BLOCK] = entries.first_chunk().expect("a whole block");
                for k in 0..BLOCK {
                    x[k] = entries[k][0];
                    y[k] = entries[k][1];
                    z[k] = entries[k][2];
                }
            }
            ([x], BLOCK) => x.copy_from_slice(entries),
            (lanes, count) => {
                for k in 0..BLOCK {
                    let start = k.min(count - 1) * width;
                    for (lane, &entry) in lanes.iter_mut().zip(&entries[start..start + width]) {
                        lane[k] = entry;
                    }
                }
            }
        }
    }
}

/// Adds the numbers of a block's rows to `entries`, or writes them where these are fresh.
#[inline(always)]
pub(super) fn store<T: Scalar>(lanes: &[[T; BLOCK]], entries: &mut [T], is_fresh: bool) {
    let width = lanes.len();
    match (lanes, entries.len() / width) {
        ([x, y, z], BLOCK) => {
            let entries: &mut [[T; 3]] = entries.as_chunks_mut().0;
            let entries: &mut [[T; 3]; BLOCK] = entries.first_chunk_mut().expect("a whole block");
            if is_fresh {
                for k in 0..BLOCK {
                    entries[k] = [x[k], y[k], z[k]];
                }
            } else {
                for k in 0..BLOCK {
                    entries[k] = [entries[k][0] + x[k], entries[k][1] + y[k], entries[k][2] + z[k]];
                }
            }
        }
        _ => {
            for (k, entries) in entries.chunks_exact_mut(width).enumerate() {
                for (entry, lane) in entries.iter_mut().zip(lanes) {
                    *entry = if is_fresh { lane[k] } else { *entry + lane[k] };
                }
            }
        }
    }
}

/// Numbers of a block's rows, or their gradients.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbers<T, const M: usize> {
    pub(super) normals: Lanes<T, 3>,
    pub(super) views: Lanes<T, 3>,
    pub(super) positions: Lanes<T, 3>,
    pub(super) material: Lanes<T, M>,
}

impl<T: Scalar, const M: usize> Numbers<T, M> {
    #[inline(always)]
    pub(super) fn zeros() -> Self {
        let zeros = [[T::ZERO; BLOCK]; 3];
        let material = [[T::ZERO; BLOCK]; M];
        Self { normals: zeros, views: zeros, positions: zeros, material }
    }

    /// `width` numbers of the rows, from `first` on, which are a part of theirs.
    #[inline(always)]
    pub(super) fn part(&self, first: usize, width: usize) -> &[[T; BLOCK]] {
        match first {
            NORMAL => &self.normals,
            VIEW => &self.views,
            POSITION => &self.positions,
            _ => &self.material[first - MATERIAL..][..width],
        }
    }

    #[inline(always)]
    fn part_mut(&mut self, first: usize, width: usize) -> &mut [[T; BLOCK]] {
        match first {
            NORMAL => &mut self.normals,
            VIEW => &mut self.views,
            POSITION => &mut self.positions,
            _ => &mut self.material[first - MATERIAL..][..width],
        }
    }

    /// Adds the gradients of a row's material, and with `GEOMETRY` those of its normal and view.
    #[inline(always)]
    pub(super) fn add<const GEOMETRY: bool>(&mut self, k: usize, bars: &Bars<T, M>) {
        add_row(&mut self.material, k, bars.material);
        if GEOMETRY {
            add_row(&mut self.normals, k, bars.normal);
            add_row(&mut self.views, k, bars.view);
        }
    }
}

/// A block's rows, with unit vectors for their directions.
pub(super) struct Block<T, const M: usize> {
    numbers: Numbers<T, M>,
    /// How long normals and views were.
    lengths: [[T; BLOCK]; 2],
}

impl<T: Scalar, const M: usize> Block<T, M> {
    #[inline(always)]
    pub(super) fn point(&self, k: usize) -> ShadingPoint<T, M> {
        let Numbers { normals, views, material, .. } = &self.numbers;
        ShadingPoint { n: row(normals, k), v: row(views, k), material: row(material, k) }
    }

    #[inline(always)]
    pub(super) fn position(&self, k: usize) -> Vector3<T> {
        row(&self.numbers.positions, k)
    }

    /// Gradients of normals and views from those of their unit vectors.
    #[inline(always)]
    pub(super) fn pull_back_units(&self, bars: &mut Numbers<T, M>) {
        let [of_normals, of_views] = &self.lengths;
        let both = [
            (&self.numbers.normals, of_normals, &mut bars.normals),
            (&self.numbers.views, of_views, &mut bars.views),
        ];
        for (units, lengths, bars) in both {
            for k in 0..BLOCK {
                set_row(bars, k, pull_back_unit(row(units, k), lengths[k], row(bars, k)));
            }
        }
    }
}

/// All inputs that have rows.
#[derive(Debug)]
pub(super) struct Rows<'a, T> {
    pub(super) columns: SmallVec<[Column<'a, T>; MOST_PARTS]>,
}

impl<T: Scalar> Rows<'_, T> {
    /// The numbers of `rows`; and whether all are finite, and all directions have a length.
    #[inline(always)]
    pub(super) fn load<const M: usize>(&self, rows: &Range<usize>) -> (Block<T, M>, bool) {
        let mut numbers = Numbers::zeros();
        for column in &self.columns {
            column.load(rows, numbers.part_mut(column.first, column.width));
        }
        let mut is_good = true;
        let mut lengths = [[T::ZERO; BLOCK]; 2];
        let both = [&mut numbers.normals, &mut numbers.views];
        for (directions, lengths) in both.into_iter().zip(&mut lengths) {
            for k in 0..BLOCK {
                let (direction, length) = unit(row(directions, k));
                set_row(directions, k, direction);
                lengths[k] = length;
                // The length may be beyond the range of the numbers: the unit vector is not.
                is_good &= dot(direction, direction).is_finite();
            }
        }
        for lane in numbers.material.iter().chain(&numbers.positions) {
            is_good = lane.iter().fold(is_good, |all, entry| all & entry.is_finite());
        }
        (Block { numbers, lengths }, is_good)
    }
}

/// Gradients of a part of rows that are written.
#[derive(Debug)]
pub(super) struct Target<'a, T> {
    /// The first of its numbers among those of a row, and how many there are.
    pub(super) first: usize,
    pub(super) width: usize,
    pub(super) entries: &'a mut [T],
    /// Whether nothing has been added yet.
    pub(super) is_fresh: bool,
}

/// What is written for some rows.
#[derive(Debug)]
pub(super) struct Written<'a, T: Scalar> {
    pub(super) targets: SmallVec<[Target<'a, T>; MOST_PARTS]>,
    /// The sums of each piece, `width` of them.
    pub(super) sums: &'a mut [T::Wide],
    pub(super) width: usize,
}

impl<T: Scalar> Written<'_, T> {
    /// The first `pieces` pieces, and all others.
    fn split(self, pieces: usize) -> (Self, Self) {
        let Self { targets, sums, width } = self;
        let (sums, later_sums) = sums.split_at_mut(pieces * width);
        let mut first = Self { targets: SmallVec::new(), sums, width };
        let mut later = Self { targets: SmallVec::new(), sums: later_sums, width };
        for target in targets {
            let (entries, others) = target.entries.split_at_mut(pieces * PIECE * target.width);
            first.targets.push(Target { entries, ..target });
            later.targets.push(Target { entries: others, ..target });
        }
        (first, later)
    }
}

/// Calls `work` for each piece of `rows`, which begin with a piece; pieces may run at the same time.
pub(super) fn for_each_piece<T: Scalar>(
    rows: Range<usize>,
    written: Written<'_, T>,
    work: &(impl Fn(Range<usize>, Written<'_, T>) + Sync),
) {
    let pieces = rows.len().div_ceil(PIECE);
    if pieces <= 1 {
        if pieces == 1 {
            work(rows, written);
        }
        return;
    }
    // Each half has entries of its own, so both can be worked on at the same time.
    let middle = rows.start + pieces / 2 * PIECE;
    let (first, second) = written.split(pieces / 2);
    join(
        true,
        || for_each_piece(rows.start..middle, first, work),
        || for_each_piece(middle..rows.end, second, work),
    );
}
