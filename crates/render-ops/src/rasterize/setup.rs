//! What a face needs before its pixels are visited.
//!
//! The edge function that faces corner 0 is `a_0(X, Y) = q_1 x q_2 = e_0 + e_1 X + e_2 Y` with
//! `e = (x_1 y_2 - y_1 x_2, y_1 w_2 - w_1 y_2, w_1 x_2 - x_1 w_2)`, and cyclic. The
//! determinant of the three vertices is `D = sum_i w_i a_i(X, Y)` at every (X, Y). A pixel centre is
//! covered where all `a_i` have the sign of D: then its weights `a_i / sum a` are positive and so
//! is `w = D / sum a`.
//!
//! Two faces at an edge see the same products, swapped. So their edge functions are exact opposites,
//! and no pixel centre is lost or drawn twice between them. A pixel centre exactly on an edge counts
//! as shifted by a little to the right, and by far less downwards. It belongs to the face into which
//! it would then move (the top-left rule).
//!
//! Faces around a vertex must agree, too. The coefficients carry the rounding of the distance from
//! the image's middle to the vertices, so near a vertex the signs of several edge functions are
//! accidents. Where an edge function is smaller than that rounding, a point is *uncertain* (a
//! floating-point filter). The edge function is then worked out again, as `q_1 x q_2`. All faces see
//! the same `q`, rounded once per vertex. The cross product of two vectors is right to within the
//! rounding of their own lengths.
//!
//! The depth is `z / w = sum_i z_i a_i / D`: linear functions over the constant D, so it is linear over
//! the image. It is computed as vertex 0's depth d plus a difference,
//! `z / w = d + sum_i (z_i - d w_i) a_i / D`, whose term of vertex 0 is zero. Only the difference is
//! rounded.

use bokashi_core::Scalar;
use pulp::Simd;

use super::corner::Corner;
use super::spans::RowOfPixels;
use crate::edge_functions::depth_and_w;
use crate::homogeneous::{Vertex, are_one, cross, determinant, edge, extent, missing_factors};
use crate::order::{largest, least};
use crate::size::Size;

/// A face whose pixels are visited.
#[derive(Debug, Clone, Copy)]
pub(super) struct Setup<S> {
    vertices: [Vertex<S>; 3],
    /// What the vertices were multiplied by.
    factors: [S; 3],
    /// 1 or -1, which makes the edge functions positive inside.
    sign: S,
    /// The edge functions' coefficients, with that sign.
    edges: [[S; 3]; 3],
    /// The size below which the sign of an edge function is uncertain.
    error_bound: S,
    /// The depth's coefficients, where a linear function gives it to as many digits as the weights.
    plane: Option<[S; 3]>,
    /// Whether some pixel that was covered had to be settled.
    has_uncertain: bool,
}

/// Pixels of a row that are weighed at once.
pub(super) const LANES: usize = 8;

/// The edge functions along a row of pixel centres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row<S> {
    y: S,
    /// The values at X = 0.
    starts: [S; 3],
    /// How they change with X.
    slopes: [S; 3],
}

impl<S: Scalar<Wide = S>> Row<S> {
    #[inline(always)]
    fn new([a, b, c]: &[[S; 3]; 3], y: S) -> Self {
        Self {
            y,
            starts: [a[0] + a[2] * y, b[0] + b[2] * y, c[0] + c[2] * y],
            slopes: [a[1], b[1], c[1]],
        }
    }

    /// The edge functions at `x`.
    #[inline(always)]
    fn values_at(&self, x: S) -> [S; 3] {
        [
            self.starts[0] + self.slopes[0] * x,
            self.starts[1] + self.slopes[1] * x,
            self.starts[2] + self.slopes[2] * x,
        ]
    }
}

impl<S: Scalar<Wide = S>> Setup<S> {
    /// Of a face of that orientation, 1 or -1.
    #[inline(always)]
    pub(super) fn new(corners: [&Corner<S>; 3], orientation: i8, size: Size) -> Self {
        let vertices = corners.map(|corner| corner.vertex);
        let sign = S::from_f64(f64::from(orientation));
        let edges = signed_edges(&vertices, orientation);
        let extents = vertices.map(|vertex| extent(vertex, size));
        let [x, y] = [0, 1].map(|axis| largest(extents.map(|extent| extent[axis])));
        // That of any two of the vertices, as in `homogeneous::edge_error_bound`.
        let error_bound = S::from_f64(16.0 * f64::EPSILON) * x * y;
        let factors = corners.map(|corner| corner.factor);
        let plane = plane(&vertices, &edges, error_bound);
        Self { vertices, factors, sign, edges, error_bound, plane, has_uncertain: false }
    }

