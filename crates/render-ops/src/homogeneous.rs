//! Points and lines of the image plane in homogeneous coordinates.
//!
//! With a vertex `(x, y, w)` in scaled coordinates and a pixel centre `(X, Y)`, the vertex relative
//! to the pixel is `q = (x - X w, y - Y w)`, and the edge from vertex 1 to vertex 2 is
//! `a = q1 x q2`: positive on its left, zero on the line. No division by `w`, so that vertices
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
    /// Vertex `index` of the rows of `clip: [V, 4]`.
    pub(crate) fn of<T: Scalar<Wide = S>>(clip: &[T], index: u32, size: Size) -> Self {
        let [x, y, z, w] = std::array::from_fn(|k| clip[4 * index as usize + k].widen());
        let (width, height) = (S::from_f64(size.width as f64), S::from_f64(size.height as f64));
        Self { x: x * width, y: y * height, z, w }
    }

    /// Every coordinate times `factor`: the same point.
    pub(crate) fn scaled(self, factor: S) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor, w: self.w * factor }
    }

    /// The vertex relative to the pixel centre `(x, y)`.
    pub(crate) fn relative_to(self, x: S, y: S) -> [S; 2] {
        [self.x - x * self.w, self.y - y * self.w]
    }
}

/// The cross product of two plane vectors.
pub(crate) fn cross<S: Scalar>(a: [S; 2], b: [S; 2]) -> S {
    a[0] * b[1] - a[1] * b[0]
}

/// Vertices of a face times a power of two that brings their coordinates near 1, and that
/// factor: 1 but where products of three coordinates would leave the range of the numbers. It
/// changes no weight and no depth.
pub(crate) fn in_range<S: Scalar<Wide = S>, const N: usize>(
    vertices: [Vertex<S>; N],
) -> ([Vertex<S>; N], S) {
    let largest = vertices
        .iter()
        .flat_map(|vertex| [vertex.x, vertex.y, vertex.w])
        .map(|coordinate| coordinate.abs().to_f64())
        .fold(0.0, f64::max);
    if largest == 0.0 || (1e-60..1e60).contains(&largest) {
        return (vertices, S::ONE);
    }
    // 2^-1074 would need a factor beyond the range; near it will do.
    let factor = S::from_f64(f64::powi(2.0, -(largest.log2() as i32).clamp(-1000, 1000)));
    (vertices.map(|vertex| vertex.scaled(factor)), factor)
}
