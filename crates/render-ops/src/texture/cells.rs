//! From places on a face to cells of a level: the four texels around a place.

use std::ops::Range;

use bokashi_core::Scalar;

use super::chart::Places;
use super::lanes::{LANES, Lanes};

/// The texels of a level along rows and columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extents<T> {
    /// Rows and columns.
    pub(super) counts: [usize; 2],
    /// Columns and rows, as places on a face have them.
    pub(super) scale: [T; 2],
}

impl<T: Scalar> Extents<T> {
    pub(super) fn new(counts: [usize; 2]) -> Self {
        let [rows, columns] = counts.map(|count| T::from_f64(count as f64));
        Self { counts, scale: [columns, rows] }
    }
}

/// Which cell a place lies in.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rounding {
    /// Whether the nearest texel is all of the sample: then it is the upper left texel of the cell.
    pub(super) to_nearest: bool,
    /// Whether a place beyond the face along each of its axes has no cell.
    pub(super) ends: [bool; 2],
}

/// The row or the column of no cell: its texels lie beyond the face, too.
const NO_CELL: f64 = -2.0;

/// The cells of a block of probes, on one level.
#[derive(Debug)]
pub(super) struct Cells<T> {
    /// The row and the column of the upper left texel, from -1 on; or [`NO_CELL`].
    pub(super) corners: [Lanes<i32>; 2],
    /// f and g: how far the place lies from that texel to the right and down.
    pub(super) fractions: [Lanes<T>; 2],
    /// The number of the upper left texel on its level, if all four texels are on the face; or
    /// [`BEYOND`].
    pub(super) texels: Lanes<u32>,
}

/// No texel: a level has less, see `levels`.
const BEYOND: u32 = u32::MAX;

impl<T: Scalar> Cells<T> {
    pub(super) fn new() -> Self {
        Self { corners: [[0; LANES]; 2], fractions: [[T::ZERO; LANES]; 2], texels: [0; LANES] }
    }

    /// f and g of probe `i`.
    #[inline(always)]
    pub(super) fn fractions_of(&self, i: usize) -> [T; 2] {
        [self.fractions[0][i], self.fractions[1][i]]
    }

    /// Finds the cells of some of the places on a level.
    #[inline(always)]
    pub(super) fn find(
        &mut self,
        places: &Places<T>,
        lanes: Range<usize>,
        extents: &Extents<T>,
        rounding: Rounding,
    ) {
        for axis in 0..2 {
            let positions = &places.positions[axis][lanes.clone()];
            // Along the columns of a face its rows follow each other.
            let texels = &mut self.corners[1 - axis][lanes.clone()];
            let fractions = &mut self.fractions[axis][lanes.clone()];
            let (scale, count) = (extents.scale[axis], extents.counts[1 - axis]);
            let rounding = (rounding.to_nearest, rounding.ends[axis]);
            find_along(positions, scale, count, rounding, texels, fractions);
        }
    }

    /// Finds the texels of cells that were found.
    #[inline(always)]
    pub(super) fn find_texels(
        &mut self,
        places: &Places<T>,
        lanes: Range<usize>,
        extents: &Extents<T>,
    ) {
        let faces = &places.faces[lanes.clone()];
        let [rows, columns] = [0, 1].map(|k| &self.corners[k][lanes.clone()]);
        let texels = &mut self.texels[lanes];
        let count = texels.len();
        let (faces, rows, columns) = (&faces[..count], &rows[..count], &columns[..count]);
        let [height, width] = extents.counts.map(|count| count as u32);
        for i in 0..count {
            // -1 is a large number without a sign.
            let [row, column] = [rows[i] as u32, columns[i] as u32];
            let is_on_face = (row < height - 1) & (column < width - 1);
            let line = u32::from(faces[i]).wrapping_mul(height).wrapping_add(row);
            let texel = line.wrapping_mul(width).wrapping_add(column);
            // Without a choice, of which the compiler would make a branch.
            texels[i] = texel | u32::from(!is_on_face).wrapping_neg() & BEYOND;
        }
    }
}

/// Finds texels and fractions of `positions` along an axis of `count` texels.
#[inline(always)]
fn find_along<T: Scalar>(
    positions: &[T],
    scale: T,
    count: usize,
    (to_nearest, ends): (bool, bool),
    texels: &mut [i32],
    fractions: &mut [T],
) {
    let (first, last) = (if to_nearest { 0.0 } else { -1.0 }, count as f64 - 1.0);
    let half = T::from_f64(if to_nearest { 0.0 } else { 0.5 });
    let (texels, fractions) = (&mut texels[..positions.len()], &mut fractions[..positions.len()]);
    for i in 0..positions.len() {
        let x = positions[i] * scale - half;
        let floor = x.to_f64().floor();
        let near = if floor > first { floor } else { first };
        let near = if near < last { near } else { last };
        let texel = if ends && near != floor { NO_CELL } else { near };
        texels[i] = integer(texel);
        fractions[i] = if to_nearest { T::ZERO } else { x - T::from_f64(floor) };
    }
}

/// A whole number from `-2^31` to below `2^31`, exactly. To which integer a number is cast has to be
/// asked where it may be too large or NaN; here it is not.
#[inline(always)]
pub(super) fn integer(whole: f64) -> i32 {
    // With these in front the last bits are the number's.
    (whole + 1.5 * (1_u64 << 52) as f64).to_bits() as i32
}
