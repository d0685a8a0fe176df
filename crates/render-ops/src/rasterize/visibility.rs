//! Which face each pixel centre sees.
//!
//! The image is cut into bands of rows. Each band has a list of the faces that can touch it, in
//! the order of their indices, and keeps the nearest depth per pixel; of equal depths the lower
//! face index wins, since it came first. Then it is read off as runs, with their weights. Pixels
//! that no face's rows reached are neither cleared nor read.
//!
//! Bands are independent of each other and joined in order, so nothing depends on the number of
//! threads. Some share a canvas, so that its memory stays in a core's cache.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::{for_each_item_mut, for_each_piece_mut, threads};

use super::RasterOptions;
use super::setup::{Corner, Fate, LANES, Setup, Verdict, Weights, beyond};
use crate::coverage::{Coverage, Culled, Run, Slot};
use crate::mesh::{Mesh, repeats_a_vertex};
use crate::size::Size;

/// Pixels in one band, rounded to whole rows: its depths and faces stay in a core's cache, and it
/// is enough work to be worth a thread.
const PIXELS_PER_BAND: usize = 1 << 14;

/// Canvases per thread, where there are several: one that has less to do takes another one.
const CANVASES_PER_THREAD: usize = 2;

/// A face that can touch no more pixels is drawn without looking where in a row it starts and ends.
const PIXELS_PER_BLOCK: usize = 1024;

/// Vertices or faces in one piece of work: some tens of microseconds.
const ITEMS_PER_PIECE: usize = 1 << 12;

/// Stands for "not seen".
const NO_SLOT: u32 = u32::MAX;

/// Stands for "no face".
const NO_FACE: u64 = u64::MAX;

/// The stages of rasterization, with their memory, which the next step uses again.
#[derive(Debug, Default)]
pub(super) struct Visibility<T: Scalar> {
    pub(super) corners: Vec<Corner<T::Wide>>,
    /// Whether a face that is drawn reaches behind the eye, so that all rows have to be searched.
    pub(super) reaches_behind: bool,
    verdicts: Vec<Verdict>,
    /// The X of each column's pixel centres, in whole blocks.
    centers: Vec<T::Wide>,
    /// The Y of each row's.
    ys: Vec<T::Wide>,
    /// Per band: the faces that can touch it.
    faces: Vec<Vec<u32>>,
    canvases: Vec<Canvas<T>>,
}

/// What the stages share.
struct View<'a, T: Scalar> {
    mesh: &'a Mesh,
    size: Size,
    corners: &'a [Corner<T::Wide>],
    verdicts: &'a [Verdict],
    centers: &'a [T::Wide],
    ys: &'a [T::Wide],
    /// Rows per band.
    rows: usize,
}

impl<'a, T: Scalar> View<'a, T> {
    #[inline(always)]
    fn blocks_per_row(&self) -> usize {
        self.centers.len() / LANES
    }

    #[inline(always)]
    fn corners_of(&self, face: usize) -> [&'a Corner<T::Wide>; 3] {
        self.mesh.faces()[face].map(|vertex| &self.corners[vertex as usize])
    }
}