    /// The edge functions along the row of pixel centres at `y`.
    #[inline(always)]
    pub(super) fn row(&self, y: S) -> Row<S> {
        Row::new(&self.edges, y)
    }

    /// Of `columns`, first and end, those that the face may cover in a row: where each edge
    /// function is above minus its error bound. `centers` are the X of all columns.
    ///
    /// As it is rounded, an edge function rises or falls all along a row, so these columns are
    /// neighbours. A division says where they end to within a column, and the edge function itself
    /// where exactly.
    #[inline(always)]
    fn span(&self, row: &Row<S>, columns: [usize; 2], centers: &[S]) -> [usize; 2] {
        let [mut first, mut end] = columns;
        let middle = 0.5 * (centers.len() as f64 - 1.0);
        let bound = -self.error_bound;
        for k in 0..3 {
            let (start, slope) = (row.starts[k], row.slopes[k]);
            let is_in = |column: usize| start + slope * centers[column] >= bound;
            // A column is two units wide. Rounded to the nearest one; where it is not a number it
            // bounds nothing.
            let estimate = middle + 0.5 * (bound - start).to_f64() / slope.to_f64();
            let estimate = (estimate + 0.5).floor();
            if slope > S::ZERO {
                first = estimate.max(first as f64).min(end as f64) as usize;
                while first < end && !is_in(first) {
                    first += 1;
                }
            } else if slope < S::ZERO {
                end = (estimate + 1.0).min(end as f64).max(first as f64) as usize;
                while first < end && !is_in(end - 1) {
                    end -= 1;
                }
            } else if start < bound {
                return [first, first];
            }
        }
        [first, end]
    }

    /// Where in `span` no edge function is uncertain: those uncertain are the first or the last.
    #[inline(always)]
    pub(super) fn certain(&self, row: &Row<S>, span: [usize; 2], centers: &[S]) -> [usize; 2] {
        let [mut first, mut end] = span;
        while first < end && self.is_uncertain(row.values_at(centers[first])) {
            first += 1;
        }
        while first < end && self.is_uncertain(row.values_at(centers[end - 1])) {
            end -= 1;
        }
        [first, end]
    }

    #[inline(always)]
    fn is_uncertain(&self, a: [S; 3]) -> bool {
        least(a) <= self.error_bound
    }

    /// The edge functions at an uncertain point, those that are worked out again; `None` where the
    /// point is not covered.
    pub(super) fn settled(&self, row: &Row<S>, x: S) -> Option<[S; 3]> {
        let mut a = row.values_at(x);
        let q = self.vertices.map(|vertex| vertex.relative_to(x, row.y));
        for k in 0..3 {
            if a[k] <= self.error_bound {
                a[k] = self.sign * cross(q[(k + 1) % 3], q[(k + 2) % 3]);
            }
            // On the edge: whether a little to the right, and far less downwards, is inside.
            let [_, ex, ey] = self.edges[k];
            let owns_edge = ex > S::ZERO || ex == S::ZERO && ey < S::ZERO;
            let inside = a[k] > S::ZERO || a[k] == S::ZERO && owns_edge;
            if !inside {
                return None;
            }
        }
        Some(a)
    }

    /// z / w where the edge functions are `a`.
    #[inline(always)]
    fn depth(&self, a: [S; 3]) -> S {
        let [depth, _] = depth_and_w(&self.vertices, a);
        depth
    }

    /// More than the rounding of a depth up to 1: with edge functions that are off by the bound, `W = D` is off by
    /// `sum |w_i| bound`, and `sum z_i a_i` likewise.
    #[inline(always)]
    fn depth_error(&self) -> f64 {
        let [p, q, r] = self.vertices;
        let determinant = determinant(p, self.edges[0]);
        let sum = |[a, b, c]: [S; 3]| a.abs() + b.abs() + c.abs();
        let sums = sum([p.z, q.z, r.z]) + sum([p.w, q.w, r.w]);
        (S::from_f64(2.0) * self.error_bound * sums / determinant).to_f64()
    }

    /// The depth at the centre of a pixel that it covers, as visibility compares it.
    pub(super) fn depth_at(&self, y: S, x: S) -> S {
        let row = self.row(y);
        let a = row.values_at(x);
        if self.is_uncertain(a) {
            return self.depth(self.settled(&row, x).expect("it was covered a moment ago"));
        }
        match self.plane {
            Some(plane) => {
                let [start, slope] = along(plane, y);
                start + slope * x
            }
            None => self.depth(a),
        }
    }

