//! A vertex, as every face at it asks for it.

use std::ops::Range;

use bokashi_core::Scalar;

use crate::homogeneous::Vertex;
use crate::order::{largest, least};
use crate::size::Size;

/// A vertex of a face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner<S> {
    pub(super) vertex: Vertex<S>,
    /// What the vertex was multiplied by.
    pub(super) factor: S,
}

/// How far from the near and the far plane the depth of a tame vertex is: far more than the rounding of depths.
const MARGIN: f64 = 1e-4;

/// The w of tame vertices: numbers of 32 bits hold products of three.
const TAME_W: Range<f64> = 1e-12..1e12;

/// The bit of [`Corner::beyond`] for a vertex behind the eye.
pub(super) const BEHIND: u8 = 1;

impl<S: Scalar<Wide = S>> Corner<S> {
    /// Vertex `index` of `clip: [V, 4]`.
    #[inline(always)]
    pub(super) fn new<T: Scalar<Wide = S>>(clip: &[T], index: u32, size: Size) -> Self {
        let (vertex, factor) = Vertex::from_clip(clip, index, size);
        Self { vertex, factor }
    }

    /// The view's bounding planes that the vertex lies beyond, one bit each.
    pub(super) fn beyond(&self, size: Size) -> u8 {
        let Vertex { x, y, z, w } = self.vertex;
        let [width, height] = size.extents::<S>();
        let (right, top) = (width * w, height * w);
        let are_beyond = [w <= S::ZERO, x > right, x < -right, y > top, y < -top, z > w, z < -w];
        are_beyond.into_iter().rev().fold(0, |bits, is_beyond| bits << 1 | u8::from(is_beyond))
    }

    /// Whether the vertex is in view and neither close to the near or far plane nor extreme.
    #[inline(always)]
    pub(super) fn is_tame(&self, size: Size) -> bool {
        let Vertex { x, y, z, w } = self.vertex;
        let [width, height] = size.extents::<S>();
        let inner = S::from_f64(1.0 - MARGIN) * w;
        (x.abs() <= width * w)
            & (y.abs() <= height * w)
            & (z.abs() <= inner)
            & (w >= S::from_f64(TAME_W.start))
            & (w <= S::from_f64(TAME_W.end))
            & (self.factor == S::ONE)
    }

    /// z / w, of a tame vertex.
    #[inline(always)]
    pub(super) fn depth(&self) -> f64 {
        self.vertex.z.to_f64() / self.vertex.w.to_f64()
    }

    /// In pixels from the centre of the first pixel; means nothing behind the eye.
    #[inline(always)]
    pub(super) fn pixel(&self, size: Size) -> [f64; 2] {
        let Vertex { x, y, w, .. } = self.vertex;
        let [width, height] = size.extents::<S>();
        let pixel = |scaled: S, extent: S| 0.5 * (scaled.to_f64() + extent.to_f64() - 1.0);
        [pixel(x / w, width), pixel(-y / w, height)]
    }

    /// Whether the vertex lies before the near plane, beyond the far plane, or behind the eye.
    #[inline(always)]
    pub(super) fn is_beyond_depths(&self) -> bool {
        let Vertex { z, w, .. } = self.vertex;
        w <= S::ZERO || z.abs() > w
    }

    /// The columns and rows of the pixels that the line between two points can touch, where neither
    /// is behind the eye.
    pub(super) fn pixels_between(ends: [&Self; 2], size: Size) -> Option<[Range<usize>; 2]> {
        if ends.iter().any(|corner| corner.vertex.w <= S::ZERO) {
            return None;
        }
        let [a, b] = ends.map(|corner| corner.pixel(size));
        let touched = |axis: usize, extent| {
            let [first, last] = touched([a[axis], b[axis], b[axis]], extent, HALF_A_PIXEL);
            first as usize..last as usize + 1
        };
        Some([touched(0, size.width), touched(1, size.height)])
    }
}

/// The vertices of a mesh, as its faces ask for them: worked out anew each time. Positions take less memory than corners,
/// and to read memory takes longer than to compute.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClipVertices<'a, T: Scalar> {
    /// `[V, 4]`
    clip: &'a [T],
    pub(super) size: Size,
    scaling: Scaling<T::Wide>,
}

/// What vertices are multiplied by.
#[derive(Debug, Clone, Copy, Default)]
pub(super) enum Scaling<S> {
    /// Each by its own factor.
    #[default]
    Own,
    /// All by 1.
    One,
    /// All by the same.
    Common(S),
}

impl<S: Scalar<Wide = S>> Scaling<S> {
    /// That of all vertices, of whose own factors these are the smallest and the largest: where their sizes are near
    /// enough, the same, so that a mesh times a power of two is the same in every bit.
    ///
    /// Two things depend on a face's factors: the size below which its edge functions are uncertain, and the order in
    /// which a long row is summed.
    pub(super) fn new([least, most]: [S; 2]) -> Self {
        // About 1e-60 and 1e60, where a vertex starts to be multiplied, factors leap by as much. Products
        // of three coordinates stay within the range of the numbers down to a fraction of 1e-80.
        if least < most * S::from_f64(1e-80) {
            Self::Own
        } else if least == S::ONE && most == S::ONE || least > most {
            // Or there are none.
            Self::One
        } else {
            Self::Common(least)
        }
    }
}

impl<'a, T: Scalar> ClipVertices<'a, T> {
    #[inline(always)]
    pub(super) fn new(clip: &'a [T], size: Size, scaling: Scaling<T::Wide>) -> Self {
        Self { clip, size, scaling }
    }

    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.clip.len() / 4
    }

    #[inline(always)]
    pub(super) fn corner(&self, vertex: u32) -> Corner<T::Wide> {
        match self.scaling {
            Scaling::One => {
                let vertex = Vertex::in_range(self.clip, vertex, self.size);
                Corner { vertex, factor: T::Wide::ONE }
            }
            Scaling::Own => Corner::new(self.clip, vertex, self.size),
            Scaling::Common(factor) => {
                let corner = Corner::new(self.clip, vertex, self.size);
                Corner { vertex: corner.vertex.scaled(factor / corner.factor), factor }
            }
        }
    }

    /// Those of a face.
    #[inline(always)]
    pub(super) fn corners_of(&self, [p, q, r]: [u32; 3]) -> [Corner<T::Wide>; 3] {
        // Not by `map`, which can be a call.
        [self.corner(p), self.corner(q), self.corner(r)]
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
