//! Which faces cover which pixels.
//!
//! Neighbouring pixels of a row mostly see one face. So coverage is stored as runs alone (`runs`), and
//! what lies between them costs nothing. Fragments at pixel centres come first, in the order of their
//! runs, then the pieces of boundary pixels, in the order of theirs.

use std::ops::Range;

use bokashi_core::{Scalar, TensorError};

use crate::boundary::{Boundary, BoundaryCounts};
use crate::error::RenderError;
use crate::fetch::fetch_all;
use crate::mesh::{Mesh, SilhouetteEdges};
use crate::run_reader::{BandRuns, RunReader, RunStart};
use crate::runs::{Run, Runs, rows_per_band};
use crate::size::Size;

/// Which faces cover which pixels: whole numbers, so not differentiable by type.
#[derive(Debug, Clone)]
pub struct Coverage {
    pub(crate) mesh: Mesh,
    pub(crate) size: Size,
    pub(crate) culled: Culled,
    /// The fragments at pixel centres.
    pub(crate) centers: Runs,
    /// Where the runs at pixel centres start, in the order of their pixels.
    pub(crate) by_pixel: Vec<RunStart>,
    /// Where in `by_pixel` each row starts, and at the end its length.
    pub(crate) row_starts: Vec<u32>,
    /// The pixels whose centres are covered, as ranges from a first pixel to before an end, in order.
    pub(crate) covered: Vec<[u32; 2]>,
    /// The pieces of boundary pixels, runs of one pixel each. They have bands where boundary pixels were
    /// looked for.
    pub(crate) pieces: Runs,
    pub(crate) boundary: Boundary,
    /// Whether pictures of it are antialiased.
    pub(crate) antialias: bool,
    /// Per face of the mesh, drawn or not: the sign of its area as it is seen, y up; 0 where it is
    /// zero within rounding, or where that side is culled. Empty where nobody knows them.
    pub(crate) orientations: Vec<i8>,
}

/// Neighbouring pixels of a row that see one face.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PixelRun {
    /// The index of the face.
    pub face: usize,
    /// The pixels, `row * width + column`.
    pub pixels: Range<usize>,
    /// Their fragments, as many.
    pub fragments: Range<usize>,
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

impl Culled {
    /// Counts other faces, too.
    pub(crate) fn add(&mut self, others: &Self) {
        let Self { degenerate, outside, facing } = others;
        self.degenerate += degenerate;
        self.outside += outside;
        self.facing += facing;
    }
}

impl Coverage {
    /// The coverage of nothing.
    pub(crate) fn empty(mesh: Mesh, size: Size) -> Self {
        Self {
            mesh,
            size,
            culled: Culled::default(),
            centers: Runs::default(),
            by_pixel: Vec::new(),
            row_starts: Vec::new(),
            covered: Vec::new(),
            pieces: Runs::default(),
            boundary: Boundary::default(),
            antialias: false,
            orientations: Vec::new(),
        }
    }

    /// The coverage of an image of triangle ids: per pixel, row by row from the top, the index of its face plus 1, or 0
    /// for the background. So it comes back from [`Coverage::triangle_ids`], but for pieces of exact coverage, or from
    /// another renderer.
    ///
    /// Nobody knows which way its faces turn, which [`antialias`](crate::antialias()) asks for:
    /// [`Coverage::with_orientations`] says so.
    ///
    /// # Errors
    /// [`RenderError::ImageSize`] for an image without pixels; [`RenderError::Shape`] unless there is an id per pixel;
    /// [`RenderError::TriangleId`] for an id above the number of faces.
    pub fn from_ids(mesh: &Mesh, size: Size, ids: &[u32]) -> Result<Self, RenderError> {
        size.checked()?;
        if ids.len() != size.pixels() {
            let rule = format!("an id for each of the {} pixels", size.pixels());
            return Err(RenderError::shape("Coverage::from_ids", rule, &[ids.len()].into()));
        }
        let faces = mesh.faces().len();
        if let Some(pixel) = ids.iter().position(|&id| id as usize > faces) {
            return Err(RenderError::TriangleId { pixel, id: ids[pixel], faces });
        }
        let mut coverage = Self::empty(mesh.clone(), size);
        let (mut reader, mut row) = (RunReader::default(), Vec::new());
        let mut band = BandRuns::default();
        coverage.begin_centers();
        for (k, ids) in ids.chunks(size.width * rows_per_band(size)).enumerate() {
            let mut pixel = k * size.width * rows_per_band(size);
            reader.begin(faces, &mut band);
            for ids in ids.chunks(size.width) {
                reader.begin_row(&mut band);
                row.clear();
                // The background's 0 becomes the number that stands for no face.
                row.extend(ids.iter().map(|id| id.wrapping_sub(1)));
                reader.read(&row, pixel as u32, &mut band);
                pixel += size.width;
            }
            reader.end(|face| face, &mut band);
            coverage.add_centers(&band);
        }
        coverage.end_centers();
        Ok(coverage)
    }

