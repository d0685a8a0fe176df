//! Which faces cover which pixels, as runs.
//!
//! Neighbouring pixels of a row mostly see one face: a *run*. Coverage is stored as runs alone, so
//! that what lies between them costs nothing. Rows are grouped into *bands*; the faces that are
//! seen in a band have a *slot* each, in the order of their first pixels. Fragments are ordered by slot,
//! and within a slot by pixel: so the fragments of a face in a band lie side by side in memory, work
//! on the face is prepared once for all of them, and a backward pass sums over them before it adds
//! to the face's vertices. Bands are cut by the image's size alone.

use std::ops::Range;

use bokashi_core::parallel::{for_each_item_mut, is_shared};

use crate::boundary::{Boundary, BoundaryCounts};
use crate::error::RenderError;
use crate::mesh::Mesh;
use crate::size::Size;

/// Which faces cover which pixels: whole numbers, so not differentiable by type.
#[derive(Debug, Clone)]
pub struct Coverage {
    pub(crate) mesh: Mesh,
    pub(crate) size: Size,
    pub(crate) culled: Culled,
    /// The runs, in the order of their fragments.
    pub(crate) runs: Vec<Run>,
    /// The indices of the runs in the order of their pixels.
    pub(crate) by_pixel: Vec<u32>,
    /// Where in `by_pixel` each row starts, and at the end its length.
    pub(crate) row_starts: Vec<u32>,
    pub(crate) slots: Vec<Slot>,
    /// The covered pixels as ranges, from each first one to before the end, in order.
    pub(crate) covered: Vec<[u32; 2]>,
    /// Where in `slots` each band ends, from the top: of the fragments at pixel centres, and with
    /// exact coverage again of the pieces of boundary pixels.
    pub(crate) band_ends: Vec<u32>,
    /// How many of the bands are of pixel centres.
    pub(crate) center_bands: usize,
    /// The number of fragments at pixel centres.
    pub(crate) centers: usize,
    /// The number of fragments.
    pub(crate) count: usize,
    pub(crate) boundary: Boundary,
    /// Per face of the mesh, drawn or not: the sign of its area as it is seen, y up; 0 where it is
    /// zero within rounding, or where that side is culled.
    pub(crate) orientations: Vec<i8>,
}

/// How many faces were not drawn, and why.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Culled {
    /// Faces whose area is zero within rounding, or that repeat a vertex.
    pub degenerate: usize,
    /// Faces wholly outside the view: beside the image, behind the eye, or outside the depth range.
    pub outside: usize,
    /// Faces that turn the side away that [`Cull`](crate::Cull) names.
    pub facing: usize,
}

/// A face that is seen in a band.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slot {
    pub(crate) face: u32,
    /// The first of its runs in the band; the next slot's first run is one after the last.
    pub(crate) first_run: u32,
}

/// Neighbouring fragments of a row that lie on one face.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Run {
    /// The slot of the face.
    pub(crate) slot: u32,
    /// The first pixel.
    pub(crate) pixel: u32,
    /// The first fragment; the next run's first fragment is one after the last.
    pub(crate) fragment: u32,
}

/// A run with what it refers to.
#[derive(Debug, Clone)]
pub(crate) struct Span {
    pub(crate) slot: usize,
    /// The index of the face.
    pub(crate) face: usize,
    /// The first pixel.
    pub(crate) pixel: usize,
    pub(crate) fragments: Range<usize>,
}

impl Span {
    /// The pixels.
    pub(crate) fn pixels(&self) -> Range<usize> {
        self.pixel..self.pixel + self.fragments.len()
    }
}

impl Coverage {
    /// The coverage of nothing.
    pub(crate) fn empty(mesh: Mesh, size: Size) -> Self {
        Self {
            mesh,
            size,
            culled: Culled::default(),
            runs: Vec::new(),
            by_pixel: Vec::new(),
            row_starts: Vec::new(),
            slots: Vec::new(),
            covered: Vec::new(),
            band_ends: Vec::new(),
            center_bands: 0,
            centers: 0,
            count: 0,
            boundary: Boundary::default(),
            orientations: Vec::new(),
        }
    }

