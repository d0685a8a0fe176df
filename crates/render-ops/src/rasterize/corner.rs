//! A vertex, as every face at it asks for it.

use std::ops::Range;

use bokashi_core::Scalar;

use crate::homogeneous::Vertex;
use crate::order::{largest, least};
use crate::size::Size;

/// A vertex, and what every face at it asks of it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner<S> {
    pub(super) vertex: Vertex<S>,
    /// What the vertex was multiplied by.
    pub(super) factor: S,
    /// The view's bounding planes that it lies beyond, one bit each, and [`UNUSUAL`].
    pub(super) beyond: u8,
    /// In pixels from the centre of the first pixel; means nothing behind the eye.
    pub(super) pixel: [f64; 2],
}

/// How far from the near and the far plane the depth of a tame vertex is: far more than the rounding of depths.
const MARGIN: f64 = 1e-4;

/// The w of tame vertices: numbers of 32 bits hold products of three.
const TAME_W: std::ops::Range<f64> = 1e-12..1e12;

/// The bit of [`Corner::beyond`] for a vertex behind the eye.
pub(super) const BEHIND: u8 = 1;

/// The bits of [`Corner::beyond`] for a vertex beyond the far plane, and before the near plane.
const BEYOND_FAR: u8 = 1 << 5;
const BEFORE_NEAR: u8 = 1 << 6;

/// The bit of [`Corner::beyond`] for a vertex that is close to the near or far plane, was multiplied, or whose w is
/// not among [`TAME_W`].
pub(super) const UNUSUAL: u8 = 1 << 7;

impl<S: Scalar<Wide = S>> Corner<S> {
    /// Vertex `index` of `clip: [V, 4]`.
    #[inline(always)]
    pub(super) fn new<T: Scalar<Wide = S>>(clip: &[T], index: u32, size: Size) -> Self {
        let (vertex, factor) = Vertex::from_clip(clip, index, size);
        let Vertex { x, y, z, w } = vertex;
        let [width, height] = size.extents::<S>();
        let (right, top) = (width * w, height * w);
        let inner = S::from_f64(1.0 - MARGIN) * w;
        let is_unusual = z < -inner
            || z > inner
            || factor != S::ONE
            || w < S::from_f64(TAME_W.start)
            || w > S::from_f64(TAME_W.end);
        // One after another: of a list of planes the compiler makes bytes, which it then takes apart.
        let bit = |is_beyond: bool, bit: u8| u8::from(is_beyond) * bit;
        let beyond = bit(w <= S::ZERO, BEHIND)
            | bit(x > right, 1 << 1)
            | bit(x < -right, 1 << 2)
            | bit(y > top, 1 << 3)
            | bit(y < -top, 1 << 4)
            | bit(z > w, BEYOND_FAR)
            | bit(z < -w, BEFORE_NEAR)
            | bit(is_unusual, UNUSUAL);
        let pixel = |scaled: S, extent: S| 0.5 * (scaled.to_f64() + extent.to_f64() - 1.0);
        let pixel = [pixel(x / w, width), pixel(-y / w, height)];
        Self { vertex, factor, beyond, pixel }
    }

    /// Whether the vertex is in view and neither close to the near or far plane nor extreme.
    #[inline(always)]
    pub(super) fn is_tame(&self) -> bool {
        self.beyond == 0
    }

    /// z / w, of a tame vertex.
    #[inline(always)]
    pub(super) fn depth(&self) -> f64 {
        self.vertex.z.to_f64() / self.vertex.w.to_f64()
    }

    /// Whether the vertex lies before the near plane, beyond the far plane, or behind the eye.
    pub(super) fn is_beyond_depths(&self) -> bool {
        self.beyond & (BEHIND | BEYOND_FAR | BEFORE_NEAR) != 0
    }

    /// The columns and rows of the pixels that the line between two points can touch, where neither
    /// is behind the eye.
    pub(super) fn pixels_between(
        [a, b]: [&Self; 2],
        Size { width, height }: Size,
    ) -> Option<[Range<usize>; 2]> {
        if (a.beyond | b.beyond) & BEHIND != 0 {
            return None;
        }
        let touched = |axis: usize, extent| {
            let [a, b] = [a, b].map(|corner| corner.pixel[axis]);
            let [first, last] = touched([a, b, b], extent, HALF_A_PIXEL);
            first as usize..last as usize + 1
        };
        Some([touched(0, width), touched(1, height)])
    }
}

/// Gives all corners the same factor, where their sizes are near enough, so that a mesh times a power
/// of two is the same in every bit. Two things depend on a face's factors: the size below which its
/// edge functions are uncertain, and the order in which a long row is summed.
pub(super) fn give_one_factor<S: Scalar<Wide = S>>(corners: &mut [Corner<S>]) {
    let factors = || corners.iter().map(|corner| corner.factor);
    if factors().all(|factor| factor == S::ONE) {
        return;
    }
    let (least, most) = (
        factors().fold(S::from_f64(f64::INFINITY), S::minimum_or_nan),
        factors().fold(S::ZERO, S::maximum_or_nan),
    );
    // About 1e-60 and 1e60, where a vertex starts to be multiplied, factors leap by as much. Products
    // of three coordinates stay within the range of the numbers down to a fraction of 1e-80.
    if least < most * S::from_f64(1e-80) {
        return;
    }
    for corner in corners {
        corner.vertex = corner.vertex.scaled(least / corner.factor);
        corner.factor = least;
        corner.beyond |= UNUSUAL;
    }
}

/// What a pixel reaches beyond its centre.
pub(super) const HALF_A_PIXEL: f64 = 0.5;

/// Far more than the roundings of a coordinate within the image, far less than a pixel.
pub(super) const ROUNDING_OF_PIXELS: f64 = 1e-6;

/// The first and last of `extent` pixels whose centres can lie between the smallest and the largest
/// of three coordinates in pixels, or up to `margin` beyond. Where there is no such pixel, the last
/// comes before the first.
#[inline(always)]
pub(super) fn touched(pixel: [f64; 3], extent: usize, margin: f64) -> [u32; 2] {
    let margin = margin + ROUNDING_OF_PIXELS;
    let (low, high) = (least(pixel) - margin, largest(pixel) + margin);
    let most = f64::from(extent as u32) - 1.0;
    let first = if low > 0.0 { low.ceil() } else { 0.0 };
    let last = if high < most { high.floor() } else { most };
    if first <= last { [first as u32, last as u32] } else { [1, 0] }
}
