//! What boundary pixels fall into.

use bokashi_core::Scalar;

use super::extent::Extent;
use super::parts::Side;

/// A visible part of a face in a pixel.
#[derive(Debug, Clone, Copy)]
pub(in crate::rasterize) struct Piece<S> {
    /// The position of its face among those of the band.
    pub(in crate::rasterize) band_face: u32,
    /// Its area in scaled coordinates, in which a pixel has 4.
    pub(super) area: S,
    /// From the pixel's centre.
    pub(super) extent: Extent<S>,
    /// Whether its extent moves with its sides.
    pub(super) moves: bool,
    /// The means of the weights of its face's vertices 0 and 1.
    pub(in crate::rasterize) barycentrics: [S; 2],
}

impl<S: Scalar> Piece<S> {
    /// The share of the pixel that it covers.
    pub(in crate::rasterize) fn weight(&self) -> S {
        S::from_f64(0.25) * self.area
    }
}

/// A side of a piece that moves with a face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment<S> {
    /// The piece, counted from the pixel's first.
    pub(super) piece: u32,
    pub(super) side: Side<S>,
}

/// What is found in the boundary pixels of a band.
#[derive(Debug, Default)]
pub(in crate::rasterize) struct Pieces<S> {
    /// The pixels, in order.
    pub(in crate::rasterize) pixels: Vec<u32>,
    /// Of these, those whose pieces all have no area.
    pub(in crate::rasterize) unseen: Vec<u32>,
    /// Where the pieces of each pixel end.
    pub(in crate::rasterize) ends: Vec<u32>,
    /// The pieces pixel by pixel, the largest first.
    pub(in crate::rasterize) pieces: Vec<Piece<S>>,
    /// Where the segments of each pixel end, and the segments; none where no gradient is asked for.
    pub(super) segment_ends: Vec<u32>,
    pub(super) segments: Vec<Segment<S>>,
    /// How many pieces were dropped.
    pub(in crate::rasterize) dropped: usize,
    /// How many pixels were cut into cells, and what area of them was sampled, in pixels.
    pub(in crate::rasterize) crowded: usize,
    pub(in crate::rasterize) sampled: f64,
}

impl<S> Pieces<S> {
    /// The bytes that a backward pass reads.
    pub(in crate::rasterize) fn bytes(&self) -> usize {
        let places = self.pixels.len() + self.ends.len() + self.segment_ends.len();
        size_of::<u32>() * places
            + size_of::<Piece<S>>() * self.pieces.len()
            + size_of::<Segment<S>>() * self.segments.len()
    }

    pub(super) fn clear(&mut self) {
        self.pixels.clear();
        self.unseen.clear();
        self.ends.clear();
        self.pieces.clear();
        self.segment_ends.clear();
        self.segments.clear();
        self.dropped = 0;
        self.crowded = 0;
        self.sampled = 0.0;
    }
}
