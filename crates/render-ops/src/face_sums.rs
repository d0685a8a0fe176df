//! Sums over fragments, by face.
//!
//! A backward pass sums the terms of all fragments of a face in a band first, and adds the sum to
//! the face's three vertices once. Bands are cut by the image's size and added in their order, so
//! the result is bitwise the same for any number of threads.
//!
//! ```text
//! Layout::add_to, add_to_and_visit       with 3 or 4 numbers per vertex as arrays, otherwise as slices
//!   |-- one thread:       walk(all slots), and each face's rows go to its vertices at once
//!   `-- several threads:  walk(slots of a band) into a list of rows; one thread adds the lists that are there, in the
//!                         order of bands, while the others go on
//!
//! walk, for each slot                    a face with its fragments in a band
//!   |-- visit             what else the caller does with them, while they are in the cache
//!   |-- FaceSums::sum     the sums over the fragments as rows, one per vertex; most by `weighted_sums`
//!   `-- emit              the face and its rows
//! ```

use std::ops::Range;

use bokashi_core::{Accumulator, Scalar};
use smallvec::{SmallVec, smallvec};

use crate::mesh::Mesh;
use crate::runs::Runs;
use crate::scratch::Workbench;

/// Adds a term to an entry of a gradient. A term beyond the range of the numbers is infinite, and so
/// is the entry from then on. A later infinite term of the opposite sign leaves the entry as it is,
/// for their sum would be NaN. What is NaN stays so.
#[inline]
pub(crate) fn add_term<T: Scalar>(entry: &mut T, term: T) {
    if term.is_finite() || *entry != -term {
        *entry += term;
    }
}

/// Whether all numbers are finite, without a branch for each.
#[inline(always)]
pub(crate) fn are_finite<S: Scalar>(numbers: &[S]) -> bool {
    numbers.iter().fold(true, |all, number| all & number.is_finite())
}

/// How terms of fragments become gradients of vertices.
pub(crate) trait FaceSums<S>: Sync {
    /// The numbers per vertex, where they are always as many: sums of other widths are not compiled.
    const WIDTH: Option<usize> = None;

    /// What a walk keeps from one slot to the next.
    type Memory;

    /// The memory of a new walk.
    fn memory(&self) -> Self::Memory;

    /// The gradients of the three vertices, `rows: [3, width]`, of the face of slot `slot` from
    /// `fragments`, some or all of that slot.
    fn sum(&self, memory: &mut Self::Memory, slot: usize, fragments: Range<usize>, rows: &mut [S]);
}

/// Whose gradients they are.
pub(crate) struct Layout<'a> {
    /// The fragments that count.
    pub(crate) runs: &'a Runs,
    /// The vertices that a face's sums belong to.
    pub(crate) mesh: &'a Mesh,
    /// Numbers per vertex.
    pub(crate) width: usize,
}

/// Memory for numbers of a face's three vertices.
trait RowMemory<S>: AsMut<[S]> + Clone + Send + Sync {}

impl<S, M: AsMut<[S]> + Clone + Send + Sync> RowMemory<S> for M {}

