//! What the stages of rasterization share.

use bokashi_core::Scalar;

use std::ops::Range;

use super::corner::Corner;
use super::culling::{Fate, Verdict};
use super::filter::{Filter, Record};
use super::setup::{Setup, Weights};
use crate::coverage::Coverage;
use crate::mesh::Mesh;
use crate::raster_options::{Limits, Sampling};
use crate::size::Size;

/// What the stages share.
pub(super) struct Prepared<'a, T: Scalar> {
    pub(super) mesh: &'a Mesh,
    pub(super) size: Size,
    pub(super) corners: &'a [Corner<T::Wide>],
    pub(super) filter: Filter,
    pub(super) records: &'a [Record],
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
    /// [`Mesh::silhouettes_of`], as the mesh is seen.
    #[inline(always)]
    pub(super) fn silhouettes_of(&self, face: usize) -> u8 {
        self.mesh.silhouettes_of(face, |face| self.verdicts[face].orientation)
    }

    /// A face before its pixels are visited one by one.
    #[inline(always)]
    pub(super) fn setup(&self, face: usize) -> Setup<T::Wide> {
        Setup::new(self.corners_of(face), self.verdicts[face].orientation, self.size)
    }

    /// What the weights of a face follow from, some pixels of which perhaps had to be settled.
    #[inline(always)]
    pub(super) fn weights(&self, face: usize, was_settled: bool) -> Weights<T::Wide> {
        Weights::new(self.corners_of(face), self.verdicts[face].orientation, was_settled)
    }

    /// The rows of a band.
    pub(super) fn band(&self, band: usize) -> Range<usize> {
        band * self.rows..((band + 1) * self.rows).min(self.size.height)
    }

    /// The columns, and of the rows of a band those that a drawn face can touch.
    #[inline(always)]
    pub(super) fn touched(&self, face: usize, band: &Range<usize>) -> [Range<usize>; 2] {
        let Fate::Drawn { columns: [left, right], rows: [top, bottom] } = self.verdicts[face].fate
        else {
            unreachable!("only faces that are drawn are on the lists");
        };
        let rows = band.start.max(top as usize)..band.end.min(bottom as usize + 1);
        [left as usize..right as usize + 1, rows]
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