impl<T: Scalar> Visibility<T> {
    /// Finds the runs, and their weights, which the bands hold.
    pub(super) fn run(&mut self, clip: &[T], options: RasterOptions, coverage: &mut Coverage) {
        let Self { corners, reaches_behind, verdicts, centers, ys, faces, canvases } = self;
        let Coverage { mesh, size, .. } = &*coverage;
        let (mesh, size) = (&mesh.clone(), *size);

        resize(corners, mesh.vertex_count(), || Corner::of(&[T::ZERO; 4], 0, size));
        for_each_piece_mut(corners, ITEMS_PER_PIECE, |piece, corners| {
            let first = piece * ITEMS_PER_PIECE;
            for (index, corner) in (first as u32..).zip(corners) {
                *corner = Corner::of(clip, index, size);
            }
        });
        let degenerate = Verdict { orientation: 0, reaches_behind: false, fate: Fate::Degenerate };
        resize(verdicts, mesh.faces().len(), || degenerate);
        for_each_piece_mut(verdicts, ITEMS_PER_PIECE, |piece, verdicts| {
            let faces = &mesh.faces()[piece * ITEMS_PER_PIECE..];
            pulp::Arch::new().dispatch(
                #[inline(always)]
                || {
                    for (&face, verdict) in faces.iter().zip(verdicts) {
                        *verdict = if repeats_a_vertex(face) {
                            degenerate
                        } else {
                            Verdict::of(face.map(|vertex| &corners[vertex as usize]), options)
                        };
                    }
                },
            );
        });

        let rows = PIXELS_PER_BAND.div_ceil(size.width).min(size.height);
        faces.resize_with(size.height.div_ceil(rows), Vec::new);
        faces.iter_mut().for_each(Vec::clear);
        coverage.culled = sort_into_bands(verdicts, faces, rows);
        *reaches_behind = verdicts.iter().any(|verdict| verdict.reaches_behind);
        coverage.orientations.clear();
        coverage.orientations.extend(verdicts.iter().map(|verdict| verdict.orientation));

        centers.clear();
        let columns = 0..size.width.next_multiple_of(LANES);
        centers.extend(columns.map(|column| size.center_x::<T::Wide>(column)));
        ys.clear();
        ys.extend((0..size.height).map(|row| size.center_y::<T::Wide>(row)));
        let view = View { mesh, size, corners, verdicts, centers, ys, rows };
        let bands = faces.len();
        // As few as can be: what the band before has touched is in a core's cache.
        let threads = threads();
        let count = bands.min(if threads > 1 { threads * CANVASES_PER_THREAD } else { 1 });
        canvases.resize_with(count, Canvas::default);
        for_each_item_mut(canvases, |first, canvas| {
            pulp::Arch::new().dispatch(Draw { canvas, view: &view, faces, first, step: count });
        });
        join(self.bands(), coverage);
    }

    /// The bands, from the top.
    pub(super) fn bands(&self) -> impl Iterator<Item = &Band<T>> {
        let count = self.canvases.len();
        (0..self.faces.len()).map(move |band| &self.canvases[band % count].bands[band / count])
    }
}

/// Of some rows of `per_row` blocks each: their y, and the depths and faces of the blocks `blocks`.
#[inline(always)]
fn rows_of<'a, S: Scalar>(
    ys: &'a [S],
    depths: &'a mut [[S; LANES]],
    faces: &'a mut [[u64; LANES]],
    per_row: usize,
    blocks: &'a Range<usize>,
) -> impl Iterator<Item = (S, &'a mut [[S; LANES]], &'a mut [[u64; LANES]])> {
    let rows = depths.chunks_exact_mut(per_row).zip(faces.chunks_exact_mut(per_row));
    ys.iter()
        .zip(rows)
        .map(|(&y, (depths, faces))| (y, &mut depths[blocks.clone()], &mut faces[blocks.clone()]))
}

/// Gives a list `length` entries, whatever they are.
fn resize<I: Clone>(list: &mut Vec<I>, length: usize, filling: impl FnOnce() -> I) {
    if list.len() != length {
        list.resize(length, filling());
    }
}

/// Puts each drawn face on the lists of the bands of `rows` rows that it can touch, and counts the
/// others.
fn sort_into_bands(verdicts: &[Verdict], faces: &mut [Vec<u32>], rows: usize) -> Culled {
    let mut culled = Culled::default();
    for (face, verdict) in (0..).zip(verdicts) {
        match verdict.fate {
            Fate::Degenerate => culled.degenerate += 1,
            Fate::Outside => culled.outside += 1,
            Fate::Facing => culled.facing += 1,
            Fate::Drawn { columns: [left, right], rows: [top, bottom] } => {
                if left <= right && top <= bottom {
                    let bands = top as usize / rows..=bottom as usize / rows;
                    faces[bands].iter_mut().for_each(|list| list.push(face));
                }
            }
        }
    }
    culled
}

