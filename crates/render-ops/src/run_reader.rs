//! From rows of pixels to the runs of a band.

use crate::runs::{Run, Slot};

/// Stands for "no face was drawn".
pub(crate) const NO_FACE: u32 = u32::MAX;

/// Stands for "not seen".
pub(crate) const NO_SLOT: u32 = u32::MAX;

/// Where a run starts.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct RunStart {
    pub(crate) pixel: u32,
    /// The index of the run.
    pub(crate) run: u32,
}

/// What is seen in a band, counted from its first run and slot. Fragments have no numbers yet.
#[derive(Debug, Default)]
pub(crate) struct BandRuns {
    /// In the order of their fragments; behind them are some of other bands, which are not cleared.
    runs: Vec<Run>,
    pub(crate) slots: Vec<Slot>,
    /// The runs in the order of their pixels.
    pub(crate) by_pixel: Vec<RunStart>,
    /// Where in `by_pixel` each row starts.
    pub(crate) row_starts: Vec<u32>,
    /// The pixels that are covered, as ranges.
    pub(crate) covered: Vec<[u32; 2]>,
}

impl BandRuns {
    /// In the order of their fragments.
    pub(crate) fn runs(&self) -> &[Run] {
        &self.runs[..self.by_pixel.len()]
    }
}

/// Reads bands one after another. A face goes by the number that it was drawn with in the band.
#[derive(Debug, Default)]
pub(crate) struct RunReader {
    /// Per face: its slot, once it was seen. Between bands nothing is.
    slot_of: Vec<u32>,
    /// How many slots there are, and runs.
    slots: u32,
    count: usize,
    /// Per slot; with room for as many slots as faces, and one. Between bands none has runs.
    of_slots: Vec<OfSlot>,
    /// What was read, by pixel, without fragments yet; with room for more.
    read: Vec<Run>,
}

/// What is known of a slot while its band is read.
#[derive(Debug, Clone, Copy, Default)]
struct OfSlot {
    /// The number of its face.
    drawn: u32,
    /// How many runs it has, then where in the order of slots its next run goes.
    place: u32,
}

impl RunReader {
    /// Begins a band with so many faces.
    pub(crate) fn begin(&mut self, faces: usize, band: &mut BandRuns) {
        band.row_starts.clear();
        band.covered.clear();
        (self.slots, self.count) = (0, 0);
        if self.slot_of.len() < faces {
            self.slot_of.resize(faces, NO_SLOT);
            self.of_slots.resize(faces + 1, OfSlot::default());
        }
    }

    /// Begins a row.
    #[inline(always)]
    pub(crate) fn begin_row(&self, band: &mut BandRuns) {
        band.row_starts.push(self.count as u32);
    }

    /// Reads pixels of the row, of which the first is `pixel`: the face that each of them sees.
    #[inline(always)]
    pub(crate) fn read(&mut self, faces: &[u32], pixel: u32, band: &mut BandRuns) {
        let (mut start, end) = (0, faces.len());
        let most = self.count + faces.len();
        if self.read.len() < most {
            self.read.resize(most, Run::default());
        }
        let Self { slot_of, of_slots, read, slots, count } = self;
        // The last range goes on if it ends where these pixels begin.
        let last = band.covered.pop_if(|range| range[1] == pixel);
        let mut push = Push {
            slot_of,
            of_slots,
            read: &mut read[..most],
            slots: *slots,
            count: *count,
            covered_from: last.map_or(pixel, |range| range[0]),
            covered: &mut band.covered,
        };
        let (before, after) = (&faces[..end - 1], &faces[1..]);
        let pieces = before.chunks(u32::BITS as usize).zip(after.chunks(u32::BITS as usize));
        for ((before, after), from) in pieces.zip((1..).step_by(u32::BITS as usize)) {
            // A bit for each pixel that sees another face than the pixel before it: where runs start
            // can't be foretold, so pixels are compared all at once, and then runs visited.
            let mut changes = before
                .iter()
                .zip(after)
                .enumerate()
                .fold(0, |changes, (k, (a, b))| changes | u32::from(a != b) << k);
            while changes != 0 {
                let end = from + changes.trailing_zeros() as usize;
                push.run(faces[start], pixel + start as u32, (end - start) as u32);
                start = end;
                changes &= changes - 1;
            }
        }
        push.run(faces[start], pixel + start as u32, (end - start) as u32);
        push.end_range(pixel + end as u32);
        (*slots, *count) = (push.slots, push.count);
    }