    /// The number of fragments, N.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The mesh that was rasterized.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// The size of the image.
    pub fn size(&self) -> Size {
        self.size
    }

    /// The index of each fragment's face.
    pub fn faces(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        self.spans().flat_map(|span| std::iter::repeat_n(span.face, span.fragments.len()))
    }

    /// Each fragment's pixel, `row * width + column`.
    pub fn pixels(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        self.spans().flat_map(|span| span.pixels())
    }

    /// The fragment of `pixel`, where it is covered, of several the largest piece. Nothing covers a
    /// pixel outside the image.
    pub fn fragment_at(&self, pixel: usize) -> Option<usize> {
        let Boundary { pixels, .. } = &self.boundary;
        let at = u32::try_from(pixel).ok().and_then(|pixel| pixels.binary_search(&pixel).ok());
        match at {
            Some(at) => self.boundary.fragments_of(at).first().map(|&fragment| fragment as usize),
            None => self.span_at(pixel).map(|span| span.fragments.start + pixel - span.pixel),
        }
    }

    /// The face that `pixel` sees, where it is covered, of several that of the largest piece.
    pub fn face_at(&self, pixel: usize) -> Option<usize> {
        let fragment = self.fragment_at(pixel)?;
        let after = self.runs.partition_point(|run| run.fragment as usize <= fragment);
        Some(self.span(after - 1).face)
    }

    /// Per pixel, row by row from the top: the index of its face plus 1, or 0 for the background; of
    /// several faces that of the largest piece.
    pub fn triangle_ids(&self) -> Vec<u32> {
        let mut ids = vec![0; self.size.pixels()];
        self.center_spans().for_each(|span| ids[span.pixels()].fill(span.face as u32 + 1));
        for &pixel in self.boundary.pixels.iter() {
            let face = self.face_at(pixel as usize);
            ids[pixel as usize] = face.map_or(0, |face| face as u32 + 1);
        }
        ids
    }

