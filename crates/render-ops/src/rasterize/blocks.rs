//! Small faces, drawn in blocks of pixels.
//!
//! A row of a small face has a few pixels, and where they start and end can't be foretold. So all
//! blocks that the face can touch are drawn, and nothing is decided from pixel to pixel. The picture
//! is that of `setup`, whose pixels cost more: what it asks of a face holds here beforehand.
//!
//! # Which faces
//! All vertices are in view, none is close to the near plane, and none was multiplied. So
//! `|x| <= width w` and `|y| <= height w`, and a vertex's extents are at most `2 width w` and
//! `2 height w`. The error bound of `setup` is then below `65 eps width height w^2` with the largest
//! w, where 64 would be enough without rounding. Pixels above this bound are surely covered, and those
//! below its negative surely are not. A face with a pixel between them is drawn again, in spans.
//!
//! At a pixel that is covered the depth lies between those of the vertices, which are at least
//! `culling::MARGIN` behind the near plane. A face has a plane only where the bound is below 1e-6 of the
//! determinant over w. So the depth's rounding is some 1e-5 at most, and no pixel need be held
//! against the near plane.

use bokashi_core::Scalar;

use super::culling::{Corner, are_tame};
use super::order::{largest, least, smaller};
use super::setup::{LANES, Weights, keep_nearer, lanes, plane};
use crate::homogeneous::edge;
use crate::size::Size;

/// A face that is drawn in blocks.
#[derive(Debug, Clone, Copy)]
pub(super) struct SmallFace<S> {
    /// The edge functions' coefficients, positive inside.
    edges: [[S; 3]; 3],
    /// The depth's coefficients.
    plane: [S; 3],
    /// At least the size below which the sign of an edge function is uncertain.
    error_bound: S,
}

impl<S: Scalar<Wide = S>> SmallFace<S> {
    /// Of a face of that orientation, 1 or -1; `None` where it has to be drawn in spans.
    #[inline(always)]
    pub(super) fn new(corners: [&Corner<S>; 3], orientation: i8, size: Size) -> Option<Self> {
        if !are_tame(corners) {
            return None;
        }
        let vertices = corners.map(|corner| corner.vertex);
        let sign = S::from_f64(f64::from(orientation));
        let [p, q, r] = vertices;
        let edges = [edge(q, r), edge(r, p), edge(p, q)];
        let edges = edges.map(|[e, ex, ey]| [sign * e, sign * ex, sign * ey]);
        let (w, [width, height]) = (largest([p.w, q.w, r.w]), size.extents::<S>());
        let error_bound = S::from_f64(65.0 * f64::EPSILON) * (width * w) * (height * w);
        let plane = plane(&vertices, &edges, error_bound)?;
        Some(Self { edges, plane, error_bound })
    }

    /// Draws the blocks of columns `centers` in the rows at `ys`, of which each has `per_row` blocks
    /// from its first on: where the depth is smaller than in `depths` it takes its place, and `face`
    /// that in `faces`. Returns whether some pixel is uncertain: none of these is drawn.
    #[inline(always)]
    pub(super) fn cover(
        &self,
        ys: &[S],
        centers: &[[S; LANES]],
        (depths, faces): (&mut [[S; LANES]], &mut [[u64; LANES]]),
        per_row: usize,
        face: u64,
    ) -> bool {
        let Self { edges: [a, b, c], plane, error_bound } = *self;
        let [ones, xs, by_ys] = [0, 1, 2].map(|k| [a[k], b[k], c[k], plane[k]]);
        let mut closest = [S::from_f64(f64::INFINITY); LANES];
        let mut first = 0;
        for &y in ys {
            let within = first..first + centers.len();
            first += per_row;
            let starts = lanes(|k| ones[k] + by_ys[k] * y);
            let pixels = depths[within.clone()].iter_mut().zip(&mut faces[within]);
            for ((nearest, seen), x) in pixels.zip(centers) {
                let along = |k: usize| lanes(|lane| starts[k] + xs[k] * x[lane]);
                let [a, b, c, depth] = [along(0), along(1), along(2), along(3)];
                let inside = lanes(|k| least([a[k], b[k], c[k]]));
                let is_inside = lanes(|k| inside[k] > error_bound);
                keep_nearer((nearest, seen), is_inside, depth, face);
                closest = lanes(|k| smaller(inside[k].abs(), closest[k]));
            }
        }
        closest.iter().any(|&distance| distance <= error_bound)
    }

    /// What is kept of the face once it is drawn and none of its pixels was uncertain.
    #[inline(always)]
    pub(super) fn weights(&self) -> Weights<S> {
        Weights { edges: self.edges, is_plain: true }
    }
}
