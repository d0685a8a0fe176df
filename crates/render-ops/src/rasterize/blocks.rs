//! Small faces, drawn in blocks of eight pixels, in single precision.
//!
//! A row of a small face has a few pixels, and where they start and end can't be foretold. So all
//! blocks that the face can touch are drawn, and nothing is decided from pixel to pixel. A face with a pixel that the
//! filter leaves in doubt is drawn once more, in spans (`setup`): what is certain stays as it is.
//!
//! Faces are set up eight at a time, number by number.

use std::sync::atomic::{Ordering, compiler_fence};

use pulp::Simd;

use super::filter::{Boxes, EIGHT, Eight, Filter, Octet, first_lanes};
use super::plane::Plane;
use crate::order::{larger, largest, least};
use crate::raster_options::Sampling;
use crate::size::Size;

/// A face that can touch no more pixels is drawn without looking where in a row it starts and ends.
const PIXELS_PER_FACE: i32 = 1024;

/// Eight faces before their pixels are visited, number by number, in pixels from the first pixel that each can touch.
#[derive(Debug)]
pub(super) struct SmallFaces {
    /// The coefficients of 1, X and Y of the edge functions, positive inside, in units beyond which they are certain; and of
    /// the depth.
    lines: [[Eight<f32>; 3]; 4],
    first_columns: Eight<i32>,
    blocks: Eight<i32>,
    /// First and last, of the band.
    rows: [Eight<i32>; 2],
    /// Whether they can be drawn so.
    are_small: Eight<bool>,
}

impl SmallFaces {
    /// Of a band, whose rows are the first and the last.
    #[inline(always)]
    pub(super) fn new(filter: &Filter, octet: &Octet, size: Size, band: [usize; 2]) -> Self {
        let Boxes { columns: [first, last], rows: [top, bottom], orientations } =
            filter.boxes(octet, size, Sampling::Center);
        let [band_top, band_bottom] = band.map(|row| row as i32);
        let [mut blocks, mut tops, mut bottoms] = [[0; EIGHT]; 3];
        for k in 0..EIGHT {
            blocks[k] = ((last[k] - first[k]) >> EIGHT.ilog2()) + 1;
            tops[k] = top[k].max(band_top);
            bottoms[k] = bottom[k].min(band_bottom);
        }
        let [p, q, r] = filter.around(octet, [&first, &tops]);
        let mut faces = Self {
            lines: [[[0.0; EIGHT]; 3]; 4],
            first_columns: first,
            blocks,
            rows: [tops, bottoms],
            are_small: [false; EIGHT],
        };
        for k in 0..EIGHT {
            let [p, q, r] = [[p[0][k], p[1][k]], [q[0][k], q[1][k]], [r[0][k], r[1][k]]];
            let sign = orientations[k] as f32;
            // Rows go down.
            let edge = |[ax, ay]: [f32; 2], [bx, by]: [f32; 2]| {
                [sign * (bx * ay - by * ax), sign * (by - ay), sign * (ax - bx)]
            };
            let edges = [edge(q, r), edge(r, p), edge(p, q)];
            let area = edges[0][0] + edges[0][1] * p[0] + edges[0][2] * p[1];
            let side = |axis: usize| {
                let coordinates = [p[axis], q[axis], r[axis]];
                largest(coordinates) - least(coordinates)
            };
            let larger_side = larger(side(0), side(1));
            let bound = filter.edge_bound(larger_side);
            let [d, to_q, to_r] =
                [0, 1, 2].map(|i| octet.depth[i][k] - if i > 0 { octet.depth[0][k] } else { 0.0 });
            let [inverse, per_bound] = [1.0 / area, 1.0 / bound];
            let [by_q, by_r] = [to_q * inverse, to_r * inverse];
            for c in 0..3 {
                for i in 0..3 {
                    faces.lines[i][c][k] = per_bound * edges[i][c];
                }
                let base = if c == 0 { d } else { 0.0 };
                faces.lines[3][c][k] = base + (by_q * edges[1][c] + by_r * edges[2][c]);
            }
            let [_, by_x, by_y] = [0, 1, 2].map(|c| faces.lines[3][c][k]);
            let range = larger(to_q.abs(), to_r.abs());
            let depth_bound = filter.depth_bound(larger_side, [by_x, by_y], range, area);
            let pixels = 8 * blocks[k] * (bottoms[k] - tops[k] + 1);
            faces.are_small[k] = (sign != 0.0)
                & (area >= 16.0 * bound)
                & (depth_bound < 0.48)
                & (pixels <= PIXELS_PER_FACE);
        }
        faces
    }

