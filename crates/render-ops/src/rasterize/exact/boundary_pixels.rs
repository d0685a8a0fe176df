//! The boundary pixels of a band: which they are, and which faces they hold.

use std::ops::Range;

use bokashi_core::Scalar;

use super::band_faces::{
    BEYOND, BandFaces, FaceBits, INNER_SEAM, REACH, SECOND, each_edge, own_edges,
};
use super::depth_intervals::{DepthInterval, front_layers, may_cross};
use super::faces_by_pixel::FacesByPixel;
use super::pieces::Pieces;
use super::pixel_mask::{BLOCK, PixelMask, stripe_shift};
use super::planes::Planes;
use super::polygon::Line;
use super::regions::Regions;
use super::resolution::Resolution;
use crate::mesh::Neighbor;

/// The memory of the search.
#[derive(Debug, Default)]
pub(in crate::rasterize) struct BoundarySearch<S> {
    marks: PixelMask,
    /// The stripes of the image that each face of the band may reach into.
    stripes: Vec<u64>,
    regions: Regions,
    /// The first pixel of each region, and how many faces cover its centre.
    firsts: PixelMask,
    layers: Vec<u32>,
    /// Blocks of pixels.
    blocks: PixelMask,
    planes: Planes<S>,
    intervals: Vec<DepthInterval<S>>,
    faces_by_pixel: FacesByPixel,
    resolution: Resolution<S>,
    /// What is known of each face of the band.
    face_bits: Vec<FaceBits>,
}

impl<S: Scalar<Wide = S>> BoundarySearch<S> {
    /// Finds the boundary pixels of a band and their pieces.
    #[inline(always)]
    pub(in crate::rasterize) fn run<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        pieces: &mut Pieces<S>,
    ) {
        pieces.clear();
        self.mark(band);
        self.mark_crossings(band);
        if self.marks.count() == 0 {
            return;
        }
        let mut marks = std::mem::take(&mut self.marks);
        let stripes = std::mem::take(&mut self.stripes);
        let mut faces_by_pixel = std::mem::take(&mut self.faces_by_pixel);
        faces_by_pixel.for_each(band, &stripes, &mut marks, 1, |pixel, center, faces| {
            self.resolve(band, pixel, center, faces, pieces);
        });
        (self.marks, self.stripes, self.faces_by_pixel) = (marks, stripes, faces_by_pixel);
    }

    /// Marks the pixels that an edge of the surface or an end of the depth range may cross.
    #[inline(always)]
    fn mark<T: Scalar<Wide = S>>(&mut self, band: &BandFaces<'_, '_, T>) {
        let view = band.view;
        let Self { marks, stripes, face_bits, planes, .. } = self;
        let (adjacency, silhouettes) = (view.mesh.adjacency(), view.silhouette_edges());
        marks.clear(band.rows.len(), view.size.width);
        stripes.clear();
        stripes.extend(band.stripes(stripe_shift(view.size.width)));
        planes.clear(band.faces.len());
        face_bits.clear();
        face_bits.extend((0..).zip(band.faces).map(
            #[inline(always)]
            |(index, &face)| {
                let outline = FaceBits::from(silhouettes.find(face as usize));
                let seams = FaceBits::from(view.mesh.seams_of(face as usize));
                let marked = outline | seams;
                let is_beyond = band.is_beyond_depths(index);
                if marked == 0 {
                    return FaceBits::from(is_beyond) << BEYOND;
                }
                let neighbors = adjacency.neighbors(face as usize);
                let is_before = |beyond: Neighbor| {
                    beyond.face() < face as usize && view.is_drawn(beyond.face())
                };
                let second =
                    each_edge(|k| marked >> k & 1 == 1 && neighbors[k].is_some_and(is_before));
                marked
                    | (seams & !outline) << INNER_SEAM
                    | second << SECOND
                    | FaceBits::from(is_beyond) << BEYOND
            },
        ));
        for (index, &bits) in (0..).zip(&*face_bits) {
            // An edge of two faces is marked once, by the face that stands for it.
            let own = own_edges(bits);
            if own != 0 {
                mark_edges(marks, band, index, own);
            }
            if bits >> BEYOND & 1 == 1 {
                let [rows, columns] = band.reach(index);
                for row in rows {
                    let [depth, x, y] = band.depth(index, view.centers[0], view.ys[row]);
                    // Where depth = +-1 crosses the face's pixels.
                    for end in [-S::ONE, S::ONE] {
                        let near = near_line([depth - end, x, y], columns.clone());
                        marks.mark(row - band.rows.start, near);
                    }
                }
            }
        }
    }

    /// Marks the pixels where surfaces may pass through each other.
    #[inline(always)]
    fn mark_crossings<T: Scalar<Wide = S>>(&mut self, band: &BandFaces<'_, '_, T>) {
        let Self {
            marks,
            stripes,
            regions,
            firsts,
            layers,
            blocks,
            planes,
            intervals,
            faces_by_pixel,
            ..
        } = self;
        let (rows, width) = (band.rows.len(), band.view.size.width);
        regions.find(marks, rows, width);
        firsts.clear(rows, width);
        regions.mark_first(firsts);
        layers.clear();
        layers.resize(firsts.count(), 0);
        band.for_each_face(stripes, firsts, 1, [0..rows, 0..width], |face, face_box| {
            // One too many does no harm.
            let bounds = band.edge_error_bounds(face);
            band.for_each_block(firsts, 1, face_box, |marked, column, a| {
                layers[marked.rank(column)] += u32::from((0..3).all(|k| a[k] >= -bounds[k]));
            });
            true
        });
        // Surfaces meet only where there are two.
        if layers.iter().all(|&layers| layers < 2) {
            return;
        }
        // The first pixels are not needed any more.
        let suspects = firsts;
        suspects.clear(rows, width);
        regions.mark_all(layers, suspects);
        // Blocks first: in most the layers are far apart.
        blocks.clear(rows, width / BLOCK);
        blocks.mark_whole_blocks(suspects);
        // No edge of the outline is near.
        let no_outline = 0;
        faces_by_pixel.for_each(band, stripes, blocks, BLOCK, |[row, block], center, faces| {
            intervals.clear();
            intervals.extend(faces.iter().map(|&face| planes.interval(band, face, center, BLOCK)));
            if !may_cross(intervals, |face| planes.in_block(band, face, no_outline, center, BLOCK))
            {
                suspects.unmark(row, block * BLOCK..(block + 1) * BLOCK);
            }
        });
        faces_by_pixel.for_each(band, stripes, suspects, 1, |[row, column], center, faces| {
            intervals.clear();
            intervals.extend(faces.iter().map(|&face| planes.interval(band, face, center, 1)));
            if may_cross(intervals, |face| planes.in_block(band, face, no_outline, center, 1)) {
                marks.mark(row, column..column + 1);
            }
        });
    }

    /// Resolves a pixel of the band.
    #[inline(always)]
    fn resolve<T: Scalar<Wide = S>>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        [row, column]: [usize; 2],
        center: [S; 2],
        faces: &[u32],
        pieces: &mut Pieces<S>,
    ) {
        let Self { planes, face_bits, intervals, resolution, .. } = self;
        let pixel = ((band.rows.start + row) * band.view.size.width + column) as u32;
        intervals.clear();
        intervals.extend(faces.iter().map(|&face| planes.interval(band, face, center, 1)));
        let in_pixel = |face| planes.in_block(band, face, face_bits[face as usize], center, 1);
        // All edges lie behind a single layer that fills the pixel.
        if front_layers(intervals, in_pixel) == Some(1) {
            return;
        }
        intervals.retain(|interval| !interval.is_out());
        let candidate =
            |face: u32| band.candidate(face, face_bits[face as usize], center, planes.known(face));
        resolution.run(band, pixel, intervals, candidate, pieces);
    }
}