    /// Which way each face of the mesh turns as it is seen, y up: 1 for counter-clockwise, -1 for clockwise, 0 where its
    /// area is zero within rounding or where that side was not drawn. `None` where nobody knows.
    pub fn orientations(&self) -> Option<&[i8]> {
        (self.orientations.len() == self.mesh.faces().len()).then_some(&self.orientations)
    }

    /// The same coverage with the [`Coverage::orientations`] of another of the same mesh, which were kept beside its
    /// [`Coverage::triangle_ids`].
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless there is one for each face; `TensorError::Value` for one that is not -1, 0 or 1.
    pub fn with_known_orientations(mut self, orientations: &[i8]) -> Result<Self, RenderError> {
        let (operation, faces) = ("Coverage::with_known_orientations", self.mesh.faces().len());
        if orientations.len() != faces {
            let rule = format!("an orientation for each of the {faces} faces");
            return Err(RenderError::shape(operation, rule, &[orientations.len()].into()));
        }
        if let Some(&other) = orientations.iter().find(|sign| !(-1..=1).contains(*sign)) {
            let rule = "orientations that are -1, 0 or 1".into();
            return Err(TensorError::Value { operation, rule, value: other.into() }.into());
        }
        self.orientations = orientations.to_vec();
        Ok(self)
    }

    /// Forgets what is seen, to find it anew: [`Coverage::add_centers`] for each band from the top, and then
    /// [`Coverage::end_centers`].
    pub(crate) fn begin_centers(&mut self) {
        let Self { centers, by_pixel, row_starts, covered, pieces, .. } = self;
        centers.clear();
        by_pixel.clear();
        row_starts.clear();
        covered.clear();
        pieces.clear();
    }

    /// Adds what is seen at pixel centres in the next band.
    pub(crate) fn add_centers(&mut self, band: &BandRuns) {
        let Self { centers, by_pixel, row_starts, covered, .. } = self;
        let before = centers.runs.len() as u32;
        centers.add_band(band.runs(), &band.slots);
        by_pixel.extend(
            band.by_pixel.iter().map(|start| RunStart { run: before + start.run, ..*start }),
        );
        row_starts.extend(band.row_starts.iter().map(|start| before + start));
        covered.extend(&band.covered);
    }

    /// Ends what was begun.
    pub(crate) fn end_centers(&mut self) {
        self.row_starts.push(self.centers.runs.len() as u32);
    }

    /// The number of fragments, N.
    pub fn count(&self) -> usize {
        self.centers.count + self.pieces.count
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
        self.centers.faces().chain(self.pieces.faces())
    }

    /// Each fragment's pixel, `row * width + column`.
    pub fn pixels(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        self.centers.runs.iter().chain(&self.pieces.runs).flat_map(Run::pixels)
    }