    /// Whether the `k`-th can be drawn in blocks.
    #[inline(always)]
    pub(super) fn is_small(&self, k: usize) -> bool {
        self.are_small[k]
    }

    /// The edge functions and the depth of the `k`-th at a column and a row from its first pixel.
    #[cfg(test)]
    pub(super) fn values_at(&self, k: usize, [column, row]: [i32; 2]) -> [f32; 4] {
        self.lines.map(|[one, x, y]| {
            let start = f32::mul_add(x[k], column as f32, one[k]);
            f32::mul_add(y[k], row as f32, start)
        })
    }

    /// The coefficients of 1, X and Y of the `k`-th, of each edge function and of the depth.
    #[inline(always)]
    fn coefficients<V: Simd>(&self, simd: V, k: usize) -> [[V::f32s; 4]; 3] {
        let mut coefficients = [[simd.splat_f32s(0.0); 4]; 3];
        for (i, line) in self.lines.iter().enumerate() {
            for c in 0..3 {
                coefficients[c][i] = simd.splat_f32s(line[c][k]);
            }
        }
        coefficients
    }

    /// Draws the `k`-th into a band's plane, whose first row is `band_top`: where it is surely nearer than what is there,
    /// `number` takes its place. Returns whether some pixel is in doubt: none of these is drawn.
    #[inline(always)]
    pub(super) fn cover<V: Simd>(
        &self,
        simd: V,
        k: usize,
        plane: &mut Plane,
        band_top: usize,
        number: u32,
        advantage: f32,
    ) -> bool {
        let [top, bottom] = self.rows.each_ref().map(|rows| rows[k]);
        let first = self.first_columns[k] as usize;
        let columns = EIGHT * self.blocks[k] as usize;
        plane.reach_by_small([first, first + columns]);
        let (stride, rows) = (plane.stride, bottom + 1 - top);
        // Both have one length, so that bounds are checked once.
        let length = plane.depths.len();
        let (depths, faces) = (&mut plane.depths[..length], &mut plane.faces[..length]);
        let [from_start, x_slopes, y_slopes] = self.coefficients(simd, k);
        let (advantage, one) = (simd.splat_f32s(advantage), simd.splat_f32s(1.0));
        let number = simd.splat_u32s(number);
        let mut closest = simd.splat_f32s(f32::INFINITY);
        let mut x = first_lanes(simd);
        // A range with steps would divide to count them.
        let mut column = 0;
        while column < columns {
            let mut starts = from_start;
            for i in 0..4 {
                starts[i] = simd.mul_add_e_f32s(x_slopes[i], x, from_start[i]);
            }
            x = simd.add_f32s(x, simd.splat_f32s(V::F32_LANES as f32));
            let mut pixel = (top as usize - band_top) * stride + first + column;
            column += V::F32_LANES;
            let mut y = simd.splat_f32s(0.0);
            for _ in 0..rows {
                let within = pixel..pixel + V::F32_LANES;
                pixel += stride;
                let [depths] = V::as_mut_simd_f32s(&mut depths[within.clone()]).0 else { break };
                let [faces] = V::as_mut_simd_u32s(&mut faces[within]).0 else { break };
                let (before, face_before) = (*depths, *faces);
                // A choice whose store goes to where it was loaded from would become a masked store, which takes
                // long and which later loads wait for. The fence, which is no instruction, keeps them apart.
                compiler_fence(Ordering::SeqCst);
                let mut values = starts;
                for i in 0..4 {
                    values[i] = simd.mul_add_e_f32s(y_slopes[i], y, starts[i]);
                }
                let [a, b, c, depth] = values;
                let nearer = simd.sub_f32s(simd.sub_f32s(before, depth), advantage);
                let inside = simd.min_f32s(simd.min_f32s(a, b), c);
                // How surely it is seen: above 1 it is, below -1 it is not.
                let seen = simd.min_f32s(inside, nearer);
                let is_seen = simd.greater_than_f32s(seen, one);
                *depths = simd.select_f32s(is_seen, depth, before);
                *faces = simd.select_u32s(is_seen, number, face_before);
                closest = simd.min_f32s(closest, simd.abs_f32s(seen));
                y = simd.add_f32s(y, one);
            }
        }
        simd.reduce_min_f32s(closest) <= 1.0
    }
}