/// Joins what was found in the bands.
fn join<'a, T: Scalar>(bands: impl Iterator<Item = &'a Band<T>>, coverage: &mut Coverage) {
    let Coverage { runs, by_pixel, row_starts, slots, covered, band_ends, .. } = coverage;
    runs.clear();
    by_pixel.clear();
    row_starts.clear();
    slots.clear();
    covered.clear();
    band_ends.clear();
    let mut fragments = 0;
    for band in bands {
        let (runs_before, slots_before) = (runs.len() as u32, slots.len() as u32);
        runs.extend(band.runs.iter().map(|run| Run {
            slot: slots_before + run.slot,
            fragment: fragments as u32 + run.fragment,
            ..*run
        }));
        by_pixel.extend(band.by_pixel.iter().map(|run| runs_before + run));
        row_starts.extend(band.row_starts.iter().map(|start| runs_before + start));
        slots.extend(
            band.slots.iter().map(|slot| Slot { first_run: runs_before + slot.first_run, ..*slot }),
        );
        covered.extend(&band.covered);
        band_ends.push(slots.len() as u32);
        fragments += band.barycentrics.len() / 2;
    }
    row_starts.push(runs.len() as u32);
    coverage.count = fragments;
}

/// What is seen in a band, counted from its first run, slot and fragment.
#[derive(Debug, Default)]
pub(super) struct Band<T> {
    runs: Vec<Run>,
    by_pixel: Vec<u32>,
    row_starts: Vec<u32>,
    slots: Vec<Slot>,
    covered: Vec<[u32; 2]>,
    /// The weights u and v of each fragment.
    pub(super) barycentrics: Vec<T>,
}

/// Where bands are drawn, one after another.
#[derive(Debug, Default)]
struct Canvas<T: Scalar> {
    /// The width of the image that it was made for.
    width: usize,
    /// Of the faces that were drawn.
    weights: Vec<Weights<T::Wide>>,
    /// Per pixel: the nearest depth so far, and the position in `weights` of its face, in as many bits
    /// so that both fit the same vectors.
    depths: Vec<[T::Wide; LANES]>,
    faces: Vec<[u64; LANES]>,
    /// Per row: the columns, first and end, that were reached.
    reached: Vec<[usize; 2]>,
    /// Per drawn face: its slot, once it was seen.
    slot_of: Vec<u32>,
    /// Per slot: its position in `weights`.
    seen: Vec<u32>,
    /// What was read, by pixel.
    stretches: Vec<Stretch>,
    /// Per slot: how many of the stretches are its own or of those before it.
    ends: Vec<u32>,
    /// What was read, by slot.
    sorted: Vec<Stretch>,
    bands: Vec<Band<T>>,
}

/// Neighbouring pixels of a row that see one face.
#[derive(Debug, Clone, Copy)]
struct Stretch {
    slot: u32,
    row: u32,
    column: u32,
    length: u32,
}

/// The work on a canvas: it draws every `step`-th band from `first` on.
struct Draw<'a, T: Scalar> {
    canvas: &'a mut Canvas<T>,
    view: &'a View<'a, T>,
    faces: &'a [Vec<u32>],
    first: usize,
    step: usize,
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

impl<T: Scalar> Canvas<T> {
    #[inline(always)]
    fn run(
        &mut self,
        view: &View<'_, T>,
        faces: &[Vec<u32>],
        bands: impl ExactSizeIterator<Item = usize>,
    ) {
        // As many blocks are not enough: what was drawn beyond the width is never forgotten.
        if self.width != view.size.width || self.reached.len() != view.rows {
            let blocks = view.rows * view.blocks_per_row();
            self.width = view.size.width;
            self.depths.clear();
            self.depths.resize(blocks, [beyond(); LANES]);
            self.faces.clear();
            self.faces.resize(blocks, [NO_FACE; LANES]);
            self.reached.clear();
            self.reached.resize(view.rows, [view.size.width, 0]);
        }
        self.bands.resize_with(bands.len(), Band::default);
        for (at, band) in bands.enumerate() {
            let first = band * view.rows;
            let rows = first..(first + view.rows).min(view.size.height);
            self.weights.clear();
            for &face in &faces[band] {
                self.draw(view, rows.clone(), face as usize);
            }
            self.bands[at].row_starts.clear();
            self.bands[at].covered.clear();
            self.stretches.clear();
            self.seen.clear();
            self.slot_of.clear();
            self.slot_of.resize(self.weights.len(), NO_SLOT);
            for row in rows {
                self.bands[at].row_starts.push(self.stretches.len() as u32);
                self.read(view, at, row, row - first);
            }
            self.sort();
            self.hand_over(view, at, &faces[band]);
        }
    }

