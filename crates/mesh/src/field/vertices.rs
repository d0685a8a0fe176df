//! The points at which the surface crosses edges of the grid, and the gradients of the field and of the grid's points.
//!
//! # Forward
//! Let `a` be the inner end and `b` the outer one, `f_a < 0 <= f_b`, and `r = f_b / f_a`. Then `w_b = 1 / (1 - r)`,
//! `w_a = -r w_b`, and `p = w_a p_a + w_b p_b`. That is `(p_a f_b - p_b f_a) / (f_b - f_a)`, without a product that
//! could overflow. The vertex is an offset from the nearer end. So a vertex at a point of the grid is exactly
//! there. A vertex on an edge in a plane of the grid is exactly in that plane.
//!
//! # Backward
//! With `g = p_bar . (p_b - p_a)` and `s = f_a - f_b`, which is negative: `f_bar_a += g w_a / s`,
//! `f_bar_b += g w_b / s`, `p_bar_a += w_a p_bar`, `p_bar_b += w_b p_bar`.

use bokashi_core::parallel::{for_each_piece_mut, write_each};
use bokashi_core::{Accumulator, Scalar};

use crate::error::MeshError;
use crate::grid::Grid;

/// The number of vertices in one piece of work.
const PER_PIECE: usize = 1 << 11;

/// The values and offsets at the points of a grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Points<'a, T> {
    pub(super) grid: &'a Grid,
    /// `[P]`.
    pub(super) field: &'a [T],
    /// `[P, 3]`.
    pub(super) offsets: Option<&'a [T]>,
}

