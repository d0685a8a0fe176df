//! Where bands are drawn, and read as runs.

use std::ops::Range;

use bokashi_core::Scalar;

use super::behind::{Peeling, SortIn};
use super::blocks::SmallFace;
use super::culling::{Fate, Verdict};
use super::exact::{BandFaces, BoundarySearch, PieceFragments, Pieces};
use super::plane::{NO_FACE, Plane};
use super::prepared::{NO_SLOT, Prepared};
use super::setup::{LANES, Setup, Weights, beyond};
use crate::dispatch::dispatch_256;
use crate::runs::{Run, Runs, Slot};
use crate::size::Size;

/// A face that can touch no more pixels is drawn without looking where in a row it starts and ends.
const PIXELS_PER_BLOCK: usize = 1024;

/// Gives a list `length` entries, whatever they are.
pub(super) fn resize<I: Clone>(list: &mut Vec<I>, length: usize, filling: impl FnOnce() -> I) {
    if list.len() != length {
        list.resize(length, filling());
    }
}

/// What is seen in a band, counted from its first run, slot and fragment.
#[derive(Debug, Default)]
pub(super) struct Band<T: Scalar> {
    pub(super) runs: Runs,
    pub(super) by_pixel: Vec<u32>,
    pub(super) row_starts: Vec<u32>,
    pub(super) covered: Vec<[u32; 2]>,
    /// Per slot: what the weights u and v of its fragments follow from.
    weights: Vec<Weights<T::Wide>>,
    pub(super) pieces: Pieces<T::Wide>,
    /// The pieces as fragments.
    pub(super) piece_fragments: PieceFragments<T>,
}

/// Where bands are drawn, one after another.
#[derive(Debug, Default)]
pub(super) struct Canvas<T: Scalar> {
    /// Of the faces that were drawn.
    weights: Vec<Weights<T::Wide>>,
    /// Where faces are drawn.
    plane: Plane<T::Wide>,
    /// Per drawn face: its slot, once it was seen.
    slot_of: Vec<u32>,
    /// Per slot: its position in `weights`.
    drawn_of_slot: Vec<u32>,
    /// What was read, by pixel, without fragments yet.
    read: Vec<Run>,
    /// Per slot: how many runs it has, then where in the order of slots its next run goes.
    places: Vec<u32>,
    search: BoundarySearch<T::Wide>,
    peeling: Peeling<T::Wide>,
    /// Per layer: the bands.
    pub(super) bands: Vec<Vec<Band<T>>>,
}

/// Where the runs of a row are written down.
struct Reader<'a> {
    covered: &'a mut Vec<[u32; 2]>,
    slot_of: &'a mut [u32],
    drawn_of_slot: &'a mut Vec<u32>,
    places: &'a mut Vec<u32>,
    read: &'a mut Vec<Run>,
}

impl Reader<'_> {
    /// Reads `length` pixels from `pixel` on, which see the face that was drawn as number `drawn`.
    #[inline(always)]
    fn read(&mut self, drawn: u64, pixel: u32, length: u32) {
        if drawn == NO_FACE {
            return;
        }
        match self.covered.last_mut() {
            Some([_, end]) if *end == pixel => *end += length,
            _ => self.covered.push([pixel, pixel + length]),
        }
        // Slots are numbered as they are seen, so that their order, and with it the order of
        // all sums, does not depend on that of the mesh's faces.
        let slot = &mut self.slot_of[drawn as usize];
        if *slot == NO_SLOT {
            *slot = self.drawn_of_slot.len() as u32;
            self.drawn_of_slot.push(drawn as u32);
            self.places.push(0);
        }
        self.places[*slot as usize] += 1;
        self.read.push(Run { slot: *slot, pixel, length, fragment: 0 });
    }
}

/// The work on a canvas: it draws every `step`-th band from `first` on.
pub(super) struct Draw<'a, T: Scalar> {
    pub(super) canvas: &'a mut Canvas<T>,
    pub(super) view: &'a Prepared<'a, T>,
    pub(super) faces: &'a [Vec<u32>],
    pub(super) first: usize,
    pub(super) step: usize,
}

/// Not as a closure, which would not be compiled for the vectors that were found.
impl<T: Scalar> pulp::WithSimd for Draw<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { canvas, view, faces, first, step } = self;
        canvas.run(view, faces, (first..faces.len()).step_by(step));
    }
}

