//! Sheets of surfaces: where they may pass through each other between their edges, and which of them
//! lie before all others.
//!
//! In a pixel that no edge of the surface crosses, each surface that is in it fills it: a *sheet*.
//! Pixels beside each other without such an edge hold the same number of sheets, so that number is
//! found for one pixel of each region of such pixels. Only regions of two and more are looked at pixel
//! by pixel.

use std::ops::Range;

use bokashi_core::Scalar;

use super::marks::Marks;

/// Lines are looked for within this many times half a pixel's width: more than they can be off.
pub(super) const REACH: f64 = 1.0 + 1e-6;

/// Neighbouring pixels of a row that no edge crosses.
#[derive(Debug, Clone)]
struct Stretch {
    row: usize,
    columns: Range<usize>,
    /// The stretch of lower index that its region is known by, itself for the first one.
    root: usize,
}

/// The regions of a band, and memory.
#[derive(Debug, Default)]
pub(super) struct Regions {
    stretches: Vec<Stretch>,
    /// Per stretch: whether all of it is to be marked.
    wanted: Vec<bool>,
}

impl Regions {
    /// Finds the regions of pixels that are not marked.
    pub(super) fn find(&mut self, marks: &Marks, rows: usize, width: usize) {
        self.stretches.clear();
        let mut above = 0;
        for row in 0..rows {
            let first = self.stretches.len();
            let mut start = 0;
            let mut add = |end: usize, next: usize| {
                if start < end {
                    let root = self.stretches.len();
                    self.stretches.push(Stretch { row, columns: start..end, root });
                }
                start = next;
            };
            marks.for_each(row, |column| add(column, column + 1));
            add(width, width);
            for at in first..self.stretches.len() {
                let Range { start, end } = self.stretches[at].columns;
                // The last one that touches this stretch may touch the next one, too.
                while above < first && self.stretches[above].columns.end <= start {
                    above += 1;
                }
                let mut other = above;
                while other < first && self.stretches[other].columns.start < end {
                    self.join(other, at);
                    other += 1;
                }
            }
            above = first;
        }
    }

    fn root(&mut self, mut at: usize) -> usize {
        while self.stretches[at].root != at {
            let next = self.stretches[at].root;
            self.stretches[at].root = self.stretches[next].root;
            at = next;
        }
        at
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.root(one), self.root(other));
        self.stretches[one.max(other)].root = one.min(other);
    }

    /// Marks the first pixel of each region.
    pub(super) fn mark_first(&self, marks: &mut Marks) {
        for (at, stretch) in self.stretches.iter().enumerate() {
            if stretch.root == at {
                marks.mark(stretch.row, stretch.columns.start..stretch.columns.start + 1);
            }
        }
    }

    /// Marks all pixels of the regions that hold several of `sheets`, as the regions are numbered.
    pub(super) fn mark_all(&mut self, sheets: &[u32], marks: &mut Marks) {
        // Roots come before what they are the roots of.
        let mut wanted = std::mem::take(&mut self.wanted);
        wanted.clear();
        let mut regions = sheets.iter();
        for at in 0..self.stretches.len() {
            let root = self.root(at);
            let is_wanted = if root == at {
                *regions.next().expect("each region has a first pixel") > 1
            } else {
                wanted[root]
            };
            wanted.push(is_wanted);
            if is_wanted {
                let Stretch { row, columns, .. } = self.stretches[at].clone();
                marks.mark(row, columns);
            }
        }
        self.wanted = wanted;
    }
}

/// A face in a block of pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slab<S> {
    /// The position of its face among those of the band.
    pub(super) drawn: u32,
    /// The range of its depths, and a little more.
    pub(super) nearest: S,
    pub(super) farthest: S,
    /// Whether it covers the block's centre, or may.
    pub(super) covers: bool,
    /// Whether an edge of the surface's outline may cross the block in it.
    pub(super) ends: bool,
}

impl<S: Scalar> Slab<S> {
    /// Whether nothing of it lies in the depth range.
    pub(super) fn is_out(&self) -> bool {
        self.farthest < -S::ONE || self.nearest > S::ONE
    }
}

/// How many sheets these faces make up in a block of pixels before all that lies behind them, where
/// they are whole: those of one sheet touch, so the nearest faces up to the first gap between all
/// their depths are whole sheets if none of them ends here, and a sheet covers the block's centre once.
/// What is out of the depth range hides nothing; where something may reach out of it, none can be
/// told. Sorts them, the nearest first.
pub(super) fn front_sheets<S: Scalar>(slabs: &mut [Slab<S>]) -> Option<usize> {
    slabs.sort_unstable_by(|a, b| a.nearest.to_f64().total_cmp(&b.nearest.to_f64()));
    let (mut farthest, mut sheets) = (-S::from_f64(f64::INFINITY), 0);
    for slab in slabs.iter().filter(|slab| !slab.is_out()) {
        if slab.nearest > farthest && sheets > 0 {
            break;
        }
        if slab.ends || slab.nearest < -S::ONE || slab.farthest > S::ONE {
            return None;
        }
        farthest = farthest.maximum_or_nan(slab.farthest);
        sheets += usize::from(slab.covers);
    }
    Some(sheets)
}

