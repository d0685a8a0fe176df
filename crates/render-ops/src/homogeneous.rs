//! Points and lines of the image plane in homogeneous coordinates.
//!
//! Let `(x, y, w)` be a vertex in scaled coordinates, and `(X, Y)` a pixel centre. The vertex
//! relative to the pixel is `q = (x - X w, y - Y w)`. The edge from vertex 1 to vertex 2 is
//! `a = q1 x q2`: positive on its left, zero on the line. Nothing is divided by `w`, so that vertices
//! behind the eye need no clipping.
//!
//! # Source
//! Olano and Greer, *Triangle scan conversion using 2D homogeneous coordinates*, Graphics Hardware
//! 1997.

use bokashi_core::Scalar;

use crate::size::Size;

/// A vertex in clip space with x times the image's width and y times its height.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Vertex<S> {
    pub(crate) x: S,
    pub(crate) y: S,
    pub(crate) z: S,
    pub(crate) w: S,
}

impl<S: Scalar<Wide = S>> Vertex<S> {
    /// Vertex `index` of the rows of `clip: [V, 4]`, times a power of two, and that factor. The
    /// factor is 1 unless products of three coordinates would leave the range of the numbers, or a
    /// coordinate times the image's extent would. A vertex times a positive number is the same point,
    /// so it changes no edge's sign, no crossing and no depth. Weights are per vertex, and take the
    /// factor back (see [`missing_factors`]).
    #[inline(always)]
    pub(crate) fn from_clip<T: Scalar<Wide = S>>(clip: &[T], index: u32, size: Size) -> (Self, S) {
        let vertex = Self::in_range(clip, index, size);
        let [x, y, z, w] = row(clip, index);
        let [a, b, c] = [x, y, w].map(|coordinate| coordinate.abs().to_f64());
        let largest = if a > b { a } else { b };
        let largest = if largest > c { largest } else { c };
        // No f32 is so small or so large.
        let are_in_range = !T::from_f64(1e60).is_finite();
        if are_in_range || largest == 0.0 || (1e-60..1e60).contains(&largest) {
            return (vertex, S::ONE);
        }
        Self::scaled_to_range([x, y, z, w], largest, size)
    }

    /// [`Self::from_clip`] of a vertex whose factor is 1.
    #[inline(always)]
    pub(crate) fn in_range<T: Scalar<Wide = S>>(clip: &[T], index: u32, size: Size) -> Self {
        let [x, y, z, w] = row(clip, index);
        let [width, height] = size.extents::<S>();
        Self { x: x * width, y: y * height, z, w }
    }

    #[cold]
    #[inline(never)]
    fn scaled_to_range([x, y, z, w]: [S; 4], largest: f64, size: Size) -> (Self, S) {
        let [width, height] = size.extents::<S>();
        // 2^-1074 would need a factor beyond the range; near it will do.
        let factor = S::from_f64(f64::powi(2.0, -(largest.log2() as i32).clamp(-1000, 1000)));
        let [x, y, z, w] = [x, y, z, w].map(|coordinate| factor * coordinate);
        (Self { x: x * width, y: y * height, z, w }, factor)
    }

    /// The vertices of a face, and their factors.
    pub(crate) fn from_face<T: Scalar<Wide = S>>(
        clip: &[T],
        face: [u32; 3],
        size: Size,
    ) -> ([Self; 3], [S; 3]) {
        let pairs = face.map(|index| Self::from_clip(clip, index, size));
        (pairs.map(|(vertex, _)| vertex), pairs.map(|(_, factor)| factor))
    }

    /// The vertex relative to the pixel centre `(x, y)`.
    pub(crate) fn relative_to(self, x: S, y: S) -> [S; 2] {
        [self.x - x * self.w, self.y - y * self.w]
    }

    /// The vertex in coordinates from the origin `(x, y)`.
    #[inline(always)]
    pub(crate) fn around(self, [x, y]: [S; 2]) -> Self {
        let [x, y] = self.relative_to(x, y);
        Self { x, y, ..self }
    }
}