    /// Draws a row of pixels among `columns`, first and end: where it is nearer than what is in `pixels`, it takes its
    /// place. Returns columns, first and end, beyond which it covers nothing.
    #[inline(always)]
    pub(super) fn cover_span<V: Simd>(
        &mut self,
        simd: V,
        row: &Row<S>,
        columns: [usize; 2],
        centers: &[S],
        pixels: &mut RowOfPixels<'_, S>,
    ) -> [usize; 2] {
        let [first, end] = self.span(row, columns, centers);
        if first >= end {
            return [centers.len(), 0];
        }
        let [inside, inside_end] = self.certain(row, [first, end], centers);
        let within = inside..inside_end;
        match self.plane {
            Some(plane) => {
                let [start, slope] = along(plane, row.y);
                pixels.cover(simd, (row.y, true), within, centers, |x| start + slope * x);
            }
            None => {
                let is_linear = pixels.filter.is_small(self.depth_error());
                let depth = |x| self.depth(row.values_at(x));
                pixels.cover(simd, (row.y, is_linear), within, centers, depth);
            }
        }
        // The few at both ends where an edge function may be rounding alone.
        for column in (first..inside).chain(inside_end..end) {
            self.cover_settled(row, (column, centers[column]), pixels);
        }
        [first, end]
    }

    /// Draws one pixel where an edge function is uncertain.
    #[cold]
    #[inline(never)]
    fn cover_settled(
        &mut self,
        row: &Row<S>,
        (column, x): (usize, S),
        pixels: &mut RowOfPixels<'_, S>,
    ) {
        let Some(a) = self.settled(row, x) else { return };
        self.has_uncertain |= pixels.cover_one(row.y, (column, x), self.depth(a));
    }

    /// Whether some pixel that it covered had to be settled.
    #[inline(always)]
    pub(super) fn has_uncertain(&self) -> bool {
        self.has_uncertain
    }

    /// The weights u and v of neighbouring pixels of a row that it covers, into
    /// `barycentrics: [n, 2]`, where pixels may be uncertain, or vertices have factors that differ.
    #[cold]
    #[inline(never)]
    pub(super) fn weigh_one_by_one<T: Scalar<Wide = S>>(
        &self,
        y: S,
        centers: &[S],
        barycentrics: &mut [T],
    ) {
        let row = self.row(y);
        for (pair, &x) in barycentrics.chunks_exact_mut(2).zip(centers) {
            let mut a = row.values_at(x);
            if self.is_uncertain(a) {
                a = self.settled(&row, x).expect("it was covered a moment ago");
            }
            let missing = missing_factors(a, self.factors);
            let weights: [S; 3] = std::array::from_fn(|k| missing[k] * a[k]);
            let total = weights[0] + weights[1] + weights[2];
            (pair[0], pair[1]) = (T::narrow(weights[0] / total), T::narrow(weights[1] / total));
        }
    }
}

/// What the weights of a face's pixels follow from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights<S> {
    /// The edge functions' coefficients, positive inside.
    edges: [[S; 3]; 3],
    /// Whether no pixel that was covered had to be settled, and all vertices have one factor.
    pub(super) is_plain: bool,
}

impl<S: Scalar<Wide = S>> Weights<S> {
    /// Of a face of that orientation, 1 or -1, some pixels of which perhaps had to be settled.
    #[inline(always)]
    pub(super) fn new(corners: [&Corner<S>; 3], orientation: i8, has_uncertain: bool) -> Self {
        let edges = signed_edges(&corners.map(|corner| corner.vertex), orientation);
        let is_plain = !has_uncertain && are_one(corners.map(|corner| corner.factor));
        Self { edges, is_plain }
    }

    /// The weights u and v of the first `length` of `centers`, of a row at `y`, of a plain face that
    /// covers them, into the first of `barycentrics: [n, 2]`. What it writes after them means
    /// nothing: most runs are short, and one or two blocks of pixels take less time than as many as
    /// there are.
    #[inline(always)]
    pub(super) fn weigh<T: Scalar<Wide = S>>(
        &self,
        y: S,
        length: usize,
        centers: &[S],
        barycentrics: &mut [T],
    ) {
        let row = Row::new(&self.edges, y);
        let weights = |x: S| {
            let a = row.values_at(x);
            let scale = S::ONE / (a[0] + a[1] + a[2]);
            [T::narrow(a[0] * scale), T::narrow(a[1] * scale)]
        };
        let barycentrics = barycentrics.as_chunks_mut::<2>().0;
        let mut done = 0;
        for _ in 0..2 {
            if done < length
                && let (Some(pairs), Some(centers)) = (
                    barycentrics[done..].first_chunk_mut::<LANES>(),
                    centers[done..].first_chunk::<LANES>(),
                )
            {
                let mut of_lanes = [[T::ZERO; 2]; LANES];
                for lane in 0..LANES {
                    of_lanes[lane] = weights(centers[lane]);
                }
                *pairs = of_lanes;
                done += LANES;
            }
        }
        for k in done..length {
            barycentrics[k] = weights(centers[k]);
        }
    }
}