impl Layout<'_> {
    /// Adds the gradients of the vertices to `gradient: [V, width]`.
    pub(crate) fn add_to<T: Scalar>(
        &self,
        gradient: &mut Accumulator<T>,
        by_face: &impl FaceSums<T::Wide>,
        lists: &Workbench<Vec<T>>,
    ) {
        self.add_to_and_visit(gradient, by_face, lists, &mut [], |_, _, _| ());
    }

    /// Adds the gradients of the vertices of one slot to `vertices: [V, width]`.
    pub(crate) fn add_slot<T: Scalar>(
        &self,
        vertices: &mut [T],
        by_face: &impl FaceSums<T::Wide>,
        slot: usize,
    ) {
        let (wide, narrow) = (vec![T::Wide::ZERO; 3 * self.width], vec![T::ZERO; 3 * self.width]);
        let mut add = |face, rows: &[T]| self.add_face(vertices, face, rows);
        self.walk(slot..slot + 1, by_face, &mut [], &|_, _, _| (), (wide, narrow), &mut add);
    }

    /// [`Layout::add_to`], and in the same walk `visit(slot, fragments, entries)` for each slot, with its
    /// fragments and their entries of `entries`: what a slot's fragments have upstream is then read from
    /// memory once. Each fragment has as many entries.
    #[inline(always)]
    pub(crate) fn add_to_and_visit<T: Scalar, F: FaceSums<T::Wide>>(
        &self,
        gradient: &mut Accumulator<T>,
        by_face: &F,
        lists: &Workbench<Vec<T>>,
        entries: &mut [T],
        visit: impl Fn(usize, Range<usize>, &mut [T]) + Send + Sync,
    ) {
        // Arrays have a length that the compiler knows; attributes of up to eight channels need no allocation.
        let length = 3 * self.width;
        match F::WIDTH.unwrap_or(self.width) {
            3 => {
                let memory = ([T::Wide::ZERO; 9], [T::ZERO; 9]);
                self.add_rows(gradient, by_face, lists, entries, visit, memory);
            }
            4 => {
                let memory = ([T::Wide::ZERO; 12], [T::ZERO; 12]);
                self.add_rows(gradient, by_face, lists, entries, visit, memory);
            }
            _ => {
                let wide: SmallVec<[T::Wide; 24]> = smallvec![T::Wide::ZERO; length];
                let narrow: SmallVec<[T; 24]> = smallvec![T::ZERO; length];
                self.add_rows(gradient, by_face, lists, entries, visit, (wide, narrow));
            }
        }
    }

    /// [`Layout::add_to_and_visit`] with memory for a face's three rows, in wide numbers and in narrow ones.
    fn add_rows<T: Scalar, W: RowMemory<T::Wide>, N: RowMemory<T>>(
        &self,
        gradient: &mut Accumulator<T>,
        by_face: &impl FaceSums<T::Wide>,
        lists: &Workbench<Vec<T>>,
        entries: &mut [T],
        visit: impl Fn(usize, Range<usize>, &mut [T]) + Send + Sync,
        memory: (W, N),
    ) {
        let vertices = gradient.entries();
        let mut add = |face: usize, rows: &[T]| self.add_face(vertices, face, rows);
        if !self.runs.is_shared() {
            let slots = 0..self.runs.slots.len();
            return self.walk(slots, by_face, entries, &visit, memory, &mut add);
        }
        let work = |slots: Range<usize>, _: usize, band_entries: &mut [T]| {
            let mut all_rows = lists.take();
            all_rows.clear();
            let memory = memory.clone();
            self.walk(slots, by_face, band_entries, &visit, memory, &mut |_, rows: &[T]| {
                all_rows.extend_from_slice(rows);
            });
            all_rows
        };
        let (own_width, length) = (per(self.runs.count, entries), 3 * self.width);
        let mut slots = self.runs.slots.iter();
        self.runs.merge_bands_mut(own_width, entries, work, |all_rows| {
            for (rows, slot) in all_rows.chunks_exact(length).zip(&mut slots) {
                add(slot.face as usize, rows);
            }
            lists.put_back(all_rows);
        });
    }

    /// Adds the rows of a face's vertices to `vertices: [V, width]`.
    #[inline(always)]
    fn add_face<T: Scalar>(&self, vertices: &mut [T], face: usize, rows: &[T]) {
        let are_finite = are_finite(rows);
        let width = rows.len() / 3;
        for (&vertex, row) in self.mesh.faces()[face].iter().zip(rows.chunks_exact(width)) {
            let entries = &mut vertices[vertex as usize * width..][..width];
            let pairs = entries.iter_mut().zip(row);
            if are_finite {
                pairs.for_each(|(entry, &term)| *entry += term);
            } else {
                pairs.for_each(|(entry, &term)| add_term(entry, term));
            }
        }
    }

    /// Calls `visit` with each of `slots`, and `emit` with its face and the gradients of its vertices.
    fn walk<T: Scalar>(
        &self,
        slots: Range<usize>,
        by_face: &impl FaceSums<T::Wide>,
        entries: &mut [T],
        visit: &impl Fn(usize, Range<usize>, &mut [T]),
        memory: (impl RowMemory<T::Wide>, impl RowMemory<T>),
        emit: &mut impl FnMut(usize, &[T]),
    ) {
        let runs = self.runs;
        let own_width = per(runs.fragments_of(slots.clone()).len(), entries);
        let (mut wide, mut narrow) = memory;
        crate::dispatch::dispatch::<T, _>(
            #[inline(always)]
            || {
                let (rows, narrow) = (wide.as_mut(), narrow.as_mut());
                let (mut rest, mut memory) = (entries, by_face.memory());
                for slot in slots {
                    let fragments = runs.fragments_of(slot..slot + 1);
                    let slot_entries = first_of(&mut rest, own_width * fragments.len());
                    visit(slot, fragments.clone(), slot_entries);
                    by_face.sum(&mut memory, slot, fragments.clone(), rows);
                    if !are_finite(rows) {
                        add_one_by_one(slot, fragments, by_face, &mut memory, rows);
                    }
                    narrow.iter_mut().zip(&*rows).for_each(|(to, &row)| *to = T::narrow(row));
                    emit(runs.face(slot), narrow);
                }
            },
        );
    }
}