/// Parts sorted slabs where there is a gap between all depths before and all those behind.
pub(super) fn layers<S: Scalar>(slabs: &[Slab<S>]) -> impl Iterator<Item = &[Slab<S>]> {
    let mut farthest = -S::from_f64(f64::INFINITY);
    slabs.chunk_by(move |slab, next| {
        farthest = farthest.maximum_or_nan(slab.farthest);
        next.nearest <= farthest
    })
}

/// Whether two of the sheets that these faces make up may pass through each other before all others.
pub(super) fn may_cross<S: Scalar>(slabs: &mut [Slab<S>]) -> bool {
    front_sheets(slabs).is_none_or(|sheets| sheets > 1)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn slab([nearest, depth]: [f64; 2]) -> Slab<f64> {
        Slab { drawn: 0, nearest, farthest: nearest + depth, covers: true, ends: false }
    }

    proptest! {
        /// Ranges of integers, so that some only touch.
        #[test]
        fn between_layers_there_is_a_gap_and_in_none(
            ranges in proptest::collection::vec([0..30_u8, 0..4_u8], 0..12),
        ) {
            let mut slabs: Vec<_> = ranges.iter().map(|range| slab(range.map(f64::from))).collect();
            slabs.sort_by(|a, b| a.nearest.total_cmp(&b.nearest));
            let ranges = |slabs: &[Slab<f64>]| -> Vec<_> {
                slabs.iter().map(|slab| [slab.nearest, slab.farthest]).collect()
            };
            prop_assert_eq!(layers(&slabs).flat_map(ranges).collect::<Vec<_>>(), ranges(&slabs));
            let is_filled = |depth: f64| slabs.iter().any(|s| s.nearest <= depth && depth <= s.farthest);
            let mut before = f64::NEG_INFINITY;
            for layer in layers(&slabs) {
                let farthest = layer.iter().fold(f64::NEG_INFINITY, |most, s| most.max(s.farthest));
                prop_assert!(before < layer[0].nearest);
                // Halves of integers tell all gaps.
                let mut depth = layer[0].nearest;
                while depth <= farthest {
                    prop_assert!(is_filled(depth));
                    depth += 0.5;
                }
                before = farthest;
            }
        }

        #[test]
        fn regions_are_what_a_flood_reaches(
            marked in proptest::collection::vec(any::<bool>(), 1..80),
            width in 1..9_usize,
        ) {
            let rows = marked.len().div_ceil(width);
            let is_free = |at: usize| at < rows * width && !marked.get(at).unwrap_or(&true);
            let mut marks = Marks::default();
            marks.clear(rows, width);
            (0..rows * width).filter(|&at| !is_free(at)).for_each(|at| {
                marks.mark(at / width, at % width..at % width + 1);
            });
            let mut regions = Regions::default();
            regions.find(&marks, rows, width);
            let mut firsts = Marks::default();
            firsts.clear(rows, width);
            regions.mark_first(&mut firsts);
            // A flood from each pixel that no earlier one has reached.
            let mut region_of = vec![usize::MAX; rows * width];
            let mut count = 0;
            for at in (0..rows * width).filter(|&at| is_free(at)) {
                if region_of[at] != usize::MAX {
                    continue;
                }
                let mut open = vec![at];
                while let Some(at) = open.pop() {
                    if !is_free(at) || std::mem::replace(&mut region_of[at], count) == count {
                        continue;
                    }
                    let column = at % width;
                    open.extend((column > 0).then(|| at - 1));
                    open.extend((column + 1 < width).then(|| at + 1));
                    open.extend(at.checked_sub(width));
                    open.push(at + width);
                }
                count += 1;
            }
            prop_assert_eq!(firsts.count(), count);
            for wanted in 0..count {
                let mut all = Marks::default();
                all.clear(rows, width);
                let sheets: Vec<_> = (0..count).map(|at| 1 + u32::from(at == wanted)).collect();
                regions.mark_all(&sheets, &mut all);
                all.count();
                let mut found = Vec::new();
                for row in 0..rows {
                    all.for_each_in(row, 0..width, |column, _| found.push(row * width + column));
                }
                let expected = (0..rows * width).filter(|&at| region_of[at] == wanted);
                prop_assert!(found.into_iter().eq(expected));
            }
        }
    }
}
