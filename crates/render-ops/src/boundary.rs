//! The pixels that exact coverage resolves into pieces.

use std::sync::Arc;

/// The pixels that are resolved into pieces.
#[derive(Debug, Clone, Default)]
pub(crate) struct Boundary {
    /// The pixels, in order; shared with pictures.
    pub(crate) pixels: Arc<Vec<u32>>,
    /// Where in `fragments` the fragments of each pixel end.
    pub(crate) ends: Vec<u32>,
    /// The fragments of each pixel, the largest piece first.
    pub(crate) fragments: Vec<u32>,
    /// The pixels whose pieces all have no area, in order.
    pub(crate) unseen: Vec<u32>,
    pub(crate) counts: BoundaryCounts,
}

impl Boundary {
    /// The fragments of the boundary pixel `index`.
    pub(crate) fn fragments_of(&self, index: usize) -> &[u32] {
        let first = index.checked_sub(1).map_or(0, |before| self.ends[before]);
        &self.fragments[first as usize..self.ends[index] as usize]
    }

    /// The fragment of the largest piece of the boundary pixel `index`, where a piece has an area.
    pub(crate) fn largest_of(&self, index: usize) -> Option<u32> {
        let is_seen = self.unseen.binary_search(&self.pixels[index]).is_err();
        self.fragments_of(index).first().copied().filter(|_| is_seen)
    }

    /// Each boundary pixel with its fragments.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (usize, &[u32])> + Clone + '_ {
        (0..self.pixels.len()).map(|index| (self.pixels[index] as usize, self.fragments_of(index)))
    }

    /// Forgets all pixels, and gives the list to fill again.
    pub(crate) fn clear(&mut self) {
        match Arc::get_mut(&mut self.pixels) {
            Some(pixels) => pixels.clear(),
            None => self.pixels = Arc::default(),
        }
        self.ends.clear();
        self.fragments.clear();
        self.unseen.clear();
        self.counts = BoundaryCounts::default();
    }
}

/// How pixels were resolved into pieces.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct BoundaryCounts {
    /// Pixels that a discontinuity may cross.
    pub pixels: usize,
    /// Their pieces, fragments each: visible pieces, and pieces of no area beside sides on borders.
    pub pieces: usize,
    /// Pieces that were dropped: smaller than 1e-14 of a pixel, but not so thin that rounding leaves
    /// nothing of them. What lies behind a pixel's front is not looked at, and not counted.
    pub dropped: usize,
    /// Pixels in whose front there are so many faces that they were cut into smaller cells. They are as
    /// exact as all others, but for what was sampled.
    pub crowded: usize,
    /// The area, in pixels, that shows what lies at samples, since too many faces meet there. It bounds
    /// the error: no pixel is off by more than this times the range of the values there, nor is the sum
    /// over all pixels. The gradient lacks the sides there. In most images it is 0.
    pub sampled: f64,
}
