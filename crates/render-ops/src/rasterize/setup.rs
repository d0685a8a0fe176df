//! What a face needs before its pixels are visited.
//!
//! The edge function that faces corner 0 is `a_0(X, Y) = q_1 x q_2 = e_0 + e_1 X + e_2 Y` with
//! `e = (x_1 y_2 - y_1 x_2, y_1 w_2 - w_1 y_2, w_1 x_2 - x_1 w_2)`, and cyclic. The
//! determinant of the three vertices is `D = sum_i w_i a_i(X, Y)` at every (X, Y). A pixel centre is
//! covered where all `a_i` have the sign of D: then its weights `a_i / sum a` are positive and so
//! is `w = D / sum a`.
//!
//! Two faces at an edge see the same products, swapped, so their edge functions are exact
//! opposites and no pixel centre is lost or drawn twice between them. One exactly on an edge
//! belongs to the face to whose inside it would move if it were shifted by a little to the right,
//! and by far less downwards (the top-left rule).
//!
//! Faces around a vertex must agree too. The coefficients carry the rounding of the distance from
//! the image's middle to the vertices, so near a vertex the signs of several edges' functions are
//! accidents. Where an edge function is smaller than that rounding it is worked out again, as
//! `q_1 x q_2`: all faces see the same `q`, rounded once per vertex, and the cross product of two
//! vectors is right to within the rounding of their own lengths.

use bokashi_core::Scalar;

use super::{Cull, RasterOptions};
use crate::fragments::Culled;
use crate::homogeneous::{Vertex, cross, missing_factors};
use crate::mesh::{Mesh, repeats_a_vertex};
use crate::size::Size;

/// A face that may cover pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setup<S> {
    pub(super) face: u32,
    vertices: [Vertex<S>; 3],
    /// What the vertices were multiplied by.
    factors: [S; 3],
    /// 1 or -1, which makes the edge functions positive inside.
    sign: S,
    /// The edge functions' coefficients, with that sign.
    edges: [[S; 3]; 3],
    /// The size below which the sign of an edge function is in doubt.
    doubt: [S; 3],
    /// Whether a pixel centre exactly on the edge is covered.
    owns_edge: [bool; 3],
    /// The columns and rows, first and last, that the face can touch.
    pub(super) columns: [usize; 2],
    pub(super) rows: [usize; 2],
}

/// What a pixel centre sees of a face.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample<S> {
    pub(super) u: S,
    pub(super) v: S,
    /// z / w.
    pub(super) depth: S,
}

impl<S: Scalar<Wide = S>> Setup<S> {
    /// The setup of face `face`, or `None`, counted in `culled`, where it covers nothing.
    pub(super) fn of<T: Scalar<Wide = S>>(
        clip: &[T],
        mesh: &Mesh,
        face: usize,
        options: RasterOptions,
        culled: &mut Culled,
    ) -> Option<Self> {
        let indices = mesh.faces()[face];
        if repeats_a_vertex(indices) {
            culled.degenerate += 1;
            return None;
        }
        let (vertices, factors) = Vertex::of_face(clip, indices, options.size);
        let Some((columns, rows)) = touched_pixels(&vertices, options.size) else {
            culled.outside += 1;
            return None;
        };

        let edges: [[S; 3]; 3] = std::array::from_fn(|corner| {
            let (p, q) = (vertices[(corner + 1) % 3], vertices[(corner + 2) % 3]);
            [p.x * q.y - p.y * q.x, p.y * q.w - p.w * q.y, p.w * q.x - p.x * q.w]
        });
        let doubt: [S; 3] = std::array::from_fn(|corner| {
            doubt(vertices[(corner + 1) % 3], vertices[(corner + 2) % 3], options.size)
        });
        // D = sum_i w_i a_i, so its rounding errors are below sum_i |w_i| doubt_i; where it is no
        // larger, its sign is one of them.
        let first = vertices[0];
        let determinant = first.w * edges[0][0] + first.x * edges[0][1] + first.y * edges[0][2];
        let noise: S =
            vertices.iter().zip(doubt).map(|(vertex, doubt)| vertex.w.abs() * doubt).sum();
        if determinant.abs() <= noise {
            culled.degenerate += 1;
            return None;
        }
        let front = determinant > S::ZERO;
        match options.cull {
            Cull::Back if !front => culled.facing += 1,
            Cull::Front if front => culled.facing += 1,
            _ => {
                let sign = if front { S::ONE } else { -S::ONE };
                let edges = edges.map(|edge| edge.map(|e| sign * e));
                let owns_edge =
                    edges.map(|[_, ex, ey]| ex > S::ZERO || ex == S::ZERO && ey < S::ZERO);
                let face = face as u32;
                return Some(Self {
                    face,
                    vertices,
                    factors,
                    sign,
                    edges,
                    doubt,
                    owns_edge,
                    columns,
                    rows,
                });
            }
        }
        None
    }

    /// The parts of the edge functions that a row of pixel centres shares.
    pub(super) fn row(&self, y: S) -> Row<S> {
        Row { y, edges: self.edges.map(|[e, _, ey]| e + ey * y) }
    }