    /// Draws a face into the band of `rows`.
    #[inline(always)]
    fn draw(&mut self, view: &View<'_, T>, rows: Range<usize>, face: usize) {
        let Verdict { orientation, fate, .. } = view.verdicts[face];
        let Fate::Drawn { columns: [left, right], rows: [top, bottom] } = fate else {
            unreachable!("only faces that are drawn are on the lists");
        };
        let at = self.weights.len() as u64;
        let rows_of_face = rows.start.max(top as usize)..rows.end.min(bottom as usize + 1);
        let mut setup = Setup::of(view.corners_of(face), orientation, view.size);
        let local = rows_of_face.start - rows.start..rows_of_face.end - rows.start;
        let ys = &view.ys[rows_of_face];
        let reached = &mut self.reached[local.clone()];
        let per_row = view.blocks_per_row();
        let stored = local.start * per_row..local.end * per_row;
        let (depths, faces) = (&mut self.depths[stored.clone()], &mut self.faces[stored]);
        let blocks = left as usize / LANES..right as usize / LANES + 1;
        if setup.has_plane() && blocks.len() * LANES * ys.len() <= PIXELS_PER_BLOCK {
            let centers = &view.centers.as_chunks().0[blocks.clone()];
            if setup.cover_blocks(rows_of(ys, depths, faces, per_row, &blocks), centers, at) {
                let rows = rows_of(ys, depths, faces, per_row, &blocks);
                setup.cover_doubtful(rows, centers, at);
            }
            let (first, end) = (blocks.start * LANES, (blocks.end * LANES).min(view.size.width));
            for reached in reached {
                *reached = [reached[0].min(first), reached[1].max(end)];
            }
        } else {
            let touched = [left as usize, right as usize + 1];
            let centers = &view.centers[..view.size.width];
            let rows = depths.chunks_exact_mut(per_row).zip(faces.chunks_exact_mut(per_row));
            for ((&y, (depths, faces)), reached) in ys.iter().zip(rows).zip(reached) {
                let (depths, faces) = (depths.as_flattened_mut(), faces.as_flattened_mut());
                let row = setup.row(y);
                let [first, end] = setup.cover_span(&row, touched, centers, depths, faces, at);
                *reached = [reached[0].min(first), reached[1].max(end)];
            }
        }
        self.weights.push(setup.weights());
    }

