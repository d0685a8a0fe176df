//! What the stages of rasterization share.

use std::ops::Range;

use bokashi_core::Scalar;
use pulp::Simd;

use super::corner::{ClipVertices, Corner, HALF_A_PIXEL};
use super::culling::Touched;
use super::filter::{EIGHT, Eight, Filter, Octet, Record, split_into_eights};
use super::setup::{Setup, Weights};
use crate::coverage::Coverage;
use crate::mesh::{Mesh, SilhouetteEdges};
use crate::raster_options::{Limits, Sampling};
use crate::size::Size;

/// How far a face that is drawn reaches.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    /// What it can touch, with whole pixels and not with centres alone.
    pub(super) touched: Touched,
    /// Whether all its vertices surely are tame. Then none of them lies beyond the depth range.
    pub(super) is_tame: bool,
}

/// What the stages share.
pub(super) struct Prepared<'a, T: Scalar> {
    pub(super) mesh: &'a Mesh,
    pub(super) size: Size,
    pub(super) corners: ClipVertices<'a, T>,
    pub(super) filter: Filter,
    pub(super) records: &'a [Record],
    /// Per face: the sign of its area as it is seen, 0 where that is zero within rounding or that side is culled.
    pub(super) orientations: &'a [i8],
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
    /// The silhouette edges of the mesh as it is seen.
    #[inline(always)]
    pub(super) fn silhouette_edges(&self) -> SilhouetteEdges<'_> {
        self.mesh.silhouette_edges(self.orientations)
    }

    /// A face before its pixels are visited one by one.
    #[inline(always)]
    pub(super) fn setup(&self, face: usize) -> Setup<T::Wide> {
        Setup::new(self.corners_of(face).each_ref(), self.orientations[face], self.size)
    }

    /// What the weights of a face follow from, some pixels of which perhaps had to be settled.
    #[inline(always)]
    pub(super) fn weights(&self, face: usize, was_settled: bool) -> Weights<T::Wide> {
        Weights::new(self.corners_of(face).each_ref(), self.orientations[face], was_settled)
    }

    /// The rows of a band.
    pub(super) fn band(&self, band: usize) -> Range<usize> {
        band * self.rows..((band + 1) * self.rows).min(self.size.height)
    }

    /// The columns, and of the rows of a band those, whose pixel centres a drawn face can cover.
    pub(super) fn touched(&self, face: usize, band: &Range<usize>) -> [Range<usize>; 2] {
        let corners = self.corners_of(face);
        Touched::from_corners(corners.each_ref(), self.size, 0.0).within(band)
    }

    /// Whether a face is drawn.
    pub(super) fn is_drawn(&self, face: usize) -> bool {
        let [p, q, r] = self.corners_of(face);
        let beyond = |corner: Corner<T::Wide>| corner.beyond(self.size);
        self.orientations[face] != 0 && beyond(p) & beyond(q) & beyond(r) == 0
    }

    /// The vertices of eight faces.
    #[inline(always)]
    pub(super) fn vertices_of(&self, faces: &Eight<u32>) -> Eight<[u32; 3]> {
        let mut vertices = [[0; 3]; EIGHT];
        for k in 0..EIGHT {
            vertices[k] = self.mesh.faces()[faces[k] as usize];
        }
        vertices
    }

    /// How far faces that are drawn reach: they touch that by which they were listed.
    #[inline(always)]
    pub(super) fn find_reaches<V: Simd>(&self, simd: V, faces: &[u32], reaches: &mut Vec<Reach>) {
        reaches.clear();
        let (eights, last) = split_into_eights(faces);
        for (eight, faces) in eights.iter().chain(&last).zip(faces.chunks(EIGHT)) {
            let octet = Octet::gather(simd, self.records, self.vertices_of(eight));
            let boxes = self.filter.boxes(&octet, self.size, Sampling::Exact);
            reaches.extend(faces.iter().enumerate().map(|(k, &face)| {
                // The filter knows no orientation of a face with a vertex that is not tame.
                let is_tame = boxes.orientations[k] != 0;
                let touched = if is_tame {
                    Touched::from_box(&boxes, k)
                } else {
                    let corners = self.corners_of(face as usize);
                    Touched::from_corners(corners.each_ref(), self.size, HALF_A_PIXEL)
                };
                Reach { touched, is_tame }
            }));
        }
    }

    #[inline(always)]
    pub(super) fn corners_of(&self, face: usize) -> [Corner<T::Wide>; 3] {
        self.corners.corners_of(self.mesh.faces()[face])
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