    /// The runs of the fragments: neighbouring pixels of a row that see one face, in the order of their fragments. Pieces
    /// of boundary pixels come last, each a run of its own.
    ///
    /// So a dense image of fragments is written in pieces, and an array of another renderer read: see
    /// [`Coverage::scatter`] and [`Coverage::gather`].
    pub fn runs(&self) -> impl Iterator<Item = PixelRun> + Clone + '_ {
        self.kinds().into_iter().flat_map(|(runs, before)| {
            runs.runs.iter().map(move |run| PixelRun {
                face: runs.face_of(run),
                pixels: run.pixels(),
                fragments: before + run.fragments().start..before + run.fragments().end,
            })
        })
    }

    /// Writes the rows of `values: [N, width]` of fragments at pixel centres to `image: [H, W, width]`, whose other
    /// pixels stay as they are. Pieces of boundary pixels are left out: [`composite`](crate::composite()) adds them up.
    ///
    /// # Panics
    /// Unless both have as many entries as their shapes.
    pub fn scatter<T: Copy>(&self, values: &[T], width: usize, image: &mut [T]) {
        self.check_lengths(values, width, image);
        for run in &self.centers.runs {
            let [pixels, fragments] =
                [run.pixels(), run.fragments()].map(|of| width * of.start..width * of.end);
            image[pixels].copy_from_slice(&values[fragments]);
        }
    }

    /// Reads the rows of `values: [N, width]` of fragments at pixel centres from `image: [H, W, width]`; as
    /// [`Coverage::scatter`].
    ///
    /// # Panics
    /// As [`Coverage::scatter`].
    pub fn gather<T: Copy>(&self, image: &[T], width: usize, values: &mut [T]) {
        self.check_lengths(values, width, image);
        for run in &self.centers.runs {
            let [pixels, fragments] =
                [run.pixels(), run.fragments()].map(|of| width * of.start..width * of.end);
            values[fragments].copy_from_slice(&image[pixels]);
        }
    }

    fn check_lengths<T>(&self, values: &[T], width: usize, image: &[T]) {
        let expected = [self.count(), self.size.pixels()].map(|count| count * width);
        let given = [values.len(), image.len()];
        assert_eq!(given, expected, "rows of fragments and of pixels have {width} entries each");
    }

    /// The fragment of `pixel`, where it is covered; in a boundary pixel the largest piece. Nothing
    /// covers a pixel outside the image.
    pub fn fragment_at(&self, pixel: usize) -> Option<usize> {
        let Boundary { pixels, .. } = &self.boundary;
        let index = u32::try_from(pixel).ok().and_then(|pixel| pixels.binary_search(&pixel).ok());
        match index {
            Some(index) => self.boundary.largest_of(index).map(|fragment| fragment as usize),
            None => {
                self.run_at(pixel).map(|run| run.fragment as usize + pixel - run.pixel as usize)
            }
        }
    }

    /// The face that `pixel` sees, where it is covered; in a boundary pixel the face of the largest
    /// piece.
    pub fn face_at(&self, pixel: usize) -> Option<usize> {
        let fragment = self.fragment_at(pixel)?;
        let (runs, fragment) = match fragment.checked_sub(self.centers.count) {
            None => (&self.centers, fragment),
            Some(piece) => (&self.pieces, piece),
        };
        let after = runs.runs.partition_point(|run| run.fragment as usize <= fragment);
        Some(runs.face_of(&runs.runs[after - 1]))
    }

    /// Per pixel, row by row from the top: the index of its face plus 1, or 0 for the background. A
    /// boundary pixel has the face of its largest piece.
    pub fn triangle_ids(&self) -> Vec<u32> {
        let mut ids = vec![0; self.size.pixels()];
        for run in &self.centers.runs {
            ids[run.pixels()].fill(self.centers.face_of(run) as u32 + 1);
        }
        for &pixel in self.boundary.pixels.iter() {
            let face = self.face_at(pixel as usize);
            ids[pixel as usize] = face.map_or(0, |face| face as u32 + 1);
        }
        ids
    }

    /// The pixels that exact coverage has resolved into pieces, in order. Each comes with its
    /// fragments, the largest piece first. A pixel in which nothing is seen has no fragments, or
    /// pieces of weight 0. Every other pixel of the image has a single fragment, or none.
    pub fn boundary(&self) -> impl Iterator<Item = (usize, &[u32])> + Clone + '_ {
        self.boundary.iter()
    }

    /// Whether boundary pixels were resolved, if there were any.
    pub(crate) fn is_exact(&self) -> bool {
        self.pieces.bands() > 0
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

    /// # Errors
    /// [`RenderError::ExactCoverage`] for anything but fragments at pixel centres; [`RenderError::NoOrientations`] where
    /// nobody knows which way faces turn.
    pub(crate) fn check_silhouettes(&self, operation: &'static str) -> Result<(), RenderError> {
        if self.orientations.len() != self.mesh.faces().len() {
            return Err(RenderError::NoOrientations { operation });
        }
        self.check_centers(operation)
    }

    /// How the pixels of [`Coverage::boundary`] were resolved.
    pub fn boundary_counts(&self) -> BoundaryCounts {
        self.boundary.counts
    }

    /// The number of fragments at pixel centres: they come before the pieces of boundary pixels.
    pub fn centers(&self) -> usize {
        self.centers.count
    }

    /// How many faces were not drawn, and why; zeros for coverage of ids, of which nobody knows.
    pub fn culled(&self) -> Culled {
        self.culled
    }

    /// The runs of either kind of fragments, and how many fragments come before them.
    pub(crate) fn kinds(&self) -> [(&Runs, usize); 2] {
        [(&self.centers, 0), (&self.pieces, self.centers.count)]
    }

    /// Calls `work(runs, slot, fragments, own)` for each slot of either kind of fragments: with its
    /// fragments, and their entries of `entries`. Each fragment has as many entries. Bands may be
    /// worked on at the same time.
    #[inline(always)]
    pub(crate) fn for_each_slot_mut<T: Scalar>(
        &self,
        entries: &mut [T],
        work: impl Fn(&Runs, usize, Range<usize>, &mut [T]) + Send + Sync,
    ) {
        let width = entries.len().checked_div(self.count()).unwrap_or(0);
        let mut rest = entries;
        for (runs, before) in self.kinds() {
            let (entries, others) = rest.split_at_mut(runs.count * width);
            rest = others;
            runs.for_each_slot_mut(
                width,
                entries,
                #[inline(always)]
                |slot, fragments, own| {
                    let fragments = before + fragments.start..before + fragments.end;
                    work(runs, slot, fragments, own);
                },
            );
        }
    }

    /// The run that covers the centre of `pixel`.
    fn run_at(&self, pixel: usize) -> Option<&Run> {
        if pixel >= self.size.pixels() {
            return None;
        }
        let [row, column] = self.size.row_and_column(pixel);
        self.run_in_row(row, column as u32).map(|run| &self.centers.runs[run as usize])
    }

    /// The index of the run that covers the centre of the pixel of a row and a column.
    #[inline(always)]
    pub(crate) fn run_in_row(&self, row: usize, column: u32) -> Option<u32> {
        let pixel = (row * self.size.width) as u32 + column;
        let starts = &self.by_pixel[self.row(row)];
        let after = starts.partition_point(|start| start.pixel <= pixel);
        let RunStart { pixel: first, run } = starts[after.checked_sub(1)?];
        (pixel - first < self.centers.runs[run as usize].length).then_some(run)
    }

    /// Where in `by_pixel` the runs of a row are, from the left.
    fn row(&self, row: usize) -> Range<usize> {
        self.row_starts[row] as usize..self.row_starts[row + 1] as usize
    }

    /// The runs at pixel centres of a row, from the left.
    #[inline(always)]
    pub(crate) fn runs_in_row(&self, row: usize) -> impl ExactSizeIterator<Item = &Run> + '_ {
        self.by_pixel[self.row(row)].iter().map(|start| &self.centers.runs[start.run as usize])
    }

    /// The pixels from the first covered one to the last, of each row of the band of `slots`.
    #[inline(always)]
    pub(crate) fn pixels_by_row(&self, slots: Range<usize>) -> impl Iterator<Item = Range<usize>> {
        let rows = self.centers.rows_of(slots, self.size);
        rows.filter_map(|row| {
            let starts = &self.by_pixel[self.row(row)];
            let (first, last) = (starts.first()?, starts.last()?);
            Some(first.pixel as usize..self.centers.runs[last.run as usize].pixels().end)
        })
    }

    /// Reads the runs of the band of `slots` beforehand: see [`crate::fetch`].
    #[inline(always)]
    pub(crate) fn fetch_runs(&self, slots: Range<usize>) {
        let rows = self.centers.rows_of(slots.clone(), self.size);
        let [first, end] = [rows.start, rows.end].map(|row| self.row_starts[row] as usize);
        fetch_all(&self.by_pixel[first..end], |start| start.pixel);
        fetch_all(self.centers.in_slots(slots), |run| run.pixel);
    }

    /// The silhouette edges of the mesh as it is seen.
    #[inline(always)]
    pub(crate) fn silhouette_edges(&self) -> SilhouetteEdges<'_> {
        self.mesh.silhouette_edges(&self.orientations)
    }

    /// Calls `visit` with the uncovered pixels, as ranges, but for those of `blended`, which are
    /// in order.
    pub(crate) fn for_each_gap(&self, blended: &[u32], mut visit: impl FnMut(Range<usize>)) {
        let mut blended = blended.iter().map(|&pixel| pixel as usize).peekable();
        let mut start = 0;
        let mut gap = |end: usize, next: usize| {
            while let Some(pixel) = blended.next_if(|&pixel| pixel < end) {
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
        self.centers.bytes()
            + self.pieces.bytes()
            + size_of_val(self.by_pixel.as_slice())
            + size_of_val(self.row_starts.as_slice())
            + size_of_val(self.covered.as_slice())
            + size_of_val(self.orientations.as_slice())
            + size_of_val(self.boundary.pixels.as_slice())
            + size_of_val(self.boundary.ends.as_slice())
            + size_of_val(self.boundary.fragments.as_slice())
            + size_of_val(self.boundary.unseen.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::fixtures::many_faces;

    proptest! {
        #[test]
        fn covered_pixels_are_the_longest_ranges_of_each_band(
            width in prop::sample::select(vec![1_usize, 2, 3, 31, 32, 33, 64, 65, 1000]),
            extra_rows in 0_usize..20,
            // Of some rows that come again and again: whether they begin, go on, and end with a gap.
            gaps in prop::collection::vec(any::<[bool; 3]>(), 1..6),
        ) {
            let mesh = Mesh::new(vec![[0, 1, 2]; 3], 3).unwrap();
            // Two bands, or a few rows.
            let tall = rows_per_band(Size { width, height: usize::MAX }) + extra_rows;
            for height in [1 + extra_rows, tall] {
                let size = Size { width, height };
                let ids: Vec<u32> = (0..size.pixels())
                    .map(|pixel| {
                        let [row, column] = [pixel / width, pixel % width];
                        let [begins, goes_on, ends] = gaps[row % gaps.len()];
                        let is_gap = (begins && column == 0)
                            || (goes_on && column % 5 == 2)
                            || (ends && column + 1 == width);
                        if is_gap { 0 } else { 1 + (pixel / 3 % 3) as u32 }
                    })
                    .collect();
                let coverage = Coverage::from_ids(&mesh, size, &ids).unwrap();
                let mut expected: Vec<[u32; 2]> = Vec::new();
                for (pixel, _) in (0_u32..).zip(&ids).filter(|(_, id)| **id > 0) {
                    let begins_band = (pixel as usize).is_multiple_of(rows_per_band(size) * width);
                    match expected.last_mut() {
                        Some([_, end]) if *end == pixel && !begins_band => *end += 1,
                        _ => expected.push([pixel, pixel + 1]),
                    }
                }
                prop_assert_eq!(&coverage.covered, &expected);
                prop_assert_eq!(coverage.triangle_ids(), ids);
            }
        }
    }

    #[test]
    fn each_fragment_has_one_pixel_and_each_covered_pixel_one_fragment() {
        let coverage = many_faces();
        assert!(coverage.centers.bands() > 2 && coverage.centers.runs.len() > 500);
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
    fn gaps_are_the_pixels_that_are_neither_covered_nor_blended() {
        let coverage = many_faces();
        let uncovered: Vec<_> = (0..coverage.size().pixels())
            .filter(|&pixel| coverage.fragment_at(pixel).is_none())
            .collect();
        for every in [1, 2, 7, usize::MAX] {
            let blended: Vec<_> = uncovered.iter().step_by(every).map(|&p| p as u32).collect();
            let mut found = Vec::new();
            coverage.for_each_gap(&blended, |gap| {
                assert!(!gap.is_empty());
                found.extend(gap);
            });
            let expected: Vec<_> =
                uncovered.iter().copied().filter(|&p| !blended.contains(&(p as u32))).collect();
            assert_eq!(found, expected);
        }
    }
}
