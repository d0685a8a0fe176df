//! Neighbouring pixels that see different faces, at least one of them a face with a silhouette.
//!
//! Each run of such a face is held against its neighbours on all four sides; within a run there are
//! no pairs. So the cost is that of these runs and of the pairs, not of the pixels.

use std::ops::Range;

use crate::coverage::{Coverage, Span};
use crate::size::Size;

/// A pixel and its right or its lower neighbour, which see different faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) pixel: usize,
    /// Whether the other pixel is the one below, not the one on the right.
    pub(super) below: bool,
    /// The faces, where the pixels are covered.
    pub(super) faces: [Option<usize>; 2],
}

impl Pair {
    /// Both pixels.
    pub(super) fn pixels(&self, size: Size) -> [usize; 2] {
        [self.pixel, self.pixel + if self.below { size.width } else { 1 }]
    }
}

/// Calls `visit` once with each pair of which one pixel lies in `slots` and sees a face with
/// `has_silhouette`; of two such pixels it is the first one's slot that counts.
pub(super) fn for_each_pair(
    coverage: &Coverage,
    slots: Range<usize>,
    has_silhouette: &[bool],
    mut visit: impl FnMut(Pair),
) {
    let Size { width, height } = coverage.size();
    let counts_itself = |span: &Option<Span>| span.as_ref().is_some_and(|s| has_silhouette[s.slot]);
    for slot in slots.filter(|&slot| has_silhouette[slot]) {
        for span in coverage.spans_of(slot) {
            let (pixels, own) = (span.pixels(), Some(span.face));
            let [row, column] = coverage.size().place(span.pixel);
            if column > 0 {
                let pixel = span.pixel - 1;
                let other = coverage.span_at(pixel);
                if !counts_itself(&other) {
                    let faces = [other.map(|other| other.face), own];
                    visit(Pair { pixel, below: false, faces });
                }
            }
            if column + pixels.len() < width {
                let other = coverage.span_at(pixels.end);
                let faces = [own, other.map(|other| other.face)];
                visit(Pair { pixel: pixels.end - 1, below: false, faces });
            }
            if row > 0 {
                let above = pixels.start - width..pixels.end - width;
                for_each_stretch(coverage, above, |stretch, other| {
                    let faces = [other.as_ref().map(|other| other.face), own];
                    if faces[0] != own && !counts_itself(&other) {
                        stretch.for_each(|pixel| visit(Pair { pixel, below: true, faces }));
                    }
                });
            }
            if row + 1 < height {
                let below = pixels.start + width..pixels.end + width;
                for_each_stretch(coverage, below, |stretch, other| {
                    let faces = [own, other.map(|other| other.face)];
                    if faces[1] != own {
                        let above = stretch.start - width..stretch.end - width;
                        above.for_each(|pixel| visit(Pair { pixel, below: true, faces }));
                    }
                });
            }
        }
    }
}

/// Cuts pixels of a row into stretches that see one face, or none.
#[inline]
fn for_each_stretch(
    coverage: &Coverage,
    pixels: Range<usize>,
    mut visit: impl FnMut(Range<usize>, Option<Span>),
) {
    let mut start = pixels.start;
    for span in coverage.row_from(start) {
        if span.pixel >= pixels.end {
            break;
        }
        if start < span.pixel {
            visit(start..span.pixel, None);
        }
        let end = span.pixels().end.min(pixels.end);
        visit(start.max(span.pixel)..end, Some(span));
        start = end;
    }
    if start < pixels.end {
        visit(start..pixels.end, None);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use bokashi_core::{Tape, Tensor};
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;

    /// All pairs of different faces, at least one of those in `counting`, by looking at each pixel.
    fn expected(coverage: &Coverage, counting: &BTreeSet<usize>) -> BTreeSet<(usize, bool)> {
        let Size { width, height } = coverage.size();
        let mut pairs = BTreeSet::new();
        for pixel in 0..width * height {
            for (below, step) in [(false, 1), (true, width)] {
                let is_last =
                    if below { pixel / width + 1 == height } else { pixel % width + 1 == width };
                if is_last {
                    continue;
                }
                let faces = [pixel, pixel + step].map(|pixel| coverage.face_at(pixel));
                let counts = faces.iter().flatten().any(|face| counting.contains(face));
                if faces[0] != faces[1] && counts {
                    pairs.insert((pixel, below));
                }
            }
        }
        pairs
    }

    proptest! {
        #[test]
        fn every_pair_is_visited_once(
            corners in proptest::collection::vec((-1.5..1.5, -1.5..1.5, -0.5..0.5), 12),
            width in 1_usize..12,
            height in 1_usize..12,
            counting in proptest::collection::btree_set(0_usize..4, 0..4),
        ) {
            let tape = Tape::<f64>::new();
            let clip = corners.iter().flat_map(|&(x, y, z)| [x, y, z, 1.0]).collect();
            let clip = tape.leaf(&Tensor::new([12, 4], clip).unwrap());
            let mesh = Mesh::new((0..4).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), 12);
            let fragments = rasterize(clip, &mesh.unwrap(), Size { width, height }).unwrap();
            let coverage = &fragments.coverage;
            let counts: Vec<_> = coverage
                .slots
                .iter()
                .map(|slot| counting.contains(&(slot.face as usize)))
                .collect();
            let mut found = BTreeSet::new();
            for_each_pair(coverage, 0..coverage.slots.len(), &counts, |pair| {
                let pixels = pair.pixels(coverage.size());
                assert_eq!(pair.faces, pixels.map(|pixel| coverage.face_at(pixel)));
                assert!(found.insert((pair.pixel, pair.below)), "{pair:?} twice");
            });
            prop_assert_eq!(found, expected(coverage, &counting));
        }
    }
}