/// The edge functions' coefficients of a face of that orientation, positive inside.
#[inline(always)]
pub(super) fn signed_edges<S: Scalar>([p, q, r]: &[Vertex<S>; 3], orientation: i8) -> [[S; 3]; 3] {
    let sign = S::from_f64(f64::from(orientation));
    let edges = [edge(*q, *r), edge(*r, *p), edge(*p, *q)];
    edges.map(|[e, ex, ey]| [sign * e, sign * ex, sign * ey])
}

/// The depth's coefficients of 1, X and Y, where no vertex is behind the eye and neither the
/// rounding of the edge functions nor that of vertex 0's depth can be seen in it.
#[inline(always)]
fn plane<S: Scalar<Wide = S>>(
    vertices: &[Vertex<S>; 3],
    edges: &[[S; 3]; 3],
    error_bound: S,
) -> Option<[S; 3]> {
    let [p, q, r] = vertices;
    let determinant = determinant(*p, edges[0]);
    let (least, largest) = (least([p.w, q.w, r.w]), largest([p.w, q.w, r.w]));
    let d = p.z / p.w;
    let is_exact = least > S::ZERO
        && error_bound * largest * S::from_f64(1e6) < determinant
        && d.abs() < S::from_f64(1e3);
    let scale = S::ONE / determinant;
    let [q, r] = [scale * (q.z - d * q.w), scale * (r.z - d * r.w)];
    let [mut one, x, y] = [0, 1, 2].map(|k| q * edges[1][k] + r * edges[2][k]);
    one += d;
    is_exact.then_some([one, x, y])
}

/// A linear function's value at X = 0 in the row at `y`, and how it changes with X.
#[inline(always)]
fn along<S: Scalar>([one, x, by_y]: [S; 3], y: S) -> [S; 2] {
    [one + by_y * y, x]
}

#[cfg(test)]
mod tests {
    use super::super::culling::{Fate, Verdict};
    use super::*;

    /// Of a face that is drawn.
    fn setup(clip: &[[f64; 4]; 3], size: Size) -> Option<Setup<f64>> {
        let corners = [0, 1, 2].map(|index| Corner::new(clip.as_flattened(), index, size));
        let corners = corners.each_ref();
        let verdict = Verdict::from_corners(corners, [0, 1, 2], size.into(), f64::INFINITY);
        matches!(verdict.fate, Fate::Drawn(_))
            .then(|| Setup::new(corners, verdict.orientation, size))
    }

    #[test]
    fn a_depth_is_linear_where_its_rounding_cannot_be_seen() {
        let size = Size::square(16);
        let has_plane = |clip: [[f64; 4]; 3]| setup(&clip, size).unwrap().plane.is_some();
        let face =
            |z: f64, w: f64| [[-0.7, -0.8, z, w], [0.8, -0.6, 0.3, 1.0], [0.1, 0.9, -0.4, 1.2]];
        assert!(has_plane(face(0.2, 1.0)) && has_plane(face(-900.0, 1.0)));
        // Vertex 0 behind the eye, in its plane, and too far away in depth.
        assert!(!has_plane(face(0.2, -0.1)) && !has_plane(face(0.2, 0.0)));
        assert!(!has_plane(face(1100.0, 1.0)) && !has_plane(face(-0.9, 1e-4)));
        let behind = face(0.2, -0.1);
        assert!(!has_plane([behind[1], behind[0], behind[2]]));
        assert!(!has_plane([behind[1], behind[2], behind[0]]));
        // Slivers of the law `a_sliver_is_seen_where_it_is_the_nearer_one`: among them are some of each kind.
        let sliver = |width: f64| {
            let [left, right, middle] = [-0.6875, 0.6875, 0.4375];
            let [low, high] = [middle - 0.125 * width, middle + 0.125 * width];
            [[left, high, 1.35, 1.0], [right, high, -0.45, 1.0], [right, low, -0.45, 1.0]]
        };
        assert!(has_plane(sliver(1e-4)));
        let thin = [1e-9, 1e-10, 3e-11, 1e-11].map(|width| setup(&sliver(width), size));
        let uncertain = thin.into_iter().flatten().filter(|setup| setup.plane.is_none());
        assert!(uncertain.count() > 1);
    }
}
