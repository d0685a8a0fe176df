//! Where what is hidden can be seen: near jumps of depth.
//!
//! # Forward
//! A ray from a hidden surface of radius s at the pixel x, through the point p of the iris, passes where its radius
//! is r the pixel `x + p (s - r)`. On its way to the lens r falls. At x the ray is behind what is visible, and it
//! stays behind where that is opaque and continuous. Only where the radius of what is visible jumps from a up to b
//! does the ray come out, with r between a and b: at a distance of at most `s - a` from x. So a hidden surface is
//! seen only if, for some jump at a distance d, `s >= a + d`.
//!
//! A jump is where neighbouring pixels are apart by `hiding`, or where a surface lets light through. For tiles of 16
//! x 16 pixels the least `a + d` is found: first for each tile of its own jumps, then by a sweep forth and one back.

use bokashi_core::Scalar;
use bokashi_core::parallel::for_each_piece_mut;

use super::hiding::{LEAST_SHARE, is_gap};
use crate::coverage::Coverage;
use crate::defocus::{Iris, ROWS};
use crate::scratch::Workbench;

/// Columns in a tile, as many as its rows.
const COLUMNS: usize = ROWS;

/// Pixels that a jump may be off: it lies between pixel centres, and blurs reach a pixel farther than their radius.
const SLACK: f64 = 3.0;

/// Per tile the least radius of a hidden surface that can be seen.
#[derive(Debug, Default)]
pub(super) struct Disocclusion {
    least: Vec<f64>,
    tiles: usize,
    benches: Workbench<[Ranges; 2]>,
}

/// The least and the largest radius that each pixel of a row shows.
#[derive(Debug, Default, Clone)]
struct Ranges {
    least: Vec<f64>,
    largest: Vec<f64>,
}

/// What is visible.
#[derive(Debug, Clone, Copy)]
pub(super) struct Visible<'a, T> {
    pub(super) coverage: &'a Coverage,
    pub(super) alphas: &'a [T],
    pub(super) radii: &'a [T],
    /// What is nearest at pixel centres, if that is a layer of its own: its coverage, alphas and radii.
    pub(super) at_centers: Option<(&'a Coverage, &'a [T], &'a [T])>,
    /// Of its pieces.
    pub(super) weights: &'a [T],
    /// The radius of the background's circle.
    pub(super) background: f64,
}

impl Disocclusion {
    /// Finds all jumps, and what they let be seen through an iris.
    pub(super) fn update<T: Scalar>(&mut self, visible: &Visible<'_, T>, iris: Iris) {
        let size = visible.coverage.size();
        let bands = size.height.div_ceil(ROWS);
        self.tiles = size.width.div_ceil(COLUMNS);
        self.least.clear();
        self.least.resize(bands * self.tiles, f64::INFINITY);
        let Self { least, benches, tiles } = self;
        for_each_piece_mut(least, *tiles, |band, least| {
            benches.with(|[above, below]| {
                visible.read_row(band * ROWS, above, least);
                for row in band * ROWS..((band + 1) * ROWS).min(size.height) {
                    // The last row is its own neighbour.
                    visible.read_row((row + 1).min(size.height - 1), below, least);
                    find_jumps([above, below], least);
                    std::mem::swap(above, below);
                }
            });
        });
        self.spread(COLUMNS as f64 / iris.reach());
    }

    /// Lets each tile know of jumps elsewhere: `step` farther back per tile.
    fn spread(&mut self, step: f64) {
        let (tiles, count) = (self.tiles, self.least.len());
        let mut lower = |index: usize, [row, column]: [usize; 2]| {
            let other = self.least[row * tiles + column] + step;
            self.least[index] = self.least[index].min(other);
        };
        for index in 0..count {
            let [row, column] = [index / tiles, index % tiles];
            let columns = column.saturating_sub(1)..(column + 2).min(tiles);
            if row > 0 {
                columns.for_each(|column| lower(index, [row - 1, column]));
            }
            if column > 0 {
                lower(index, [row, column - 1]);
            }
        }
        for index in (0..count).rev() {
            let [row, column] = [index / tiles, index % tiles];
            let columns = column.saturating_sub(1)..(column + 2).min(tiles);
            if index + tiles < count {
                columns.for_each(|column| lower(index, [row + 1, column]));
            }
            if column + 1 < tiles {
                lower(index, [row, column + 1]);
            }
        }
        // Neighbouring tiles may have neighbouring pixels.
        self.least.iter_mut().for_each(|least| *least -= step + SLACK);
    }

    /// Whether a tile starts with a column.
    #[inline(always)]
    pub(super) fn starts_tile(column: usize) -> bool {
        column.is_multiple_of(COLUMNS)
    }

    /// The least radius of a hidden surface that can be seen at a pixel.
    #[inline(always)]
    pub(super) fn least_radius(&self, [row, column]: [usize; 2]) -> f64 {
        self.least[row / ROWS * self.tiles + column / COLUMNS]
    }
}