/// How many of `entries` each of `count` fragments has.
fn per<T>(count: usize, entries: &[T]) -> usize {
    entries.len().checked_div(count).unwrap_or(0)
}

/// The first `count` entries of `rest`, which is left with the others.
#[inline(always)]
fn first_of<'a, T>(rest: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (first, others) = std::mem::take(rest).split_at_mut(count);
    *rest = others;
    first
}

/// The gradients of a face's vertices as a sum over single fragments: what is beyond the range of
/// the numbers is infinite then, not the difference of two infinite sums.
#[cold]
fn add_one_by_one<S: Scalar, F: FaceSums<S>>(
    slot: usize,
    fragments: Range<usize>,
    by_face: &F,
    memory: &mut F::Memory,
    rows: &mut [S],
) {
    rows.fill(S::ZERO);
    let mut terms = vec![S::ZERO; rows.len()];
    for fragment in fragments {
        by_face.sum(memory, slot, fragment..fragment + 1, &mut terms);
        rows.iter_mut().zip(&terms).for_each(|(row, &term)| add_term(row, term));
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;
    use crate::rasterize::rasterize;
    use crate::size::Size;

    /// The largest number, with the sign of every second fragment turned, and the signs apart: two
    /// infinite sums, where there are several fragments.
    struct Largest;

    impl FaceSums<f64> for Largest {
        type Memory = ();

        fn memory(&self) {}

        fn sum(&self, (): &mut (), _: usize, fragments: Range<usize>, rows: &mut [f64]) {
            let of = |odd: usize| fragments.clone().filter(|k| k % 2 == odd).count() as f64;
            rows.fill(of(0) * f64::MAX - of(1) * f64::MAX);
        }
    }

    #[test]
    fn infinite_sums_of_a_face_are_summed_again_fragment_by_fragment() {
        let tape = Tape::<f64>::new();
        let clip = vec![-1.0, -1.0, 0.0, 1.0, 3.0, -1.0, 0.0, 1.0, -1.0, 3.0, 0.0, 1.0];
        let clip = tape.leaf(&Tensor::new([3, 4], clip).unwrap());
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let coverage = rasterize(clip, &mesh, Size { width: 3, height: 5 }).unwrap().coverage;
        let layout = Layout { runs: &coverage.centers, mesh: &mesh, width: 2 };
        let mut found = Vec::new();
        let memory = ([0.0; 6], [0.0; 6]);
        layout.walk(0..1, &Largest, &mut [], &|_, _, _| (), memory, &mut |face, rows: &[f64]| {
            found.push((face, rows.to_vec()));
        });
        // Fifteen terms, in turns.
        assert_eq!(found, [(0, vec![f64::MAX; 6])]);
    }

    #[test]
    fn terms_beyond_the_range_stay_infinite_and_nan_stays_nan() {
        let sum = |terms: [f64; 3]| {
            let mut entry = 0.0;
            terms.into_iter().for_each(|term| add_term(&mut entry, term));
            entry
        };
        let inf = f64::INFINITY;
        assert_eq!(sum([1.0, 2.0, -4.0]), -1.0);
        assert_eq!(sum([1.0, inf, -inf]), inf);
        assert_eq!(sum([-inf, inf, 3.0]), -inf);
        assert!(sum([f64::NAN, inf, 1.0]).is_nan() && sum([inf, f64::NAN, -inf]).is_nan());
    }
}