    /// The numbers of the faces that were seen, slot by slot.
    pub(crate) fn seen(&self) -> impl Iterator<Item = u32> + '_ {
        self.of_slots[..self.slots as usize].iter().map(|slot| slot.drawn)
    }

    /// Ends the band: sorts the runs by slot, where those of one slot stay in order. So a face's fragments in the band will
    /// lie side by side. `face_of` has the face of each number.
    #[inline(always)]
    pub(crate) fn end(&mut self, face_of: impl Fn(u32) -> u32, band: &mut BandRuns) {
        let Self { slot_of, of_slots, .. } = self;
        let read = &self.read[..self.count];
        let of_slots = &mut of_slots[..self.slots as usize];
        of_slots.iter().for_each(|slot| slot_of[slot.drawn as usize] = NO_SLOT);
        let BandRuns { runs, slots, by_pixel, .. } = band;
        slots.clear();
        // A counting sort: counts of runs become the places where each slot's first run goes.
        let mut first_run = 0;
        slots.extend(of_slots.iter_mut().map(|OfSlot { drawn, place }| {
            let slot = Slot { face: face_of(*drawn), first_run, first_fragment: 0 };
            first_run += std::mem::replace(place, first_run);
            slot
        }));
        if runs.len() < read.len() {
            runs.resize(read.len(), Run::default());
        }
        let sorted = &mut runs[..read.len()];
        by_pixel.clear();
        by_pixel.extend(read.iter().map(|run| {
            let OfSlot { place, .. } = &mut of_slots[run.slot as usize];
            sorted[*place as usize] = *run;
            *place += 1;
            RunStart { pixel: run.pixel, run: *place - 1 }
        }));
        of_slots.iter_mut().for_each(|slot| slot.place = 0);
    }
}

/// The runs of a row as they are written down. What changes from run to run is kept here, in registers.
struct Push<'a> {
    slot_of: &'a mut [u32],
    of_slots: &'a mut [OfSlot],
    read: &'a mut [Run],
    /// How many slots there are, and runs.
    slots: u32,
    count: usize,
    /// The current range of covered pixels begins here; right after a gap it is empty.
    covered_from: u32,
    /// The ranges before it.
    covered: &'a mut Vec<[u32; 2]>,
}

impl Push<'_> {
    /// Writes down `length` pixels from `pixel` on, which see the face that was drawn as number `drawn`.
    #[inline(always)]
    fn run(&mut self, drawn: u32, pixel: u32, length: u32) {
        if drawn == NO_FACE {
            self.end_range(pixel);
            self.covered_from = pixel + length;
            return;
        }
        // Slots are numbered as they are seen, so that their order, and with it the order of
        // all sums, does not depend on that of the mesh's faces. Without a branch: whether a face is new can't be
        // foretold.
        let known = self.slot_of[drawn as usize];
        let is_new = known == NO_SLOT;
        let slot = if is_new { self.slots } else { known };
        self.slot_of[drawn as usize] = slot;
        self.of_slots[self.slots as usize].drawn = drawn;
        self.slots += u32::from(is_new);
        self.of_slots[slot as usize].place += 1;
        self.read[self.count] = Run { slot, pixel, length, fragment: 0 };
        self.count += 1;
    }

    /// Ends the range of covered pixels before `pixel`, if there is one. Inlined, so that registers keep what changes.
    #[inline(always)]
    fn end_range(&mut self, pixel: u32) {
        if self.covered_from < pixel {
            self.covered.push([self.covered_from, pixel]);
        }
    }
}