    /// The pixels that exact coverage has resolved into pieces, in order, each with its fragments,
    /// the largest piece first; where nothing is seen in one, it has none. Of other pixels each has
    /// one fragment or none.
    pub fn boundary(&self) -> impl Iterator<Item = (usize, &[u32])> + Clone + '_ {
        self.boundary.iter()
    }

    /// Whether boundary pixels were resolved, if there were any.
    pub(crate) fn is_exact(&self) -> bool {
        self.band_ends.len() > self.center_bands
    }

    /// # Errors
    /// [`RenderError::ExactCoverage`] for anything but fragments at pixel centres.
    pub(crate) fn check_centers(&self, operation: &'static str) -> Result<(), RenderError> {
        let pixels = self.boundary.pixels.len();
        if self.is_exact() {
            return Err(RenderError::ExactCoverage { operation, pixels });
        }
        Ok(())
    }

    /// How the pixels of [`Coverage::boundary`] were resolved.
    pub fn boundary_counts(&self) -> BoundaryCounts {
        self.boundary.counts
    }

    /// The number of fragments at pixel centres: they come before the pieces of boundary pixels.
    pub fn centers(&self) -> usize {
        self.centers
    }

    /// How many faces were not drawn, and why.
    pub fn culled(&self) -> Culled {
        self.culled
    }

    /// The run that covers the centre of `pixel`.
    fn span_at(&self, pixel: usize) -> Option<Span> {
        if pixel >= self.size.pixels() {
            return None;
        }
        let [row, _] = self.size.place(pixel);
        let runs = &self.by_pixel[self.row(row)];
        let after = runs.partition_point(|&run| self.runs[run as usize].pixel as usize <= pixel);
        let span = self.span(runs[after.checked_sub(1)?] as usize);
        span.pixels().contains(&pixel).then_some(span)
    }

    /// Run `at`.
    #[inline(always)]
    pub(crate) fn span(&self, at: usize) -> Span {
        let run = self.runs[at];
        let slot = run.slot as usize;
        Span {
            slot,
            face: self.slots[slot].face as usize,
            pixel: run.pixel as usize,
            fragments: run.fragment as usize..self.fragments_before(at + 1),
        }
    }

    /// The runs, in the order of their fragments.
    pub(crate) fn spans(&self) -> impl Iterator<Item = Span> + Clone + '_ {
        (0..self.runs.len()).map(|at| self.span(at))
    }

    /// The runs at pixel centres, in the order of their fragments.
    pub(crate) fn center_spans(&self) -> impl Iterator<Item = Span> + Clone + '_ {
        (0..self.by_pixel.len()).map(|at| self.span(at))
    }

    /// The pieces of boundary pixels, runs of one pixel each, in the order of their fragments.
    pub(crate) fn piece_spans(&self) -> impl Iterator<Item = Span> + Clone + '_ {
        (self.by_pixel.len()..self.runs.len()).map(|at| self.span(at))
    }

    /// The runs of a row, from the left, for [`Coverage::span_in_row`].
    #[inline(always)]
    pub(crate) fn row(&self, row: usize) -> Range<usize> {
        self.row_starts[row] as usize..self.row_starts[row + 1] as usize
    }

    /// Run `at` in the order of pixels.
    #[inline(always)]
    pub(crate) fn span_in_row(&self, at: usize) -> Span {
        self.span(self.by_pixel[at] as usize)
    }

    /// The runs of some of slot `slot`'s fragments.
    #[inline(always)]
    pub(crate) fn spans_within(
        &self,
        slot: usize,
        fragments: Range<usize>,
    ) -> impl Iterator<Item = Span> + '_ {
        self.spans_of(slot)
            .map(move |mut span| {
                let first = span.fragments.start;
                span.fragments = first.max(fragments.start)..span.fragments.end.min(fragments.end);
                span.pixel += span.fragments.start - first;
                span
            })
            .filter(|span| !span.fragments.is_empty())
    }

    /// The runs of slot `slot`.
    #[inline(always)]
    pub(crate) fn spans_of(&self, slot: usize) -> impl Iterator<Item = Span> + '_ {
        let runs = self.slots[slot].first_run as usize..self.runs_before(slot + 1);
        runs.map(|at| self.span(at))
    }

    /// The first pixel and the length of each run of some slots.
    #[inline(always)]
    pub(crate) fn stretches_of(
        &self,
        slots: Range<usize>,
    ) -> impl Iterator<Item = (usize, usize)> + '_ {
        let runs = &self.runs[self.runs_before(slots.start)..self.runs_before(slots.end)];
        let end = self.fragments_before(self.runs_before(slots.end));
        let next = runs.iter().skip(1).map(|run| run.fragment as usize).chain([end]);
        runs.iter().zip(next).map(|(run, next)| (run.pixel as usize, next - run.fragment as usize))
    }

    /// The fragments of slot `slot`.
    #[inline(always)]
    pub(crate) fn fragments_of(&self, slot: usize) -> Range<usize> {
        let first = self.runs[self.slots[slot].first_run as usize].fragment as usize;
        first..self.fragments_before(self.runs_before(slot + 1))
    }

    /// The first pixel of slot `slot`.
    #[inline(always)]
    pub(crate) fn first_pixel_of(&self, slot: usize) -> usize {
        self.runs[self.slots[slot].first_run as usize].pixel as usize
    }

    /// The slots of some bands.
    pub(crate) fn slots_of(&self, bands: Range<usize>) -> Range<usize> {
        let before = |band: usize| band.checked_sub(1).map_or(0, |last| self.band_ends[last]);
        before(bands.start) as usize..before(bands.end) as usize
    }

    /// How many runs come before those of slot `slot`.
    #[inline(always)]
    fn runs_before(&self, slot: usize) -> usize {
        self.slots.get(slot).map_or(self.runs.len(), |slot| slot.first_run as usize)
    }

    /// All bands.
    pub(crate) fn bands(&self) -> Range<usize> {
        0..self.band_ends.len()
    }

    /// The bands of the fragments at pixel centres.
    pub(crate) fn center_bands(&self) -> Range<usize> {
        0..self.center_bands
    }

    /// Whether bands are worked on at the same time. Pieces alone make no second one: where there is
    /// one of pixel centres, there is too little to share.
    pub(crate) fn is_shared(&self) -> bool {
        is_shared(self.center_bands, 1)
    }

    /// Calls `work(slots, first, own)` for each of the first bands, with its slots, its first
    /// fragment, and the entries of its fragments in `entries: [N, width]`; bands may be worked on
    /// at the same time.
    pub(crate) fn for_each_band_mut<T: Send>(
        &self,
        bands: Range<usize>,
        width: usize,
        entries: &mut [T],
        work: impl Fn(Range<usize>, usize, &mut [T]) + Send + Sync,
    ) {
        self.merge_bands_mut(bands, width, entries, work, |()| {});
    }

    /// [`Coverage::for_each_band_mut`], with `merge` called on the results in the order of the bands.
    pub(crate) fn merge_bands_mut<T: Send, R: Send>(
        &self,
        bands: Range<usize>,
        width: usize,
        entries: &mut [T],
        work: impl Fn(Range<usize>, usize, &mut [T]) -> R + Send + Sync,
        mut merge: impl FnMut(R),
    ) {
        let mut rest = entries;
        let shared = self.is_shared();
        let bands = bands.map(|band| {
            let slots = self.slots_of(band..band + 1);
            let first = self.fragments_before(self.runs_before(slots.start));
            let end = self.fragments_before(self.runs_before(slots.end));
            let (own, others) = std::mem::take(&mut rest).split_at_mut((end - first) * width);
            rest = others;
            (slots, first, own)
        });
        if !shared {
            return bands.for_each(|(slots, first, own)| merge(work(slots, first, own)));
        }
        let mut pieces: Vec<_> = bands.map(|band| (band, None)).collect();
        for_each_item_mut(&mut pieces, |_, ((slots, first, own), result)| {
            *result = Some(work(slots.clone(), *first, own));
        });
        pieces.into_iter().filter_map(|(_, result)| result).for_each(merge);
    }

    /// How many fragments come before those of run `at`.
    #[inline(always)]
    fn fragments_before(&self, at: usize) -> usize {
        self.runs.get(at).map_or(self.count, |run| run.fragment as usize)
    }

    /// Whether the surface ends, or turns away, at the edge that faces corner `corner` of `face`: no
    /// face on its other side, or both faces on the same side of it in the image. A face seen
    /// edge-on, to within rounding, covers neither side, nor does one that is culled, so the other one
    /// ends there too.
    #[inline]
    pub(crate) fn is_silhouette(&self, face: usize, corner: usize) -> bool {
        let Some(neighbor) = self.mesh.adjacency().neighbor(face, corner) else { return true };
        neighbor.is_turned(self.orientations[face], self.orientations[neighbor.face as usize])
    }

    /// Calls `visit` with the uncovered pixels, as ranges, but for those of `rim`, which are
    /// in order.
    pub(crate) fn for_each_gap(&self, rim: &[u32], mut visit: impl FnMut(Range<usize>)) {
        let mut rim = rim.iter().map(|&pixel| pixel as usize).peekable();
        let mut start = 0;
        let mut gap = |end: usize, next: usize| {
            while let Some(pixel) = rim.next_if(|&pixel| pixel < end) {
                if start < pixel {
                    visit(start..pixel);
                }
                start = pixel + 1;
            }
            if start < end {
                visit(start..end);
            }
            start = next;
        };
        for &[start, end] in &self.covered {
            gap(start as usize, end as usize);
        }
        gap(self.size.pixels(), 0);
    }

    /// The bytes that it holds, for reports.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.runs.as_slice())
            + size_of_val(self.by_pixel.as_slice())
            + size_of_val(self.row_starts.as_slice())
            + size_of_val(self.slots.as_slice())
            + size_of_val(self.covered.as_slice())
            + size_of_val(self.band_ends.as_slice())
            + size_of_val(self.orientations.as_slice())
            + size_of_val(self.boundary.pixels.as_slice())
            + size_of_val(self.boundary.ends.as_slice())
            + size_of_val(self.boundary.fragments.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};
    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::rasterize::rasterize;

    /// A large face and small ones before it, over several bands.
    fn coverage() -> Coverage {
        let mut corners = vec![[-0.7, -0.9, 0.5], [0.9, -0.5, 0.5], [0.1, 0.8, 0.5]];
        for k in 0..40 {
            let (x, y) = (-0.8 + 0.04 * k as f64, 0.7 * (0.9 * k as f64).sin());
            corners.extend([[x, y, 0.0], [x + 0.09, y - 0.03, 0.0], [x + 0.02, y + 0.1, 0.0]]);
        }
        let mesh = Mesh::new((0..41).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(), 123);
        let clip = corners.iter().flat_map(|&[x, y, z]| [x, y, z, 1.0]).collect();
        let tape = Tape::<f64>::new();
        let clip = tape.leaf(&Tensor::new([123, 4], clip).unwrap());
        let fragments = rasterize(clip, &mesh.unwrap(), Size { width: 300, height: 200 }).unwrap();
        Coverage::clone(&fragments.coverage)
    }

    #[test]
    fn each_fragment_has_one_pixel_and_each_covered_pixel_one_fragment() {
        let coverage = coverage();
        assert!(coverage.band_ends.len() > 2 && coverage.runs.len() > 500);
        let mut seen = vec![false; coverage.size().pixels()];
        let places = coverage.pixels().zip(coverage.faces());
        for (fragment, (pixel, face)) in places.enumerate() {
            assert!(!std::mem::replace(&mut seen[pixel], true));
            assert_eq!(coverage.fragment_at(pixel), Some(fragment));
            assert_eq!(coverage.face_at(pixel), Some(face));
        }
        assert_eq!(coverage.pixels().count(), coverage.count());
        let ids = coverage.triangle_ids();
        for (pixel, seen) in seen.into_iter().enumerate() {
            assert_eq!(ids[pixel] > 0, seen);
            assert_eq!(coverage.fragment_at(pixel).is_some(), seen);
        }
    }

    #[test]
    fn gaps_are_the_pixels_that_are_neither_covered_nor_of_the_rim() {
        let coverage = coverage();
        let uncovered: Vec<_> = (0..coverage.size().pixels())
            .filter(|&pixel| coverage.fragment_at(pixel).is_none())
            .collect();
        for every in [1, 2, 7, usize::MAX] {
            let rim: Vec<_> = uncovered.iter().step_by(every).map(|&p| p as u32).collect();
            let mut found = Vec::new();
            coverage.for_each_gap(&rim, |gap| {
                assert!(!gap.is_empty());
                found.extend(gap);
            });
            let expected: Vec<_> =
                uncovered.iter().copied().filter(|&p| !rim.contains(&(p as u32))).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn bands_are_merged_in_their_order_on_any_number_of_threads() {
        let coverage = coverage();
        let merged = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (mut merged, mut entries) = (Vec::new(), vec![0; 2 * coverage.count()]);
            pool.install(|| {
                let work = |slots: Range<usize>, first: usize, own: &mut [usize]| {
                    (first..).zip(own.chunks_exact_mut(2)).for_each(|(n, own)| own.fill(n));
                    (slots, first, own.len())
                };
                coverage.merge_bands_mut(coverage.bands(), 2, &mut entries, work, |band| {
                    merged.push(band)
                });
            });
            assert!((0..).zip(entries.chunks_exact(2)).all(|(n, own)| own == [n, n]));
            merged
        };
        let alone = merged(1);
        assert_eq!(alone.len(), coverage.band_ends.len());
        assert!(alone.is_sorted_by_key(|(_, first, _)| *first));
        for threads in [2, 4] {
            assert_eq!(merged(threads), alone);
        }
    }

    #[test]
    fn the_fragments_of_a_slot_are_those_of_its_runs_and_can_be_cut() {
        let coverage = coverage();
        let mut next = 0;
        for slot in 0..coverage.slots.len() {
            let fragments = coverage.fragments_of(slot);
            assert_eq!(fragments.start, next);
            next = fragments.end;
            let own: Vec<_> = coverage.spans_of(slot).flat_map(|span| span.pixels()).collect();
            assert_eq!(own.len(), fragments.len());
            assert_eq!(coverage.first_pixel_of(slot), own[0]);
            let cut = fragments.start + fragments.len() / 3..fragments.end;
            let within = coverage.spans_within(slot, cut.clone()).flat_map(|span| span.pixels());
            assert!(within.eq(own[cut.start - fragments.start..].iter().copied()));
        }
        assert_eq!(next, coverage.count());
    }
}
