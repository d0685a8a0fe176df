//! Sums over fragments, by face.
//!
//! Neighbouring fragments mostly lie on one face: a *run*. Backward passes sum a run's terms
//! first and add the sum to the face's three vertices once. Runs are cut by fixed sizes and added
//! in their order, so the result is bitwise the same for any number of threads.

use std::ops::Range;

use bokashi_core::parallel::{is_shared, merge_ranges};
use bokashi_core::{Accumulator, Scalar};

use crate::fragments::Coverage;
use crate::mesh::Mesh;

/// Fragments in one piece of work: some tens of microseconds.
const FRAGMENTS_PER_PIECE: usize = 1 << 12;

/// Adds a term to an entry of a gradient. A term beyond the range of the numbers is infinite, and
/// so is the entry from then on: another one of the opposite sign leaves it as it is, for their sum
/// would be NaN. What is NaN stays so.
#[inline]
pub(crate) fn add_term<T: Scalar>(entry: &mut T, term: T) {
    if term.is_finite() || *entry != -term {
        *entry += term;
    }
}

/// Sums over the runs of a coverage, added to rows per vertex.
pub(crate) struct RunSums<'a> {
    pub(crate) coverage: &'a Coverage,
    /// The vertices that a face's sums belong to.
    pub(crate) mesh: &'a Mesh,
    /// Numbers per vertex.
    pub(crate) width: usize,
}

impl RunSums<'_> {
    /// For each run, `sum(face, fragments, sums)` writes `sums: [3, width]`, zeros at first, and
    /// row k is added to the gradient of the face's vertex k, `gradient: [V, width]`.
    pub(crate) fn add_to<T: Scalar>(
        &self,
        gradient: &mut Accumulator<T>,
        sum: impl Fn(usize, Range<usize>, &mut [T::Wide]) + Send + Sync,
    ) {
        let entries = gradient.entries();
        let faces = &self.coverage.faces;
        let width = self.width;
        let mut add = |face: usize, sums: &[T::Wide]| {
            for (&vertex, sums) in self.mesh.faces()[face].iter().zip(sums.chunks_exact(width)) {
                let row = &mut entries[vertex as usize * width..][..width];
                row.iter_mut().zip(sums).for_each(|(entry, &sum)| add_term(entry, T::narrow(sum)));
            }
        };
        let walk = |range: Range<usize>, emit: &mut dyn FnMut(usize, &[T::Wide])| {
            // Attributes of up to eight channels need no allocation.
            let mut few = [T::Wide::ZERO; 24];
            let mut many = Vec::new();
            let sums: &mut [T::Wide] = if 3 * width <= few.len() {
                &mut few[..3 * width]
            } else {
                many.resize(3 * width, T::Wide::ZERO);
                &mut many
            };
            let mut start = range.start;
            for run in faces[range].chunk_by(|left, right| left == right) {
                sums.fill(T::Wide::ZERO);
                sum(run[0] as usize, start..start + run.len(), sums);
                emit(run[0] as usize, sums);
                start += run.len();
            }
        };

        if !is_shared(faces.len(), FRAGMENTS_PER_PIECE) {
            merge_ranges(
                faces.len(),
                FRAGMENTS_PER_PIECE,
                |range| range,
                |range| walk(range, &mut add),
            );
            return;
        }
        let work = |range| {
            let (mut run_faces, mut run_sums) = (Vec::new(), Vec::new());
            walk(range, &mut |face, sums| {
                run_faces.push(face);
                run_sums.extend_from_slice(sums);
            });
            (run_faces, run_sums)
        };
        merge_ranges(faces.len(), FRAGMENTS_PER_PIECE, work, |(run_faces, run_sums)| {
            for (&face, sums) in run_faces.iter().zip(run_sums.chunks_exact(3 * width)) {
                add(face, sums);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
