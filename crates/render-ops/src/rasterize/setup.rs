//! What a face needs before its pixels are visited.
//!
//! The edge function that faces corner 0 is `a_0(X, Y) = q_1 x q_2 = e_0 + e_1 X + e_2 Y` with
//! `e = (x_1 y_2 - y_1 x_2, y_1 w_2 - w_1 y_2, w_1 x_2 - x_1 w_2)`, and cyclic. The
//! determinant of the three vertices is `D = sum_i w_i a_i(X, Y)` at every (X, Y). A pixel centre is
//! covered where all `a_i` have the sign of D: then its weights `a_i / sum a` are positive and so
//! is `w = D / sum a`.
//!
//! Two faces at an edge see the same three products, swapped, so their edge functions are exact
//! opposites and no pixel centre is lost or drawn twice between them. One exactly on an edge
//! belongs to the face to whose inside it would move if it were shifted by a little to the right,
//! and by far less downwards (the top-left rule).

use bokashi_core::Scalar;

use super::{Cull, RasterOptions};
use crate::fragments::Culled;
use crate::homogeneous::Vertex;
use crate::mesh::{Mesh, repeats_a_vertex};
use crate::size::Size;

/// A face that may cover pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setup<S> {
    pub(super) face: u32,
    /// The edge functions' coefficients, with signs such that they are positive inside.
    edges: [[S; 3]; 3],
    /// Whether a pixel centre exactly on the edge is covered.
    owns_edge: [bool; 3],
    z: [S; 3],
    w: [S; 3],
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
        let vertices = indices.map(|index| Vertex::of(clip, index, options.size));
        let Some((columns, rows)) = touched_pixels(&vertices, options.size) else {
            culled.outside += 1;
            return None;
        };

        let vertices = vertices.map(|vertex| vertex.scaled(range_scale(&vertices)));
        let edges: [[S; 3]; 3] = std::array::from_fn(|corner| {
            let (p, q) = (vertices[(corner + 1) % 3], vertices[(corner + 2) % 3]);
            [p.x * q.y - p.y * q.x, p.y * q.w - p.w * q.y, p.w * q.x - p.x * q.w]
        });
        let first = vertices[0];
        let terms = [first.w * edges[0][0], first.x * edges[0][1], first.y * edges[0][2]];
        let determinant = terms[0] + terms[1] + terms[2];
        // Below this the sign of the determinant is an accident of rounding: three products of
        // two roundings each, and the sums.
        let noise = S::from_f64(8.0 * f64::EPSILON)
            * (terms[0].abs() + terms[1].abs() + terms[2].abs());
        if determinant.abs() <= noise {
            culled.degenerate += 1;
            return None;
        }
        let front = determinant > S::ZERO;
        match options.cull {
            Cull::Back if !front => culled.facing += 1,
            Cull::Front if front => culled.facing += 1,
            _ => {
                let edges = if front { edges } else { edges.map(|edge| edge.map(|e| -e)) };
                let owns_edge = edges.map(|[_, ex, ey]| ex > S::ZERO || ex == S::ZERO && ey < S::ZERO);
                let (z, w) = (vertices.map(|vertex| vertex.z), vertices.map(|vertex| vertex.w));
                return Some(Self { face: face as u32, edges, owns_edge, z, w, columns, rows });
            }
        }
        None
    }

    /// The parts of the edge functions that a row of pixel centres shares.
    pub(super) fn row(&self, y: S) -> [S; 3] {
        self.edges.map(|[e, _, ey]| e + ey * y)
    }

    /// The sample at column position `x` of a row, where the face covers it and its depth is
    /// within the depth range.
    #[inline]
    pub(super) fn sample(&self, row: &[S; 3], x: S) -> Option<Sample<S>> {
        let mut a = [S::ZERO; 3];
        for k in 0..3 {
            a[k] = row[k] + self.edges[k][1] * x;
            let inside = a[k] > S::ZERO || a[k] == S::ZERO && self.owns_edge[k];
            if !inside {
                return None;
            }
        }
        let total = a[0] + a[1] + a[2];
        let z = self.z[0] * a[0] + self.z[1] * a[1] + self.z[2] * a[2];
        let w = self.w[0] * a[0] + self.w[1] * a[1] + self.w[2] * a[2];
        let depth = z / w;
        let visible = depth >= -S::ONE && depth <= S::ONE;
        visible.then(|| Sample { u: a[0] / total, v: a[1] / total, depth })
    }
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

/// A power of two that brings a face's coordinates near 1 where products of three of them would
/// leave the range of the numbers; 1 nearly always. It changes no weight and no depth.
fn range_scale<S: Scalar>(vertices: &[Vertex<S>; 3]) -> S {
    let largest = vertices
        .iter()
        .flat_map(|vertex| [vertex.x, vertex.y, vertex.w])
        .map(|coordinate| coordinate.abs().to_f64())
        .fold(0.0, f64::max);
    if largest == 0.0 || (1e-60..1e60).contains(&largest) {
        return S::ONE;
    }
    // Of the exponent the half suffices: 2^-1074 would need a factor beyond the range.
    S::from_f64(f64::powi(2.0, -(largest.log2() as i32).clamp(-1000, 1000)))
}
