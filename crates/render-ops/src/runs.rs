//! Runs: neighbouring pixels of a row that see one face.
//!
//! Rows are grouped into *bands*. Each face that is seen in a band has a *slot*, in the order of the
//! faces' first pixels. Runs are ordered by slot, and within a slot by pixel, and so are the
//! fragments that they hold. So the fragments of a face in a band lie side by side in memory. Work on
//! the face is prepared once for all of them. A backward pass sums over them before it adds to the
//! face's vertices. Bands are cut by the image's size alone.

use std::ops::Range;

use bokashi_core::Scalar;
use bokashi_core::parallel::{is_shared, merge_each};

use crate::dispatch::dispatch;
use crate::size::Size;

/// Pixels in one band, rounded to whole rows: its depths and faces stay in a core's cache, and it
/// is enough work to be worth a thread.
const PIXELS_PER_BAND: usize = 1 << 14;

/// The work on bands from which on it is shared by several threads: that on so many fragments. Some loops then take 3 us,
/// less than to wake a thread, but it stays awake from one loop to the next.
pub(crate) const WORK_TO_SHARE: usize = 12_000;

/// A face takes as long as so many fragments or pixels.
pub(crate) const WORK_OF_FACE: usize = 32;

/// The rows in a band of an image of this size; the last band may have fewer.
pub(crate) fn rows_per_band(size: Size) -> usize {
    PIXELS_PER_BAND.div_ceil(size.width).min(size.height)
}

/// Neighbouring pixels of a row that see one face, a fragment each.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Run {
    /// The slot of the face.
    pub(crate) slot: u32,
    /// The first pixel.
    pub(crate) pixel: u32,
    /// The number of pixels.
    pub(crate) length: u32,
    /// The first fragment.
    pub(crate) fragment: u32,
}

impl Run {
    #[inline(always)]
    pub(crate) fn pixels(&self) -> Range<usize> {
        self.pixel as usize..(self.pixel + self.length) as usize
    }

    #[inline(always)]
    pub(crate) fn fragments(&self) -> Range<usize> {
        self.fragment as usize..(self.fragment + self.length) as usize
    }
}

/// A face that is seen in a band.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slot {
    pub(crate) face: u32,
    /// The first of its runs; the next slot's first run is one after its last.
    pub(crate) first_run: u32,
    /// The first of its fragments; the next slot's first fragment is one after its last.
    pub(crate) first_fragment: u32,
}

/// The runs of fragments of one kind: at pixel centres, or pieces of boundary pixels.
#[derive(Debug, Clone, Default)]
pub(crate) struct Runs {
    /// In the order of their fragments.
    pub(crate) runs: Vec<Run>,
    pub(crate) slots: Vec<Slot>,
    /// Where in `slots` each band ends, from the top.
    band_ends: Vec<u32>,
    /// The number of fragments.
    pub(crate) count: usize,
}

impl Runs {
    pub(crate) fn clear(&mut self) {
        self.runs.clear();
        self.slots.clear();
        self.band_ends.clear();
        self.count = 0;
    }

    /// Adds a band, whose runs and slots are numbered from 0, and numbers its fragments.
    pub(crate) fn add_band(&mut self, of_band: &[Run], slots_of_band: &[Slot]) {
        let Self { runs, slots, band_ends, count } = self;
        let [first_run, first_slot] = [runs.len() as u32, slots.len() as u32];
        let mut fragment = *count as u32;
        runs.extend(of_band.iter().map(|run| {
            let first = fragment;
            fragment += run.length;
            Run { slot: first_slot + run.slot, fragment: first, ..*run }
        }));
        slots.extend(slots_of_band.iter().map(|slot| {
            let first_run = first_run + slot.first_run;
            Slot { first_run, first_fragment: runs[first_run as usize].fragment, ..*slot }
        }));
        band_ends.push(slots.len() as u32);
        *count = fragment as usize;
    }

    /// The number of bands.
    pub(crate) fn bands(&self) -> usize {
        self.band_ends.len()
    }

    /// Whether bands are worked on at the same time.
    pub(crate) fn is_shared(&self) -> bool {
        self.are_shared(0..self.bands())
    }

