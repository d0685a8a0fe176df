//! Pieces as fragments: ordered by face, as all fragments are.

use bokashi_core::Scalar;

use super::pieces::Pieces;
use crate::run_reader::NO_SLOT;
use crate::runs::{Run, Slot};

/// The pieces of a band as fragments, counted from its first run, slot and fragment. A run is one piece.
#[derive(Debug, Default)]
pub(in crate::rasterize) struct PieceFragments<T> {
    /// In the order of their fragments, which have no numbers yet.
    pub(in crate::rasterize) runs: Vec<Run>,
    pub(in crate::rasterize) slots: Vec<Slot>,
    /// The weights u and v of each fragment.
    pub(in crate::rasterize) barycentrics: Vec<T>,
    /// The share of its pixel that each fragment covers.
    pub(in crate::rasterize) weights: Vec<T>,
    /// Per piece, pixel by pixel: its fragment.
    pub(in crate::rasterize) fragments: Vec<u32>,
    /// Per slot: where its next fragment goes.
    places: Vec<u32>,
}

impl<T: Scalar> PieceFragments<T> {
    /// Sorts `pieces` by face; those of one face stay in the order of their pixels. `slot_of` is
    /// memory.
    pub(in crate::rasterize) fn sort(
        &mut self,
        pieces: &Pieces<T::Wide>,
        faces: &[u32],
        slot_of: &mut Vec<u32>,
    ) {
        let Self { runs, slots, barycentrics, weights, fragments, places } = self;
        let count = pieces.pieces.len();
        slots.clear();
        places.clear();
        slot_of.clear();
        slot_of.resize(faces.len(), NO_SLOT);
        for piece in &pieces.pieces {
            let slot = &mut slot_of[piece.band_face as usize];
            if *slot == NO_SLOT {
                *slot = slots.len() as u32;
                let face = faces[piece.band_face as usize];
                slots.push(Slot { face, first_run: 0, first_fragment: 0 });
                places.push(0);
            }
            places[*slot as usize] += 1;
        }
        // A counting sort, as in `canvas`: counts become the places where each slot begins.
        let mut before = 0;
        for (slot, position) in slots.iter_mut().zip(places.iter_mut()) {
            slot.first_run = before;
            before += std::mem::replace(position, before);
        }
        runs.clear();
        runs.resize(count, Run::default());
        barycentrics.clear();
        barycentrics.resize(2 * count, T::ZERO);
        weights.clear();
        weights.resize(count, T::ZERO);
        fragments.clear();
        let mut first = 0;
        for (&pixel, &end) in pieces.pixels.iter().zip(&pieces.ends) {
            for piece in &pieces.pieces[first..end as usize] {
                let slot = slot_of[piece.band_face as usize];
                let fragment = places[slot as usize];
                places[slot as usize] += 1;
                let index = fragment as usize;
                runs[index] = Run { slot, pixel, length: 1, fragment: 0 };
                let [u, v] = piece.barycentrics.map(T::narrow);
                (barycentrics[2 * index], barycentrics[2 * index + 1]) = (u, v);
                weights[index] = T::narrow(piece.weight());
                fragments.push(fragment);
            }
            first = end as usize;
        }
    }
}
