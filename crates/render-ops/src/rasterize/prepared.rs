//! What the stages of rasterization share.

use bokashi_core::Scalar;

use super::culling::{Corner, Verdict};
use super::setup::LANES;
use crate::coverage::Coverage;
use crate::mesh::Mesh;
use crate::raster_options::{Limits, Sampling};
use crate::size::Size;

/// Stands for "not seen".
pub(super) const NO_SLOT: u32 = u32::MAX;

/// Rows whose blocks lie a multiple of so many apart share places in a core's cache: they get half as many more.
const BLOCKS_APART: usize = 16;

/// What the stages share.
pub(super) struct Prepared<'a, T: Scalar> {
    pub(super) mesh: &'a Mesh,
    pub(super) size: Size,
    pub(super) corners: &'a [Corner<T::Wide>],
    pub(super) verdicts: &'a [Verdict],
    /// The X of each column's pixel centres, in whole blocks.
    pub(super) centers: &'a [T::Wide],
    /// The Y of each row's.
    pub(super) ys: &'a [T::Wide],
    /// Rows per band.
    pub(super) rows: usize,
    pub(super) sampling: Sampling,
    pub(super) limits: Limits,
    /// Whether a gradient can be asked for.
    pub(super) needs: bool,
    /// The layer in front of those that are looked for, if these are not the nearest.
    pub(super) front: Option<&'a Coverage>,
    /// How many layers are looked for.
    pub(super) layers: usize,
}

impl<'a, T: Scalar> Prepared<'a, T> {
    /// Blocks from the start of a row to that of the next. At a distance of a large power of two the rows of a
    /// face would share a few places in a core's cache.
    #[inline(always)]
    pub(super) fn blocks_per_row(&self) -> usize {
        let blocks = self.centers.len() / LANES;
        if blocks.is_multiple_of(BLOCKS_APART) { blocks + BLOCKS_APART / 2 } else { blocks }
    }

    /// [`Mesh::is_silhouette`], as the mesh is seen.
    #[inline(always)]
    pub(super) fn is_silhouette(&self, face: usize, corner: usize) -> bool {
        self.mesh.is_silhouette(face, corner, |face| self.verdicts[face].orientation)
    }

    #[inline(always)]
    pub(super) fn corners_of(&self, face: usize) -> [&'a Corner<T::Wide>; 3] {
        self.mesh.faces()[face].map(|vertex| &self.corners[vertex as usize])
    }
}

/// Makes counts of the items of one kind after another the places where each kind ends.
#[inline(always)]
pub(super) fn sum_up(counts: &mut [u32]) {
    let mut before = 0;
    for count in counts {
        before += *count;
        *count = before;
    }
}