    /// The sample at column position `x` of a row, where the face covers it and its depth is
    /// within the depth range.
    #[inline]
    pub(super) fn sample(&self, row: &Row<S>, x: S) -> Option<Sample<S>> {
        let mut a = [S::ZERO; 3];
        for k in 0..3 {
            a[k] = row.edges[k] + self.edges[k][1] * x;
            if a[k] < -self.doubt[k] {
                return None;
            }
        }
        if (0..3).any(|k| a[k] <= self.doubt[k]) {
            a = self.settle(a, x, row.y)?;
        }
        let sum = |term: fn(&Vertex<S>) -> S| -> S {
            let [p, q, r] = &self.vertices;
            term(p) * a[0] + term(q) * a[1] + term(r) * a[2]
        };
        let depth = sum(|vertex| vertex.z) / sum(|vertex| vertex.w);
        let visible = depth >= -S::ONE && depth <= S::ONE;
        visible.then(|| {
            let missing = missing_factors(a, self.factors);
            let weights: [S; 3] = std::array::from_fn(|k| missing[k] * a[k]);
            let total = weights[0] + weights[1] + weights[2];
            Sample { u: weights[0] / total, v: weights[1] / total, depth }
        })
    }

    /// The edge functions `a` at a point on an edge or near it, those in doubt worked out again;
    /// `None` where the point is not covered.
    #[cold]
    fn settle(&self, mut a: [S; 3], x: S, y: S) -> Option<[S; 3]> {
        let q = self.vertices.map(|vertex| vertex.relative_to(x, y));
        for k in 0..3 {
            if a[k] <= self.doubt[k] {
                a[k] = self.sign * cross(q[(k + 1) % 3], q[(k + 2) % 3]);
            }
            let inside = a[k] > S::ZERO || a[k] == S::ZERO && self.owns_edge[k];
            if !inside {
                return None;
            }
        }
        Some(a)
    }
}

/// The parts of the edge functions that a row of pixel centres shares.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<S> {
    y: S,
    edges: [S; 3],
}

/// More than the rounding errors of the edge function from `p` to `q` anywhere in the image, from
/// its coefficients or from the vertices relative to a pixel centre: some ten roundings of products
/// of at most this size. The same for `q` to `p`.
fn doubt<S: Scalar<Wide = S>>(p: Vertex<S>, q: Vertex<S>, size: Size) -> S {
    let (width, height) = (S::from_f64(size.width as f64), S::from_f64(size.height as f64));
    let extent = |vertex: Vertex<S>| {
        let w = vertex.w.abs();
        (vertex.x.abs() + width * w, vertex.y.abs() + height * w)
    };
    let ((px, py), (qx, qy)) = (extent(p), extent(q));
    S::from_f64(8.0 * f64::EPSILON) * (px * qy + py * qx)
}

/// The columns and rows, first and last, that a face can touch; `None` where all of it lies beside
/// the image, behind the eye, or outside the depth range.
fn touched_pixels<S: Scalar<Wide = S>>(
    vertices: &[Vertex<S>; 3],
    size: Size,
) -> Option<([usize; 2], [usize; 2])> {
    let (width, height) = (S::from_f64(size.width as f64), S::from_f64(size.height as f64));
    let all = |outside: fn(&Vertex<S>, S) -> bool, extent: S| {
        vertices.iter().all(|vertex| outside(vertex, extent * vertex.w))
    };
    if all(|vertex, _| vertex.w <= S::ZERO, S::ONE)
        || all(|vertex, edge| vertex.x > edge, width)
        || all(|vertex, edge| vertex.x < -edge, width)
        || all(|vertex, edge| vertex.y > edge, height)
        || all(|vertex, edge| vertex.y < -edge, height)
        || all(|vertex, edge| vertex.z > edge, S::ONE)
        || all(|vertex, edge| vertex.z < -edge, S::ONE)
    {
        return None;
    }
    if vertices.iter().any(|vertex| vertex.w <= S::ZERO) {
        // Part of the face is behind the eye: its outline is not that of its vertices.
        return Some(([0, size.width - 1], [0, size.height - 1]));
    }
    let columns = touched(vertices.map(|vertex| vertex.x / vertex.w), size.width)?;
    let rows = touched(vertices.map(|vertex| -vertex.y / vertex.w), size.height)?;
    Some((columns, rows))
}

/// The first and last of `extent` pixels whose centres can lie between the smallest and the
/// largest of scaled coordinates.
fn touched<S: Scalar>(scaled: [S; 3], extent: usize) -> Option<[usize; 2]> {
    let pixel = scaled.map(|s| 0.5 * (s.to_f64() + extent as f64 - 1.0));
    let low = pixel.into_iter().fold(f64::INFINITY, f64::min);
    let high = pixel.into_iter().fold(f64::NEG_INFINITY, f64::max);
    // Rounded outwards by up to a pixel, which makes up for the roundings of the division.
    let first = low.floor().max(0.0);
    let last = high.ceil().min(extent as f64 - 1.0);
    (first <= last).then_some([first as usize, last as usize])
}