    /// Reads what the pixels of a row of band `at` see, and forgets what was drawn there, up to the
    /// image's width. `local` is the row within the band.
    #[inline(always)]
    fn read(&mut self, view: &View<'_, T>, at: usize, row: usize, local: usize) {
        let [first, end] = std::mem::replace(&mut self.reached[local], [view.size.width, 0]);
        if first >= end {
            return;
        }
        let stored = local * view.blocks_per_row()..(local + 1) * view.blocks_per_row();
        let faces = self.faces[stored.clone()].as_flattened_mut();
        let mut start = first;
        let mut end_run = |end: usize| {
            let (drawn, column) = (faces[start], start);
            start = end;
            if drawn == NO_FACE {
                return;
            }
            let length = end - column;
            let pixel = (row * view.size.width + column) as u32;
            let covered = &mut self.bands[at].covered;
            match covered.last_mut() {
                Some([_, end]) if *end == pixel => *end += length as u32,
                _ => covered.push([pixel, pixel + length as u32]),
            }
            let [row, column, length] = [row, column, length].map(|number| number as u32);
            // Slots are numbered as they are seen, so that their order, and with it the order of
            // all sums, does not depend on that of the mesh's faces.
            let slot = &mut self.slot_of[drawn as usize];
            if *slot == NO_SLOT {
                *slot = self.seen.len() as u32;
                self.seen.push(drawn as u32);
            }
            self.stretches.push(Stretch { slot: *slot, row, column, length });
        };
        let (before, after) = (&faces[first..end - 1], &faces[first + 1..end]);
        let pieces = before.chunks(u64::BITS as usize).zip(after.chunks(u64::BITS as usize));
        for ((before, after), from) in pieces.zip((first + 1..).step_by(u64::BITS as usize)) {
            // A bit for each pixel that sees another face than the one before it: where runs start
            // can't be foretold, so pixels are compared all at once, and then runs visited.
            let mut changes = before
                .iter()
                .zip(after)
                .enumerate()
                .fold(0, |changes, (k, (a, b))| changes | u64::from(a != b) << k);
            while changes != 0 {
                end_run(from + changes.trailing_zeros() as usize);
                changes &= changes - 1;
            }
        }
        end_run(end);
        faces[first..end].fill(NO_FACE);
        self.depths[stored].as_flattened_mut()[first..end].fill(beyond());
    }

    /// Sorts the stretches by slot; those of one slot stay in order.
    #[inline(always)]
    fn sort(&mut self) {
        let Self { seen, stretches, ends, sorted, .. } = self;
        ends.clear();
        ends.resize(seen.len() + 1, 0);
        stretches.iter().for_each(|stretch| ends[stretch.slot as usize + 1] += 1);
        let mut before = 0;
        for end in ends.iter_mut() {
            before += *end;
            *end = before;
        }
        sorted.clear();
        sorted.resize(stretches.len(), Stretch { slot: 0, row: 0, column: 0, length: 0 });
        // Where the next stretch of each slot goes; in the end, where its last one went.
        for stretch in stretches.iter() {
            let place = &mut ends[stretch.slot as usize];
            sorted[*place as usize] = *stretch;
            *place += 1;
        }
    }

    /// Makes runs of the stretches, with their weights, in band `at`, whose faces are `faces`.
    #[inline(always)]
    fn hand_over(&mut self, view: &View<'_, T>, at: usize, faces: &[u32]) {
        let Self { weights, seen, stretches, ends, sorted, bands, .. } = self;
        let Band { runs, by_pixel, slots, barycentrics, .. } = &mut bands[at];
        let fragments: usize = stretches.iter().map(|stretch| stretch.length as usize).sum();
        resize(barycentrics, 2 * fragments, || T::ZERO);
        runs.clear();
        slots.clear();
        let mut fragment = 0;
        for own in sorted.chunk_by(|left, right| left.slot == right.slot) {
            let slot = own[0].slot;
            let drawn = seen[slot as usize] as usize;
            let (face, weights) = (faces[drawn], &weights[drawn]);
            slots.push(Slot { face, first_run: runs.len() as u32 });
            for &Stretch { row, column, length, .. } in own {
                let (row, column, length) = (row as usize, column as usize, length as usize);
                let pixel = (row * view.size.width + column) as u32;
                runs.push(Run { slot, pixel, fragment: fragment as u32 });
                let barycentrics = &mut barycentrics[2 * fragment..];
                let centers = &view.centers[column..];
                let y = view.size.center_y(row);
                if weights.is_plain {
                    weights.weigh(y, length, centers, barycentrics);
                } else {
                    let face = face as usize;
                    let orientation = view.verdicts[face].orientation;
                    let setup = Setup::of(view.corners_of(face), orientation, view.size);
                    let own = &mut barycentrics[..2 * length];
                    setup.weigh_one_by_one(y, &centers[..length], own);
                }
                fragment += length;
            }
        }
        // Backwards, so that the last place of each slot comes first.
        by_pixel.clear();
        by_pixel.extend(stretches.iter().rev().map(|stretch| {
            let place = &mut ends[stretch.slot as usize];
            *place -= 1;
            *place
        }));
        by_pixel.reverse();
    }
}