    /// Whether some bands are worked on at the same time.
    fn are_shared(&self, bands: Range<usize>) -> bool {
        let count = bands.len();
        let slots = self.slots_of(bands);
        let work = WORK_OF_FACE * slots.len() + self.fragments_of(slots).len();
        count > 1 && is_shared(work, WORK_TO_SHARE)
    }

    /// The slots of some bands.
    pub(crate) fn slots_of(&self, bands: Range<usize>) -> Range<usize> {
        let before = |band: usize| band.checked_sub(1).map_or(0, |last| self.band_ends[last]);
        before(bands.start) as usize..before(bands.end) as usize
    }

    /// The face of slot `slot`.
    #[inline(always)]
    pub(crate) fn face(&self, slot: usize) -> usize {
        self.slots[slot].face as usize
    }

    /// The face that a run sees.
    #[inline(always)]
    pub(crate) fn face_of(&self, run: &Run) -> usize {
        self.face(run.slot as usize)
    }

    /// The face of each fragment.
    pub(crate) fn faces(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        let of_run = |run: &Run| std::iter::repeat_n(self.face_of(run), run.length as usize);
        self.runs.iter().flat_map(of_run)
    }

    /// The runs of some neighbouring slots.
    #[inline(always)]
    pub(crate) fn in_slots(&self, slots: Range<usize>) -> &[Run] {
        &self.runs[self.runs_before(slots.start)..self.runs_before(slots.end)]
    }

    /// The runs of slot `slot`.
    #[inline(always)]
    pub(crate) fn in_slot(&self, slot: usize) -> &[Run] {
        self.in_slots(slot..slot + 1)
    }

    /// The fragments of some neighbouring slots.
    #[inline(always)]
    pub(crate) fn fragments_of(&self, slots: Range<usize>) -> Range<usize> {
        self.fragments_before(slots.start)..self.fragments_before(slots.end)
    }

    /// The rows of the bands of some neighbouring slots.
    pub(crate) fn rows_of(&self, slots: Range<usize>, size: Size) -> Range<usize> {
        if slots.is_empty() {
            return 0..0;
        }
        let rows = rows_per_band(size);
        let band = |slot| self.first_pixel_of(slot) / (rows * size.width);
        band(slots.start) * rows..((band(slots.end - 1) + 1) * rows).min(size.height)
    }

    /// The first pixel of slot `slot`.
    #[inline(always)]
    pub(crate) fn first_pixel_of(&self, slot: usize) -> usize {
        self.runs[self.slots[slot].first_run as usize].pixel as usize
    }

