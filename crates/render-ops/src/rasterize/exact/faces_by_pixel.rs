//! Which faces may reach into which marked pixels.

use std::ops::Range;

use bokashi_core::Scalar;

use super::band_faces::BandFaces;
use super::pixel_mask::PixelMask;
use crate::rasterize::prepared::sum_up;

/// More pairs of a block and a face are not gathered at once, but for those of one block.
const MOST_PAIRS: usize = 1 << 22;

/// The faces that may reach into some pixels, or blocks of them.
#[derive(Debug, Default)]
pub(super) struct FacesByPixel {
    /// Blocks, by their number among them, with faces.
    pairs: Vec<[u32; 2]>,
    /// Where in `faces` those of each block end.
    ends: Vec<u32>,
    faces: Vec<u32>,
    /// The row and the column of each marked block.
    blocks: Vec<[usize; 2]>,
    /// Ranges of marked blocks that are still to be gathered, the next range last.
    open: Vec<Range<usize>>,
}

impl FacesByPixel {
    /// Finds those of the marked blocks `some`, of `block` pixels of a row; returns whether they are not
    /// too many.
    #[inline(always)]
    fn find<T: Scalar>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        stripes: &[u64],
        marks: &PixelMask,
        block: usize,
        some: Range<usize>,
    ) -> bool {
        let Self { pairs, ends, faces, blocks, .. } = self;
        let ([top, left], [bottom, right]) = (blocks[some.start], blocks[some.end - 1]);
        let columns = if top == bottom { left..right + 1 } else { 0..usize::MAX };
        let most = if some.len() > 1 { MOST_PAIRS } else { usize::MAX };
        pairs.clear();
        ends.clear();
        ends.resize(some.len() + 1, 0);
        band.for_each_face(
            stripes,
            marks,
            block,
            [top..bottom + 1, columns],
            #[inline(always)]
            |face, face_box| {
                let reach = face_box.reach;
                band.for_each_block(
                    marks,
                    block,
                    face_box,
                    #[inline(always)]
                    |marked, column, a| {
                        let reaches = |k: usize| a[k] + reach[k] >= T::Wide::ZERO;
                        if !(reaches(0) & reaches(1) & reaches(2)) {
                            return;
                        }
                        let number = marked.rank(column);
                        if some.contains(&number) {
                            pairs.push([(number - some.start) as u32, face]);
                            ends[number - some.start + 1] += 1;
                        }
                    },
                );
                pairs.len() <= most
            },
        );
        if pairs.len() > most {
            return false;
        }
        sum_up(ends);
        faces.clear();
        faces.resize(pairs.len(), 0);
        // Where the next face of each block goes; in the end, where its last one went.
        for &[number, face] in pairs.iter() {
            let position = &mut ends[number as usize];
            faces[*position as usize] = face;
            *position += 1;
        }
        true
    }

    /// Calls `visit` with the row and the column of each marked block of `block` pixels of a row, with
    /// its centre, and with the faces that may reach into it. `stripes` are those of each face.
    #[inline(always)]
    pub(super) fn for_each<T: Scalar>(
        &mut self,
        band: &BandFaces<'_, '_, T>,
        stripes: &[u64],
        marks: &mut PixelMask,
        block: usize,
        mut visit: impl FnMut([usize; 2], [T::Wide; 2], &[u32]),
    ) {
        if marks.count() == 0 {
            return;
        }
        self.blocks.clear();
        for row in 0..band.rows.len() {
            marks.for_each(
                row,
                #[inline(always)]
                |column| self.blocks.push([row, column]),
            );
        }
        self.open.push(0..self.blocks.len());
        while let Some(some) = self.open.pop() {
            if !self.find(band, stripes, marks, block, some.clone()) {
                // The first half is on top, so blocks are visited in their order.
                let middle = some.start + some.len() / 2;
                self.open.extend([middle..some.end, some.start..middle]);
                continue;
            }
            for index in some.clone() {
                let [row, column] = self.blocks[index];
                let center = [band.center(column, block), band.view.ys[band.rows.start + row]];
                visit([row, column], center, self.faces_of(index - some.start));
            }
        }
    }

    /// The faces of block `index` of those that were found, in their order.
    fn faces_of(&self, index: usize) -> &[u32] {
        let first = index.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.faces[first as usize..self.ends[index] as usize]
    }
}
