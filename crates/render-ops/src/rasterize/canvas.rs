//! Where bands are drawn, and read as runs.

use std::ops::Range;

use bokashi_core::Scalar;

use super::behind::{Peeling, SortIn};
use super::blocks::SmallFaces;
use super::exact::{BandFaces, BoundarySearch, PieceFragments, Pieces};
use super::filter::{EIGHT, Octet, split_into_eights};
use super::plane::Plane;
use super::prepared::{Prepared, Reach};
use super::spans::RowOfPixels;
use crate::dispatch::dispatch_256;
use crate::run_reader::{BandRuns, NO_FACE, RunReader};
use crate::runs::Runs;
use crate::size::Size;

/// What one layer shows at the pixel centres of a band.
#[derive(Debug, Default)]
pub(super) struct BandLayer {
    pub(super) runs: BandRuns,
    /// Per slot: whether some pixel that its face covered had to be settled.
    pub(super) were_settled: Vec<bool>,
}

/// What is seen in the boundary pixels of a band.
#[derive(Debug, Default)]
pub(super) struct Band<T: Scalar> {
    pub(super) pieces: Pieces<T::Wide>,
    /// The pieces as fragments.
    pub(super) piece_fragments: PieceFragments<T>,
}

/// Where bands are drawn, one after another.
#[derive(Debug, Default)]
pub(super) struct Canvas<T: Scalar> {
    /// How far the band's faces reach, which exact coverage asks of all of them.
    reaches: Vec<Reach>,
    /// Where faces are drawn.
    plane: Plane,
    /// Per face of the band: whether some pixel that it covered had to be settled.
    were_settled: Vec<bool>,
    reader: RunReader,
    /// Memory of pieces.
    slot_of: Vec<u32>,
    search: BoundarySearch<T::Wide>,
    peeling: Peeling,
}

/// The work of drawing a band and of reading its layers.
pub(super) struct Draw<'a, T: Scalar> {
    pub(super) canvas: &'a mut Canvas<T>,
    pub(super) view: &'a Prepared<'a, T>,
    pub(super) rows: Range<usize>,
    pub(super) faces: &'a [u32],
    /// Per layer.
    pub(super) seen: &'a mut [BandLayer],
    pub(super) band: &'a mut Band<T>,
}

/// Not as a closure, which would not be compiled for the vectors that were found.
impl<T: Scalar> pulp::WithSimd for Draw<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, simd: V) {
        let Self { canvas, view, rows, faces, seen, band } = self;
        canvas.run(simd, view, rows, faces, (seen, band));
    }
}

/// The work of drawing a face span by span: in a place of its own, for what draws small faces has no
/// registers to spare.
struct DrawSpans<'a, T: Scalar> {
    plane: &'a mut Plane,
    view: &'a Prepared<'a, T>,
    /// The rows of the band, its faces, and the position of the face that is drawn.
    rows: Range<usize>,
    faces: &'a [u32],
    number: u32,
}

impl<T: Scalar> pulp::WithSimd for DrawSpans<'_, T> {
    /// Whether some pixel that was covered had to be settled.
    type Output = bool;

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, simd: V) -> bool {
        let Self { plane, view, rows, faces, number } = self;
        let face = faces[number as usize] as usize;
        let [columns, rows_of_face] = view.touched(face, &rows);
        let columns = [columns.start, columns.end];
        let mut setup = view.setup(face);
        let centers = &view.centers[..view.size.width];
        let depth_of = |other: u32, [y, x]: [T::Wide; 2]| {
            view.setup(faces[other as usize] as usize).depth_at(y, x)
        };
        for row in rows_of_face {
            let local = row - rows.start;
            let (depths, faces) = plane.row(local);
            let (filter, depth_of) = (&view.filter, &depth_of);
            let mut pixels = RowOfPixels { depths, faces, number, filter, depth_of };
            let edges = setup.row(view.ys[row]);
            let reached = setup.cover_span(simd, &edges, columns, centers, &mut pixels);
            plane.reach(local, reached);
        }
        setup.has_uncertain()
    }
}