/// Marks the pixels that the edges `own` of a face may cross.
#[inline(always)]
fn mark_edges<T: Scalar>(
    marks: &mut PixelMask,
    band: &BandFaces<'_, '_, T>,
    index: u32,
    own: FaceBits,
) {
    let (view, edges) = (band.view, band.edges(index));
    let mut rest = own;
    while rest != 0 {
        let corner = rest.trailing_zeros() as usize;
        rest &= rest - 1;
        let [rows, columns] = band.reach_of_edge(index, corner);
        let [one, x, y] = edges[corner];
        let start = one + x * view.centers[0];
        for row in rows {
            let line = [start + y * view.ys[row], x, y];
            marks.mark(row - band.rows.start, near_line(line, columns.clone()));
        }
    }
}

/// The range of `columns` in whose pixels of a row a line passes, and perhaps a few more columns. The
/// line has the value `start` at the centre of column 0 of the row. It changes by `x` with X and by
/// `y` with Y.
#[inline(always)]
fn near_line<S: Scalar>([start, x, y]: Line<S>, columns: Range<usize>) -> Range<usize> {
    let reach = S::from_f64(REACH) * (x.abs() + y.abs());
    if x == S::ZERO {
        return if start.abs() <= reach { columns } else { 0..0 };
    }
    // |start + x X| <= reach; columns are two units wide.
    let (center, half) = (-0.5 * (start / x).to_f64(), 0.5 * (reach / x).to_f64().abs());
    let first = (center - half).ceil().max(columns.start as f64);
    let end = ((center + half).floor() + 1.0).min(columns.end as f64);
    first as usize..end.max(0.0) as usize
}
