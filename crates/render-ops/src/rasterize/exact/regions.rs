//! Regions of pixels that no edge of the surface crosses.
//!
//! In such a pixel each surface that is there fills it: a *surface layer*. Pixels beside each other
//! without such an edge have the same number of layers. So the pixels that are not marked fall into
//! connected regions. The layers are counted in one pixel of each region. Only regions with two layers
//! or more are searched for intersections.

use std::ops::Range;

use super::pixel_mask::PixelMask;

/// Neighbouring pixels of a row that no edge crosses.
#[derive(Debug, Clone)]
struct FreeRun {
    row: usize,
    columns: Range<usize>,
    /// The run of lower index that its region is known by; the first run of a region names itself.
    root: usize,
}

/// The regions of a band, and memory.
#[derive(Debug, Default)]
pub(super) struct Regions {
    runs: Vec<FreeRun>,
    /// Per run: whether all of it is to be marked.
    wanted: Vec<bool>,
}

impl Regions {
    /// Finds the regions of pixels that are not marked.
    pub(super) fn find(&mut self, marks: &PixelMask, rows: usize, width: usize) {
        self.runs.clear();
        let mut above = 0;
        // Union-find; the root of a region is its first run. Runs that touch one of the row above join its region:
        //
        //     row - 1   |---a---|     |----b----|      a, b, c and d are one region: b touches c and d
        //     row           |----c----|     |--d--|
        for row in 0..rows {
            let first = self.runs.len();
            marks.for_each_gap(row, width, |columns| {
                let root = self.runs.len();
                self.runs.push(FreeRun { row, columns, root });
            });
            for index in first..self.runs.len() {
                let Range { start, end } = self.runs[index].columns;
                // The last run that touches this run may touch the next run, too.
                while above < first && self.runs[above].columns.end <= start {
                    above += 1;
                }
                let mut other = above;
                while other < first && self.runs[other].columns.start < end {
                    self.join(other, index);
                    other += 1;
                }
            }
            above = first;
        }
    }

    fn root(&mut self, mut index: usize) -> usize {
        while self.runs[index].root != index {
            let next = self.runs[index].root;
            // Halves the way for the next time.
            self.runs[index].root = self.runs[next].root;
            index = next;
        }
        index
    }

    fn join(&mut self, one: usize, other: usize) {
        let (one, other) = (self.root(one), self.root(other));
        self.runs[one.max(other)].root = one.min(other);
    }

    /// Marks the first pixel of each region.
    pub(super) fn mark_first(&self, marks: &mut PixelMask) {
        for (index, run) in self.runs.iter().enumerate() {
            if run.root == index {
                marks.mark(run.row, run.columns.start..run.columns.start + 1);
            }
        }
    }

    /// Marks all pixels of the regions that hold several surface layers, as the regions are numbered.
    pub(super) fn mark_all(&mut self, layers: &[u32], marks: &mut PixelMask) {
        // Roots come before what they are the roots of.
        let mut wanted = std::mem::take(&mut self.wanted);
        wanted.clear();
        let mut regions = layers.iter();
        for index in 0..self.runs.len() {
            let root = self.root(index);
            let is_wanted = if root == index {
                *regions.next().expect("each region has a first pixel") > 1
            } else {
                wanted[root]
            };
            wanted.push(is_wanted);
            if is_wanted {
                let FreeRun { row, columns, .. } = self.runs[index].clone();
                marks.mark(row, columns);
            }
        }
        self.wanted = wanted;
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn regions_are_what_a_flood_reaches(
            marked in proptest::collection::vec(any::<bool>(), 1..80),
            width in 1..9_usize,
        ) {
            let rows = marked.len().div_ceil(width);
            let is_free = |at: usize| at < rows * width && !marked.get(at).unwrap_or(&true);
            let mut marks = PixelMask::default();
            marks.clear(rows, width);
            (0..rows * width).filter(|&at| !is_free(at)).for_each(|at| {
                marks.mark(at / width, at % width..at % width + 1);
            });
            let mut regions = Regions::default();
            regions.find(&marks, rows, width);
            let mut firsts = PixelMask::default();
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
                let mut all = PixelMask::default();
                all.clear(rows, width);
                let layers: Vec<_> = (0..count).map(|at| 1 + u32::from(at == wanted)).collect();
                regions.mark_all(&layers, &mut all);
                let mut found = Vec::new();
                for row in 0..rows {
                    all.for_each(row, |column| found.push(row * width + column));
                }
                let expected = (0..rows * width).filter(|&at| region_of[at] == wanted);
                prop_assert!(found.into_iter().eq(expected));
            }
        }
    }
}