impl<T: Scalar> Points<'_, T> {
    /// The position of a point, with its offset.
    fn position(&self, point: u32) -> [T::Wide; 3] {
        let point = point as usize;
        let position = self.grid.position(point).map(T::Wide::from_f64);
        let Some(offsets) = self.offsets else { return position };
        let offset = &offsets[3 * point..][..3];
        [0, 1, 2].map(|axis| position[axis] + offset[axis].widen())
    }

    /// The weights `[w_a, w_b]` of the ends of an edge in its vertex.
    fn weights(&self, edge: [u32; 2]) -> [T::Wide; 2] {
        let [inside, outside] = edge.map(|end| self.field[end as usize].widen());
        let ratio = outside / inside;
        let weight = T::Wide::ONE / (T::Wide::ONE - ratio);
        // The quotient of the largest number and the smallest one is infinite.
        let other = if ratio.is_finite() { -ratio * weight } else { T::Wide::ONE };
        [other, weight]
    }

    /// The vertex of an edge.
    fn vertex(&self, edge: [u32; 2]) -> [T; 3] {
        let [a, b] = edge.map(|end| self.position(end));
        let [of_a, of_b] = self.weights(edge);
        [0, 1, 2].map(|axis| {
            let along = b[axis] - a[axis];
            let from_a = of_b <= of_a;
            T::narrow(if from_a { a[axis] + along * of_b } else { b[axis] - along * of_a })
        })
    }

    /// Writes the vertices of `edges`.
    ///
    /// # Errors
    /// [`MeshError::PointPosition`] for offsets that are not finite, or lead out of the range of the numbers.
    pub(super) fn write_vertices(
        &self,
        edges: &[[u32; 2]],
        vertices: &mut [[T; 3]],
    ) -> Result<(), MeshError> {
        let is_finite = |part: &[T]| part.iter().fold(true, |all, entry| all & entry.is_finite());
        let offsets = self.offsets.unwrap_or_default();
        if let Some(part) = offsets.chunks(1024).position(|part| !is_finite(part)) {
            let wrong = offsets.iter().skip(1024 * part).position(|entry| !entry.is_finite());
            return Err(self.misplaced((1024 * part + wrong.unwrap_or_default()) / 3));
        }
        write_each(vertices, PER_PIECE, |vertex| self.vertex(edges[vertex]));
        let Some(wrong) = vertices.chunks(341).position(|part| !is_finite(part.as_flattened()))
        else {
            return Ok(());
        };
        let all = vertices.iter().skip(341 * wrong);
        let wrong = 341 * wrong + all.take_while(|vertex| is_finite(&vertex[..])).count();
        let is_there = |end: &u32| self.position(*end).iter().all(|&x| T::narrow(x).is_finite());
        let end = edges[wrong].into_iter().find(|end| !is_there(end));
        Err(self.misplaced(end.unwrap_or(edges[wrong][0]) as usize))
    }

    /// The error of a point whose position is not finite.
    fn misplaced(&self, point: usize) -> MeshError {
        let position = self.position(point as u32).map(|x| T::narrow(x).to_f64());
        MeshError::PointPosition { point: self.grid.place(point), position }
    }

    /// Adds to the gradient of the field: `f_bar_a`, `f_bar_b`.
    pub(super) fn pull_back_field(
        &self,
        edges: &[[u32; 2]],
        upstream: &[[T; 3]],
        field_bar: &mut Accumulator<T>,
    ) {
        self.add_by_point(edges, field_bar, |vertex| {
            let [a, b] = edges[vertex].map(|end| self.position(end));
            let [inside, outside] = edges[vertex].map(|end| self.field[end as usize].widen());
            let bar = upstream[vertex].map(T::widen);
            let along = bar[0] * (b[0] - a[0]) + bar[1] * (b[1] - a[1]) + bar[2] * (b[2] - a[2]);
            let slope = along / (inside - outside);
            self.weights(edges[vertex]).map(|weight| [slope * weight])
        });
    }

    /// Adds to the gradient of the offsets: `p_bar_a`, `p_bar_b`.
    pub(super) fn pull_back_offsets(
        &self,
        edges: &[[u32; 2]],
        upstream: &[[T; 3]],
        offsets_bar: &mut Accumulator<T>,
    ) {
        self.add_by_point(edges, offsets_bar, |vertex| {
            let bar = upstream[vertex].map(T::widen);
            self.weights(edges[vertex]).map(|weight| bar.map(|bar| bar * weight))
        });
    }

    /// Adds the terms of all vertices to the ends of their edges, `N` numbers to each, in the order of the vertices.
    /// Each layer of points along x is a piece of work: its edges start in it or in the layer below.
    fn add_by_point<const N: usize>(
        &self,
        edges: &[[u32; 2]],
        bar: &mut Accumulator<T>,
        terms: impl Fn(usize) -> [[T::Wide; N]; 2] + Sync,
    ) {
        let [_, ny, nz] = self.grid.shape();
        let layer = ny * nz;
        // Edges are sorted by the layer of their lower end.
        let first_in =
            |at: usize| edges.partition_point(|ends| (ends[0].min(ends[1]) as usize) < at * layer);
        for_each_piece_mut(bar.entries(), layer * N, |at, bar| {
            let near = first_in(at.saturating_sub(1))..first_in(at + 1);
            if near.is_empty() {
                return;
            }
            let bar = bar.as_chunks_mut::<N>().0;
            let own = |end: u32| (end as usize).checked_sub(at * layer).filter(|&k| k < layer);
            let mut sums = vec![[T::Wide::ZERO; N]; layer];
            for vertex in near.clone() {
                for (end, term) in edges[vertex].into_iter().zip(terms(vertex)) {
                    if let Some(k) = own(end) {
                        sums[k].iter_mut().zip(term).for_each(|(sum, term)| *sum += term);
                    }
                }
            }
            // A sum is added where its point is met first; then it is 0.
            for k in near.flat_map(|vertex| edges[vertex]).filter_map(own) {
                let sum = std::mem::replace(&mut sums[k], [T::Wide::ZERO; N]);
                bar[k].iter_mut().zip(sum).for_each(|(bar, sum)| *bar += T::narrow(sum));
            }
        });
    }
}