impl<T: Scalar> Canvas<T> {
    #[inline(always)]
    fn run<V: pulp::Simd>(
        &mut self,
        simd: V,
        view: &Prepared<'_, T>,
        rows: Range<usize>,
        faces: &[u32],
        (seen, band): (&mut [BandLayer], &mut Band<T>),
    ) {
        self.plane.fit(view.size.width, view.rows);
        self.peeling.fit(view);
        self.draw_layers(simd, view, rows.clone(), faces);
        if view.sampling.has_pieces() {
            self.resolve(view, band, rows.clone(), faces);
        }
        if view.front.is_some() {
            self.plane.forget_rows(rows.len());
        }
        for (layer, seen) in seen.iter_mut().enumerate() {
            let behind = layer.checked_sub(view.layers - self.peeling.layers.len());
            self.exchange_layer(behind);
            self.read(view, seen, rows.clone(), faces);
            self.exchange_layer(behind);
        }
    }

    /// Draws the nearest layer, or that in front, into the plane, and those behind it into theirs.
    #[inline(always)]
    fn draw_layers<V: pulp::Simd>(
        &mut self,
        simd: V,
        view: &Prepared<'_, T>,
        rows: Range<usize>,
        faces: &[u32],
    ) {
        for is_behind in [false, true] {
            if is_behind {
                if self.peeling.layers.is_empty() || self.plane.is_empty() {
                    return;
                }
                self.exchange_front();
            }
            self.were_settled.clear();
            self.were_settled.resize(faces.len(), false);
            if !is_behind && let Some(front) = view.front {
                self.plane.draw_front(simd, view, front, rows.clone(), faces);
                continue;
            }
            let band = [rows.start, rows.end - 1];
            let (eights, last) = split_into_eights(faces);
            for (first, eight) in (0_u32..).step_by(EIGHT).zip(eights.iter().chain(&last)) {
                let octet = Octet::gather(simd, view.records, view.vertices_of(eight));
                let small = SmallFaces::new(&view.filter, &octet, view.size, band);
                for k in 0..EIGHT.min(faces.len() - first as usize) {
                    let number = first + k as u32;
                    self.draw(simd, view, rows.clone(), faces, (&small, k), number);
                    if is_behind {
                        self.sort_in(view, rows.clone(), faces, number);
                    }
                }
            }
        }
        self.exchange_front();
    }

    /// Sorts a face that was drawn alone into the layers behind.
    #[inline(never)]
    fn sort_in(&mut self, view: &Prepared<'_, T>, rows: Range<usize>, faces: &[u32], number: u32) {
        let Self { plane, peeling: Peeling { front, layers, .. }, .. } = self;
        let [_, drawn_rows] = view.touched(faces[number as usize] as usize, &rows);
        let local = drawn_rows.start - rows.start..drawn_rows.end - rows.start;
        let depth_of = |number: u32, local: usize, column: usize| {
            let face = faces[number as usize] as usize;
            view.setup(face).depth_at(view.ys[rows.start + local], view.centers[column])
        };
        let work = SortIn { drawn: plane, front, layers, rows: local, depth_of };
        dispatch_256::<T, _>(work);
    }

    /// Exchanges what was drawn and what is kept of its faces for the layer in front.
    fn exchange_front(&mut self) {
        std::mem::swap(&mut self.plane, &mut self.peeling.front);
        std::mem::swap(&mut self.were_settled, &mut self.peeling.were_settled);
    }

    /// Exchanges what was drawn for the `behind`-th layer behind the one in front, if it is one of these.
    fn exchange_layer(&mut self, behind: Option<usize>) {
        if let Some(behind) = behind {
            std::mem::swap(&mut self.plane, &mut self.peeling.layers[behind]);
            std::mem::swap(&mut self.were_settled, &mut self.peeling.were_settled);
        }
    }

    /// Draws the face at position `number` of the band of `rows`, a lane of eight that were set up.
    #[inline(always)]
    fn draw<V: pulp::Simd>(
        &mut self,
        simd: V,
        view: &Prepared<'_, T>,
        rows: Range<usize>,
        faces: &[u32],
        (small, k): (&SmallFaces, usize),
        number: u32,
    ) {
        let advantage = view.filter.advantage();
        if small.is_small(k)
            && !small.cover(simd, k, &mut self.plane, rows.start, number, advantage)
        {
            return;
        }
        let spans = DrawSpans { plane: &mut self.plane, view, rows, faces, number };
        if dispatch_256::<T, _>(spans) {
            self.were_settled[number as usize] = true;
        }
    }