/// The work of drawing a face span by span: in a place of its own, for what draws small faces has no
/// registers to spare.
struct DrawSpans<'a, T: Scalar> {
    canvas: &'a mut Canvas<T>,
    view: &'a Prepared<'a, T>,
    face: usize,
    /// The columns that it can touch, first and end.
    touched: [usize; 2],
    /// The Y of the rows that it can touch, and these rows within the band.
    ys: &'a [T::Wide],
    local: Range<usize>,
}

impl<T: Scalar> pulp::WithSimd for DrawSpans<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        let Self { canvas, view, face, touched, ys, local } = self;
        let number = canvas.weights.len() as u64;
        let orientation = view.verdicts[face].orientation;
        let mut setup = Setup::new(view.corners_of(face), orientation, view.size);
        let per_row = view.blocks_per_row();
        let Plane { depths, faces, reached, .. } = &mut canvas.plane;
        let reached = &mut reached[local.clone()];
        let stored = local.start * per_row..local.end * per_row;
        let (depths, faces) = (&mut depths[stored.clone()], &mut faces[stored]);
        let centers = &view.centers[..view.size.width];
        let rows = depths.chunks_exact_mut(per_row).zip(faces.chunks_exact_mut(per_row));
        for ((&y, (depths, faces)), reached) in ys.iter().zip(rows).zip(reached) {
            let (depths, faces) = (depths.as_flattened_mut(), faces.as_flattened_mut());
            let row = setup.row(y);
            let [first, end] = setup.cover_span(&row, touched, centers, depths, faces, number);
            *reached = [reached[0].min(first), reached[1].max(end)];
        }
        canvas.weights.push(setup.weights());
    }
}

impl<T: Scalar> Canvas<T> {
    #[inline(always)]
    fn run(
        &mut self,
        view: &Prepared<'_, T>,
        faces: &[Vec<u32>],
        bands: impl ExactSizeIterator<Item = usize>,
    ) {
        self.plane.fit(view);
        self.peeling.fit(view);
        self.bands.resize_with(view.layers, Vec::new);
        self.bands.iter_mut().for_each(|of_layer| of_layer.resize_with(bands.len(), Band::default));
        for (index, band) in bands.enumerate() {
            let first = band * view.rows;
            let rows = first..(first + view.rows).min(view.size.height);
            self.draw_layers(view, rows.clone(), &faces[band]);
            if view.sampling.has_pieces() {
                self.resolve(view, index, rows.clone(), &faces[band]);
            }
            if view.front.is_some() {
                self.plane.forget(rows.len());
            }
            for layer in 0..view.layers {
                let behind = layer.checked_sub(view.layers - self.peeling.layers.len());
                self.exchange_layer(behind);
                self.read(view, (layer, index), rows.clone(), &faces[band]);
                self.exchange_layer(behind);
            }
        }
    }

    /// Draws the nearest layer, or that in front, into the plane, and those behind it into theirs.
    #[inline(always)]
    fn draw_layers(&mut self, view: &Prepared<'_, T>, rows: Range<usize>, faces: &[u32]) {
        for is_behind in [false, true] {
            if is_behind {
                if self.peeling.layers.is_empty() || self.plane.is_empty() {
                    return;
                }
                self.exchange_front();
            }
            self.weights.clear();
            if !is_behind && let Some(front) = view.front {
                self.plane.draw_front(view, front, rows.clone(), faces);
                continue;
            }
            for &face in faces {
                let drawn = self.draw(view, rows.clone(), face as usize);
                if is_behind {
                    let Self { plane, peeling: Peeling { front, layers, .. }, .. } = self;
                    let work = SortIn { drawn: plane, front, layers, rows: drawn };
                    crate::dispatch::dispatch::<T, _>(work);
                }
            }
        }
        self.exchange_front();
    }

    /// Exchanges what was drawn and what is kept of its faces for the layer in front.
    fn exchange_front(&mut self) {
        std::mem::swap(&mut self.plane, &mut self.peeling.front);
        std::mem::swap(&mut self.weights, &mut self.peeling.weights);
    }

    /// Exchanges what was drawn for the `behind`-th layer behind the one in front, if it is one of these.
    fn exchange_layer(&mut self, behind: Option<usize>) {
        if let Some(behind) = behind {
            std::mem::swap(&mut self.plane, &mut self.peeling.layers[behind]);
            std::mem::swap(&mut self.weights, &mut self.peeling.weights);
        }
    }