/// Row `index` of `clip: [V, 4]`.
#[inline(always)]
fn row<T: Scalar>(clip: &[T], index: u32) -> [T::Wide; 4] {
    let [x, y, z, w] = clip.as_chunks::<4>().0[index as usize];
    [x.widen(), y.widen(), z.widen(), w.widen()]
}

/// Whether a face's vertices were all multiplied by the same.
#[inline(always)]
pub(crate) fn are_one<S: Scalar>([p, q, r]: [S; 3]) -> bool {
    p == q && p == r
}

impl<S: Scalar> Vertex<S> {
    /// The vertex `(x, y, w)` in clip space, times no factor.
    #[inline(always)]
    pub(crate) fn unscaled([x, y, w]: [S; 3], size: Size) -> Self {
        let [width, height] = size.extents::<S>();
        Self { x: x * width, y: y * height, z: S::ZERO, w }
    }

    /// The vertex times `factor`.
    pub(crate) fn scaled(self, factor: S) -> Self {
        let Self { x, y, z, w } = self;
        Self { x: factor * x, y: factor * y, z: factor * z, w: factor * w }
    }
}

/// The cross product of two plane vectors.
pub(crate) fn cross<S: Scalar>(a: [S; 2], b: [S; 2]) -> S {
    a[0] * b[1] - a[1] * b[0]
}

/// The coefficients of the edge function from `p` to `q`: of 1, X and Y.
#[inline(always)]
pub(crate) fn edge<S: Scalar>(p: Vertex<S>, q: Vertex<S>) -> [S; 3] {
    [p.x * q.y - p.y * q.x, p.y * q.w - p.w * q.y, p.w * q.x - p.x * q.w]
}

/// The determinant of three vertices: `p`, and those of `edge`.
#[inline(always)]
pub(crate) fn determinant<S: Scalar>(p: Vertex<S>, [e, ex, ey]: [S; 3]) -> S {
    p.w * e + p.x * ex + p.y * ey
}

/// The largest that `|q_x|` and `|q_y|` of a vertex relative to a pixel centre can be.
#[inline(always)]
pub(crate) fn extent<S: Scalar>(vertex: Vertex<S>, size: Size) -> [S; 2] {
    let [width, height] = size.extents::<S>();
    let w = vertex.w.abs();
    [vertex.x.abs() + width * w, vertex.y.abs() + height * w]
}

/// More than the rounding errors of the edge function from `p` to `q`, or from `q` to `p`, anywhere
/// in the image. It holds for edge functions from coefficients and from vertices relative to a pixel
/// centre: some ten roundings of products of at most this size.
#[inline(always)]
pub(crate) fn edge_error_bound<S: Scalar<Wide = S>>(p: Vertex<S>, q: Vertex<S>, size: Size) -> S {
    let ([px, py], [qx, qy]) = (extent(p, size), extent(q, size));
    S::from_f64(8.0 * f64::EPSILON) * (px * qy + py * qx)
}

/// What the edge functions `a` of vertices that were multiplied by `factors` lack, up to a factor
/// they share, to be weights: `a_i` has the factors of the two other vertices, and not its own.
#[inline]
pub(crate) fn missing_factors<S: Scalar>(a: [S; 3], factors: [S; 3]) -> [S; 3] {
    if are_one(factors) { [S::ONE; 3] } else { relative_factors(a, factors) }
}

/// The factors relative to the largest factor that counts, so that the weights neither overflow nor
/// vanish all three.
#[cold]
fn relative_factors<S: Scalar>(a: [S; 3], factors: [S; 3]) -> [S; 3] {
    let counting = (0..3).filter(|&k| a[k] != S::ZERO).map(|k| factors[k]);
    let largest = counting.fold(S::ZERO, S::maximum_or_nan);
    if largest == S::ZERO {
        return [S::ONE; 3];
    }
    // A factor that doesn't count may be larger than any number times the largest factor that does.
    let most = S::from_f64(f64::powi(2.0, 1000));
    factors.map(|factor| (factor / largest).minimum_or_nan(most))
}
