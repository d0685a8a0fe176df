//! Which faces may reach into which marked pixels.

use std::ops::Range;

use bokashi_core::Scalar;

use super::drawn::Drawn;
use super::marks::Marks;
use crate::rasterize::canvas::sum_up;

/// More pairs of a block and a face are not gathered at once, but for those of one row.
const MOST_PAIRS: usize = 1 << 22;

/// The faces that may reach into some pixels, or blocks of them.
#[derive(Debug, Default)]
pub(super) struct Gathered {
    /// Blocks, by their number among them, with faces.
    pairs: Vec<[u32; 2]>,
    /// Where in `faces` those of each block end.
    ends: Vec<u32>,
    faces: Vec<u32>,
    /// The row and the column of each block.
    blocks: Vec<[usize; 2]>,
    /// Rows that are still to be gathered, the next ones last.
    open: Vec<Range<usize>>,
}

impl Gathered {
    /// Finds those of the marked blocks of `block` pixels in some rows of the band; returns whether
    /// they are not too many.
    #[inline(always)]
    fn find<T: Scalar>(
        &mut self,
        drawn: &Drawn<'_, '_, T>,
        marks: &Marks,
        block: usize,
        rows: Range<usize>,
    ) -> bool {
        let first = marks.count_before(rows.start);
        let count = marks.count_before(rows.end) - first;
        let most = if rows.len() > 1 { MOST_PAIRS } else { usize::MAX };
        let Self { pairs, ends, faces, .. } = self;
        pairs.clear();
        ends.clear();
        ends.resize(count + 1, 0);
        drawn.for_each_face(marks, block, rows, |face, number, a, reach| {
            if (0..3).all(|k| a[k] + reach[k] >= T::Wide::ZERO) {
                pairs.push([(number - first) as u32, face]);
                ends[number - first + 1] += 1;
            }
            pairs.len() <= most
        });
        if pairs.len() > most {
            return false;
        }
        sum_up(ends);
        faces.clear();
        faces.resize(pairs.len(), 0);
        // Where the next face of each block goes; in the end, where its last one went.
        for &[number, face] in pairs.iter() {
            let place = &mut ends[number as usize];
            faces[*place as usize] = face;
            *place += 1;
        }
        true
    }

    /// Calls `visit` with the row and the column of each marked block of `block` pixels of a row, with
    /// its centre, and with the faces that may reach into it.
    #[inline(always)]
    pub(super) fn for_each<T: Scalar>(
        &mut self,
        drawn: &Drawn<'_, '_, T>,
        marks: &mut Marks,
        block: usize,
        mut visit: impl FnMut([usize; 2], [T::Wide; 2], &[u32]),
    ) {
        marks.count();
        self.open.push(0..drawn.rows.len());
        while let Some(rows) = self.open.pop() {
            if !self.find(drawn, marks, block, rows.clone()) {
                let middle = rows.start + rows.len() / 2;
                self.open.extend([middle..rows.end, rows.start..middle]);
                continue;
            }
            let mut found = std::mem::take(&mut self.blocks);
            found.clear();
            for row in rows {
                marks.for_each(row, |column| found.push([row, column]));
            }
            for (at, &[row, column]) in found.iter().enumerate() {
                let center = [drawn.center(column, block), drawn.view.ys[drawn.rows.start + row]];
                visit([row, column], center, self.faces_of(at));
            }
            self.blocks = found;
        }
    }

    /// The faces of the marked block `at`, in their order.
    fn faces_of(&self, at: usize) -> &[u32] {
        let first = at.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.faces[first as usize..self.ends[at] as usize]
    }
}