impl<T: Scalar> Visible<'_, T> {
    /// Finds which radii a row shows. What lets light through counts as a jump in its tile.
    fn read_row(&self, row: usize, ranges: &mut Ranges, tiles: &mut [f64]) {
        let width = self.coverage.size().width;
        let Ranges { least, largest } = ranges;
        least.clear();
        least.resize(width, self.background);
        for run in self.coverage.runs_in_row(row) {
            let first = run.pixels().start - row * width;
            let radii = &self.radii[run.fragments()];
            let to = &mut least[first..first + radii.len()];
            to.iter_mut().zip(radii).for_each(|(to, radius)| *to = radius.to_f64());
        }
        let own = (self.coverage, self.alphas, self.radii);
        for (coverage, alphas, radii) in std::iter::once(own).chain(self.at_centers) {
            for run in coverage.runs_in_row(row) {
                let first = run.pixels().start - row * width;
                let alphas = &alphas[run.fragments()];
                if alphas.iter().all(|&alpha| alpha >= T::ONE) {
                    continue;
                }
                for (k, &alpha) in alphas.iter().enumerate() {
                    if alpha < T::ONE {
                        let radius = radii[run.fragments().start + k].to_f64();
                        lower(&mut tiles[(first + k) / COLUMNS], radius);
                    }
                }
            }
        }
        largest.clone_from(least);
        let boundary = &self.coverage.boundary;
        let ends = [row * width, (row + 1) * width];
        let [start, end] =
            ends.map(|end| boundary.pixels.partition_point(|&pixel| (pixel as usize) < end));
        for index in start..end {
            let column = boundary.pixels[index] as usize - row * width;
            let (mut near, mut far, mut left) = (f64::INFINITY, f64::NEG_INFINITY, 1.0);
            for &fragment in boundary.fragments_of(index) {
                let radius = self.radii[fragment as usize].to_f64();
                (near, far) = (near.min(radius), far.max(radius));
                left -= self.weights[fragment as usize - self.coverage.centers()].to_f64();
                if self.alphas[fragment as usize] < T::ONE {
                    lower(&mut tiles[column / COLUMNS], radius);
                }
            }
            if left > LEAST_SHARE {
                (near, far) = (near.min(self.background), far.max(self.background));
            }
            (least[column], largest[column]) = (near, far);
        }
    }
}

fn lower(least: &mut f64, value: f64) {
    *least = least.min(value);
}

/// Finds the jumps between pixels of two rows.
fn find_jumps([above, below]: [&Ranges; 2], tiles: &mut [f64]) {
    let width = above.least.len();
    for (tile, to) in tiles.iter_mut().enumerate() {
        let columns = tile * COLUMNS..width.min((tile + 1) * COLUMNS + 1);
        let [a, b] = [above, below].map(|ranges| &ranges.least[columns.clone()]);
        let [c, d] = [above, below].map(|ranges| &ranges.largest[columns.clone()]);
        for k in 0..a.len() {
            let next = (k + 1).min(a.len() - 1);
            let near = a[k].min(a[next]).min(b[k]).min(b[next]);
            let far = c[k].max(c[next]).max(d[k]).max(d[next]);
            if is_gap(near, far) {
                lower(to, near);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_tile_knows_of_the_nearest_jump_by_rows_and_columns() {
        let (tiles, rows, step) = (7, 5, 16.0);
        let jumps = [(3, -4.0), (17, 9.0), (30, -20.0)];
        let mut least = vec![f64::INFINITY; tiles * rows];
        jumps.iter().for_each(|&(tile, near)| least[tile] = near);
        let mut found = Disocclusion { least, tiles, ..Disocclusion::default() };
        found.spread(step);
        for tile in 0..tiles * rows {
            let [row, column] = [tile / tiles, tile % tiles];
            let from = |&(other, near): &(usize, f64)| {
                let far = row.abs_diff(other / tiles).max(column.abs_diff(other % tiles));
                near + step * far as f64
            };
            let expected = jumps.iter().map(from).fold(f64::INFINITY, f64::min) - step - SLACK;
            assert_eq!(found.least_radius([row * ROWS + 5, column * COLUMNS + 11]), expected);
        }
    }

    #[test]
    fn a_jump_counts_in_the_tile_at_its_left_or_above_with_its_nearer_radius() {
        // A pixel in front, at the border of two tiles, and one that hardly differs.
        let mut above = Ranges { least: vec![8.0; 40], largest: vec![8.0; 40] };
        let mut below = above.clone();
        (below.least[16], below.largest[16]) = (-6.0, -6.0);
        (above.least[35], above.largest[35]) = (7.6, 7.6);
        let mut tiles = [f64::INFINITY; 3];
        find_jumps([&above, &below], &mut tiles);
        assert_eq!(tiles, [-6.0, -6.0, f64::INFINITY]);
        // A pixel that shows both.
        above.largest[39] = 90.0;
        find_jumps([&above, &below], &mut tiles);
        assert_eq!(tiles[2], 8.0);
    }
}