    /// Draws a face into the band of `rows`; returns its rows within the band.
    #[inline(always)]
    fn draw(&mut self, view: &Prepared<'_, T>, rows: Range<usize>, face: usize) -> Range<usize> {
        let Verdict { orientation, fate, .. } = view.verdicts[face];
        let Fate::Drawn { columns: [left, right], rows: [top, bottom] } = fate else {
            unreachable!("only faces that are drawn are on the lists");
        };
        let number = self.weights.len() as u64;
        let rows_of_face = rows.start.max(top as usize)..rows.end.min(bottom as usize + 1);
        let local = rows_of_face.start - rows.start..rows_of_face.end - rows.start;
        let ys = &view.ys[rows_of_face];
        let per_row = view.blocks_per_row();
        let corners = view.corners_of(face);
        let blocks = left as usize / LANES..right as usize / LANES + 1;
        if blocks.len() * LANES * ys.len() <= PIXELS_PER_BLOCK
            && let Some(small) = SmallFace::new(corners, orientation, view.size)
        {
            let centers = &view.centers.as_chunks().0[blocks.clone()];
            let first = local.start * per_row + blocks.start;
            let Plane { depths, faces, reached_by_blocks, .. } = &mut self.plane;
            let stored = (&mut depths[first..], &mut faces[first..]);
            let is_uncertain = small.cover(ys, centers, stored, per_row, number);
            let [first, end] = reached_by_blocks;
            (*first, *end) = ((*first).min(blocks.start), (*end).max(blocks.end));
            // Otherwise the face is drawn once more, in spans: a pixel that has its depth keeps it.
            if !is_uncertain {
                self.weights.push(small.weights());
                return local;
            }
        }
        let touched = [left as usize, right as usize + 1];
        crate::dispatch::dispatch::<T, _>(DrawSpans {
            canvas: self,
            view,
            face,
            touched,
            ys,
            local: local.clone(),
        });
        local
    }

    /// Resolves the boundary pixels of band `band_index`, whose faces are `faces`; nothing is seen at their
    /// centres then.
    #[inline(never)]
    fn resolve(
        &mut self,
        view: &Prepared<'_, T>,
        band_index: usize,
        rows: Range<usize>,
        faces: &[u32],
    ) {
        let Self { search, bands, weights, slot_of, .. } = self;
        let Band { pieces, piece_fragments, .. } = &mut bands[0][band_index];
        let first = rows.start * view.size.width;
        dispatch_256::<T, _>(
            #[inline(always)]
            || search.run(&BandFaces { view, rows, faces, weights }, pieces),
        );
        piece_fragments.sort(pieces, faces, slot_of);
        let stored = self.plane.faces.as_flattened_mut();
        let stride = view.blocks_per_row() * LANES;
        for &pixel in &pieces.pixels {
            let [row, column] =
                Size { width: view.size.width, height: 0 }.row_and_column(pixel as usize - first);
            stored[row * stride + column] = NO_FACE;
        }
    }

    /// Reads the plane as the runs of a band of a layer, `of_band`, and forgets what was drawn there.
    #[inline(always)]
    fn read(
        &mut self,
        view: &Prepared<'_, T>,
        of_band: (usize, usize),
        rows: Range<usize>,
        faces: &[u32],
    ) {
        let band = &mut self.bands[of_band.0][of_band.1];
        band.row_starts.clear();
        band.covered.clear();
        self.read.clear();
        self.drawn_of_slot.clear();
        self.places.clear();
        self.slot_of.clear();
        self.slot_of.resize(self.weights.len(), NO_SLOT);
        for (local, row) in rows.enumerate() {
            self.bands[of_band.0][of_band.1].row_starts.push(self.read.len() as u32);
            self.read_row(view, of_band, row, local);
        }
        self.plane.reached_by_blocks = [usize::MAX, 0];
        self.sort(of_band, faces);
    }