    /// The runs of some of slot `slot`'s fragments.
    #[inline(always)]
    pub(crate) fn within(
        &self,
        slot: usize,
        fragments: Range<usize>,
    ) -> impl Iterator<Item = Run> + '_ {
        let cut = move |run: &Run| {
            let first = run.fragments().start.max(fragments.start);
            let end = run.fragments().end.min(fragments.end);
            let pixel = run.pixel + (first as u32).wrapping_sub(run.fragment);
            (first < end).then(|| Run {
                pixel,
                length: (end - first) as u32,
                fragment: first as u32,
                ..*run
            })
        };
        self.in_slot(slot).iter().filter_map(cut)
    }

    /// How many runs come before those of slot `slot`.
    #[inline(always)]
    fn runs_before(&self, slot: usize) -> usize {
        self.slots.get(slot).map_or(self.runs.len(), |slot| slot.first_run as usize)
    }

    /// How many fragments come before those of slot `slot`.
    #[inline(always)]
    fn fragments_before(&self, slot: usize) -> usize {
        self.slots.get(slot).map_or(self.count, |slot| slot.first_fragment as usize)
    }

    /// Calls `work(slots, first, own)` for each band, with its slots, its first fragment, and the
    /// entries of its fragments in `entries: [count, width]`; bands may be worked on at the same time.
    pub(crate) fn for_each_band_mut<T: Send>(
        &self,
        width: usize,
        entries: &mut [T],
        work: impl Fn(Range<usize>, usize, &mut [T]) + Send + Sync,
    ) {
        self.merge_bands_mut(width, entries, work, |()| {});
    }

    /// Calls `work(slot, fragments, own)` for each slot, with the entries of its fragments; as
    /// [`Runs::for_each_band_mut`].
    #[inline(always)]
    pub(crate) fn for_each_slot_mut<T: Scalar>(
        &self,
        width: usize,
        entries: &mut [T],
        work: impl Fn(usize, Range<usize>, &mut [T]) + Send + Sync,
    ) {
        self.for_each_band_mut(width, entries, |slots, first, entries| {
            dispatch::<T, _>(
                #[inline(always)]
                || {
                    for slot in slots {
                        let fragments = self.fragments_of(slot..slot + 1);
                        let own =
                            (fragments.start - first) * width..(fragments.end - first) * width;
                        work(slot, fragments, &mut entries[own]);
                    }
                },
            );
        });
    }

    /// [`Runs::for_each_band_mut`], with `merge` called on the results in the order of the bands.
    pub(crate) fn merge_bands_mut<T: Send, R: Send>(
        &self,
        width: usize,
        entries: &mut [T],
        work: impl Fn(Range<usize>, usize, &mut [T]) -> R + Send + Sync,
        merge: impl FnMut(R) + Send,
    ) {
        self.merge_some_bands_mut(0..self.bands(), width, entries, work, merge);
    }

    /// [`Runs::merge_bands_mut`] of some neighbouring bands: `entries` are those of all fragments.
    pub(crate) fn merge_some_bands_mut<T: Send, R: Send>(
        &self,
        bands: Range<usize>,
        width: usize,
        entries: &mut [T],
        work: impl Fn(Range<usize>, usize, &mut [T]) -> R + Send + Sync,
        merge: impl FnMut(R) + Send,
    ) {
        let mut first = self.fragments_of(self.slots_of(bands.clone())).start;
        let mut rest = &mut entries[first * width..];
        let are_shared = self.are_shared(bands.clone());
        let bands = bands.map(|band| {
            let slots = self.slots_of(band..band + 1);
            let count = self.fragments_of(slots.clone()).len();
            let (entries, others) = std::mem::take(&mut rest).split_at_mut(count * width);
            rest = others;
            first += count;
            (slots, first - count, entries)
        });
        let work = |(slots, first, entries): (_, _, _)| work(slots, first, entries);
        merge_each(are_shared, bands, work, merge);
    }

    /// The bytes that it holds, for reports.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.runs.as_slice())
            + size_of_val(self.slots.as_slice())
            + size_of_val(self.band_ends.as_slice())
    }
}

#[cfg(test)]
mod tests {
    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::fixtures::many_faces;

    #[test]
    fn bands_are_merged_in_their_order_on_any_number_of_threads() {
        let runs = &many_faces().centers;
        let merged = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let (mut merged, mut entries) = (Vec::new(), vec![0; 2 * runs.count]);
            pool.install(|| {
                let work = |slots: Range<usize>, first: usize, entries: &mut [usize]| {
                    (first..)
                        .zip(entries.chunks_exact_mut(2))
                        .for_each(|(n, entries)| entries.fill(n));
                    (slots, first, entries.len())
                };
                runs.merge_bands_mut(2, &mut entries, work, |band| merged.push(band));
            });
            assert!((0..).zip(entries.chunks_exact(2)).all(|(n, pair)| pair == [n, n]));
            merged
        };
        let alone = merged(1);
        assert_eq!(alone.len(), runs.bands());
        assert!(alone.is_sorted_by_key(|(_, first, _)| *first));
        for threads in [2, 4] {
            assert_eq!(merged(threads), alone);
        }
    }

    #[test]
    fn the_fragments_of_a_slot_are_those_of_its_runs_and_can_be_cut() {
        let runs = &many_faces().centers;
        let mut next = 0;
        for slot in 0..runs.slots.len() {
            let fragments = runs.fragments_of(slot..slot + 1);
            assert_eq!(fragments.start, next);
            next = fragments.end;
            let pixels: Vec<_> = runs.in_slot(slot).iter().flat_map(Run::pixels).collect();
            assert_eq!(pixels.len(), fragments.len());
            assert_eq!(runs.first_pixel_of(slot), pixels[0]);
            let cut = fragments.start + fragments.len() / 3..fragments.end;
            let within = runs.within(slot, cut.clone()).flat_map(|run| run.pixels());
            assert!(within.eq(pixels[cut.start - fragments.start..].iter().copied()));
        }
        assert_eq!(next, runs.count);
    }
}