    /// Resolves the boundary pixels of a band, whose faces are `faces`; nothing is seen at their centres then.
    #[inline(never)]
    fn resolve(
        &mut self,
        view: &Prepared<'_, T>,
        band: &mut Band<T>,
        rows: Range<usize>,
        faces: &[u32],
    ) {
        let Self { search, reaches, slot_of, .. } = self;
        let Band { pieces, piece_fragments, .. } = band;
        let first = rows.start * view.size.width;
        dispatch_256::<T, _>(FindPieces { view, rows, faces, reaches, search, pieces });
        piece_fragments.sort(pieces, faces, slot_of);
        let Plane { faces: stored, stride, .. } = &mut self.plane;
        for &pixel in &pieces.pixels {
            let [row, column] =
                Size { width: view.size.width, height: 0 }.row_and_column(pixel as usize - first);
            stored[row * *stride + column] = NO_FACE;
        }
    }

    /// Reads the plane as the runs of a layer of a band, and forgets what was drawn there.
    #[inline(always)]
    fn read(
        &mut self,
        view: &Prepared<'_, T>,
        seen: &mut BandLayer,
        rows: Range<usize>,
        faces: &[u32],
    ) {
        let Self { plane, reader, were_settled, .. } = self;
        let BandLayer { runs: seen, were_settled: of_slots } = seen;
        reader.begin(faces.len(), seen);
        for (local, row) in rows.enumerate() {
            reader.begin_row(seen);
            let [first, end] = plane.take_reached(local);
            if first < end {
                let (_, drawn) = plane.row(local);
                reader.read(&drawn[first..end], (row * view.size.width + first) as u32, seen);
                plane.forget(local, [first, end]);
            }
        }
        plane.reached_by_small = [usize::MAX, 0];
        of_slots.clear();
        of_slots.extend(reader.seen().map(|drawn| were_settled[drawn as usize]));
        reader.end(|drawn| faces[drawn as usize], seen);
    }
}

/// The work of finding the pieces of a band. As [`Draw`], it is not a closure.
struct FindPieces<'a, T: Scalar> {
    view: &'a Prepared<'a, T>,
    rows: Range<usize>,
    faces: &'a [u32],
    reaches: &'a mut Vec<Reach>,
    search: &'a mut BoundarySearch<T::Wide>,
    pieces: &'a mut Pieces<T::Wide>,
}

impl<T: Scalar> pulp::WithSimd for FindPieces<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, simd: V) {
        let Self { view, rows, faces, reaches, search, pieces } = self;
        view.find_reaches(simd, faces, reaches);
        search.run(&BandFaces { view, rows, faces, reaches }, pieces);
    }
}

/// The work of writing the `barycentrics` of a band. As [`Draw`], it is not a closure.
pub(super) struct Weigh<'a, T: Scalar> {
    pub(super) view: &'a Prepared<'a, T>,
    pub(super) runs: &'a Runs,
    pub(super) slots: Range<usize>,
    /// The first fragment.
    pub(super) first: usize,
    /// Of all slots.
    pub(super) were_settled: &'a [bool],
    pub(super) barycentrics: &'a mut [T],
}

impl<T: Scalar> pulp::WithSimd for Weigh<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { view, runs, slots, first, were_settled, barycentrics } = self;
        let Prepared { centers, ys, size: Size { width, .. }, .. } = *view;
        // From a row to the next, exactly.
        let two = T::Wide::from_f64(2.0);
        for slot in slots {
            let (face, of_slot) = (runs.face(slot), runs.in_slot(slot));
            let weights = view.weights(face, were_settled[slot]);
            let [row, column] = view.size.row_and_column(of_slot[0].pixel as usize);
            let mut start = of_slot[0].pixel as usize - column;
            let mut y = ys[row];
            for run in of_slot {
                let (pixel, length) = (run.pixel as usize, run.length as usize);
                // Runs of a face come row after row, so that few are looked up by a division.
                if pixel >= start + width {
                    (y, start) = (y - two, start + width);
                    if pixel >= start + width {
                        start = pixel / width * width;
                        y = ys[pixel / width];
                    }
                }
                let column = pixel - start;
                let barycentrics = &mut barycentrics[2 * (run.fragment as usize - first)..];
                let centers = &centers[column..];
                if weights.is_plain {
                    weights.weigh(y, length, centers, barycentrics);
                } else {
                    let target = &mut barycentrics[..2 * length];
                    view.setup(face).weigh_one_by_one(y, &centers[..length], target);
                }
            }
        }
    }
}