    /// Reads what the pixels of a row see, and forgets what was drawn there, up to the image's width.
    /// `local` is the row within the band.
    #[inline(always)]
    fn read_row(
        &mut self,
        view: &Prepared<'_, T>,
        of_band: (usize, usize),
        row: usize,
        local: usize,
    ) {
        let [first, end] = self.plane.take_reached(local);
        if first >= end {
            return;
        }
        let Self { plane, bands, slot_of, drawn_of_slot, places, read, .. } = self;
        let (depths, faces, _) = plane.row(local);
        let before_row = (row * view.size.width) as u32;
        let mut reader = Reader {
            covered: &mut bands[of_band.0][of_band.1].covered,
            slot_of,
            drawn_of_slot,
            places,
            read,
        };
        let mut start = first;
        let (before, after) = (&faces[first..end - 1], &faces[first + 1..end]);
        let pieces = before.chunks(u64::BITS as usize).zip(after.chunks(u64::BITS as usize));
        for ((before, after), from) in pieces.zip((first + 1..).step_by(u64::BITS as usize)) {
            // A bit for each pixel that sees another face than the pixel before it: where runs start
            // can't be foretold, so pixels are compared all at once, and then runs visited.
            let mut changes = before
                .iter()
                .zip(after)
                .enumerate()
                .fold(0, |changes, (k, (a, b))| changes | u64::from(a != b) << k);
            while changes != 0 {
                let end = from + changes.trailing_zeros() as usize;
                reader.read(faces[start], before_row + start as u32, (end - start) as u32);
                start = end;
                changes &= changes - 1;
            }
        }
        reader.read(faces[start], before_row + start as u32, (end - start) as u32);
        faces[first..end].fill(NO_FACE);
        depths[first..end].fill(beyond());
    }

    /// Sorts the runs of a band of a layer, whose faces are `faces`, by slot; those of one slot stay in order. Gives
    /// them their fragments.
    #[inline(always)]
    fn sort(&mut self, of_band: (usize, usize), faces: &[u32]) {
        let Self { weights, drawn_of_slot, read, places, bands, .. } = self;
        let Band { runs, by_pixel, weights: own_weights, .. } = &mut bands[of_band.0][of_band.1];
        own_weights.clear();
        own_weights.extend(drawn_of_slot.iter().map(|&drawn| weights[drawn as usize]));
        let Runs { runs: sorted, slots, count, .. } = runs;
        slots.clear();
        // A counting sort: counts of runs become the places where each slot's first run goes.
        let mut first_run = 0;
        slots.extend(drawn_of_slot.iter().zip(&mut *places).map(|(&drawn, position)| {
            let slot = Slot { face: faces[drawn as usize], first_run };
            first_run += std::mem::replace(position, first_run);
            slot
        }));
        resize(sorted, read.len(), Run::default);
        resize(by_pixel, read.len(), || 0);
        for (run, index) in read.iter().zip(by_pixel) {
            let position = &mut places[run.slot as usize];
            sorted[*position as usize] = *run;
            *index = *position;
            *position += 1;
        }
        // In this order a face's fragments in the band lie side by side.
        let mut fragment = 0;
        for run in sorted {
            run.fragment = fragment;
            fragment += run.length;
        }
        *count = fragment as usize;
    }
}

impl<T: Scalar> Band<T> {
    /// Writes the weights u and v of each fragment.
    #[inline(always)]
    pub(super) fn weigh(&self, view: &Prepared<'_, T>, barycentrics: &mut [T]) {
        let Runs { runs, slots, .. } = &self.runs;
        let Prepared { centers, ys, size: Size { width, .. }, .. } = *view;
        // From a row to the next, exactly.
        let two = T::Wide::from_f64(2.0);
        let ends = slots.iter().skip(1).map(|next| next.first_run as usize).chain([runs.len()]);
        for ((slot, end), &weights) in slots.iter().zip(ends).zip(&self.weights) {
            let of_slot = &runs[slot.first_run as usize..end];
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
                let barycentrics = &mut barycentrics[2 * run.fragment as usize..];
                let centers = &centers[column..];
                if weights.is_plain {
                    weights.weigh(y, length, centers, barycentrics);
                } else {
                    let face = slot.face as usize;
                    let orientation = view.verdicts[face].orientation;
                    let setup = Setup::new(view.corners_of(face), orientation, view.size);
                    let target = &mut barycentrics[..2 * length];
                    setup.weigh_one_by_one(y, &centers[..length], target);
                }
            }
        }
    }
}

/// The work of weighing a band: not as a closure, as [`Draw`].
pub(super) struct Weigh<'a, T: Scalar> {
    pub(super) view: &'a Prepared<'a, T>,
    pub(super) band: &'a Band<T>,
    pub(super) barycentrics: &'a mut [T],
}

impl<T: Scalar> pulp::WithSimd for Weigh<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<V: pulp::Simd>(self, _: V) {
        self.band.weigh(self.view, self.barycentrics);
    }
}
