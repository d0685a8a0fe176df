//! Small faces, drawn in blocks of eight pixels, in single precision.
//!
//! A row of a small face has a few pixels, and where they start and end can't be foretold. So all
//! blocks that the face can touch are drawn, and nothing is decided from pixel to pixel. A face with a pixel that the
//! filter leaves in doubt is drawn once more, in spans (`setup`): what is certain stays as it is.
//!
//! Faces are set up eight at a time, number by number.

use std::sync::atomic::{Ordering, compiler_fence};

use super::culling::ROUNDING_OF_PIXELS;
use super::filter::{Boxes, EIGHT, Eight, Filter, Octet};
use super::plane::Plane;
use crate::order::least;
use crate::size::Size;

/// A face that can touch no more pixels is drawn without looking where in a row it starts and ends.
const PIXELS_PER_FACE: i32 = 1024;

/// Eight faces before their pixels are visited, number by number, in pixels from the first pixel that each can touch.
#[derive(Debug)]
pub(super) struct SmallFaces {
    /// The edge functions' coefficients of 1, X and Y, positive inside.
    edges: [[Eight<f32>; 3]; 3],
    /// The depth's coefficients.
    plane: [Eight<f32>; 3],
    /// The size beyond which edge functions are certain.
    bounds: Eight<f32>,
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
            filter.boxes(octet, size, ROUNDING_OF_PIXELS);
        let [band_top, band_bottom] = band.map(|row| row as i32);
        let [mut blocks, mut tops, mut bottoms] = [[0; EIGHT]; 3];
        for k in 0..EIGHT {
            blocks[k] = ((last[k] - first[k]) >> EIGHT.ilog2()) + 1;
            tops[k] = top[k].max(band_top);
            bottoms[k] = bottom[k].min(band_bottom);
        }
        let [p, q, r] = filter.around(octet, [&first, &tops]);
        let mut faces = Self {
            edges: [[[0.0; EIGHT]; 3]; 3],
            plane: [[0.0; EIGHT]; 3],
            bounds: [0.0; EIGHT],
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
                let [p, q, r] = [p[axis], q[axis], r[axis]];
                p.max(q).max(r) - p.min(q).min(r)
            };
            let bound = filter.edge_bound(side(0).max(side(1)));
            let [d, to_q, to_r] = [0, 1, 2].map(|i| octet.depth[i][k] - if i > 0 { octet.depth[0][k] } else { 0.0 });
            let inverse = 1.0 / area;
            let [by_q, by_r] = [to_q * inverse, to_r * inverse];
            for c in 0..3 {
                for i in 0..3 {
                    faces.edges[i][c][k] = edges[i][c];
                }
                let base = if c == 0 { d } else { 0.0 };
                faces.plane[c][k] = base + (by_q * edges[1][c] + by_r * edges[2][c]);
            }
            faces.bounds[k] = bound;
            let range = to_q.abs().max(to_r.abs());
            let pixels = 8 * blocks[k] * (bottoms[k] - tops[k] + 1);
            faces.are_small[k] = (sign != 0.0)
                & (area >= 16.0 * bound)
                & (8.0 * bound * range <= 0.48 * filter.tolerance * area)
                & (pixels <= PIXELS_PER_FACE);
        }
        faces
    }

    /// Whether the `k`-th can be drawn in blocks.
    #[inline(always)]
    pub(super) fn is_small(&self, k: usize) -> bool {
        self.are_small[k]
    }

    /// Draws the `k`-th into a band's plane, whose first row is `band_top`: where it is surely nearer than what is there,
    /// `number` takes its place. Returns whether some pixel is in doubt: none of these is drawn.
    #[inline(always)]
    pub(super) fn cover(&self, k: usize, plane: &mut Plane, band_top: usize, number: u32, tolerance: f32) -> bool {
        let [top, bottom] = self.rows.each_ref().map(|rows| rows[k]);
        let first = self.first_columns[k] as usize;
        let [reached, reached_end] = &mut plane.reached_by_small;
        *reached = (*reached).min(first);
        *reached_end = (*reached_end).max(first + EIGHT * self.blocks[k] as usize);
        let bound = self.bounds[k];
        let mut doubts = [0_u32; EIGHT];
        for block in 0..self.blocks[k] as usize {
            let mut starts = [[0.0; EIGHT]; 4];
            let mut slopes = [0.0; 4];
            for (i, (starts, slope)) in starts.iter_mut().zip(&mut slopes).enumerate() {
                let [one, x, y] = if i < 3 { &self.edges[i] } else { &self.plane }.each_ref().map(|lanes| lanes[k]);
                *slope = y;
                for lane in 0..EIGHT {
                    starts[lane] = one + x * (EIGHT * block + lane) as f32;
                }
            }
            let mut pixel = (top as usize - band_top) * plane.stride + first + EIGHT * block;
            for row in 0..=bottom - top {
                let y = row as f32;
                let (Some(depths), Some(faces)) = (
                    plane.depths[pixel..].first_chunk_mut::<EIGHT>(),
                    plane.faces[pixel..].first_chunk_mut::<EIGHT>(),
                ) else { break };
                pixel += plane.stride;
                let (before, face_before) = (*depths, *faces);
                compiler_fence(Ordering::SeqCst);
                let mut values = [[0.0; EIGHT]; 2];
                for lane in 0..EIGHT {
                    let at = |i: usize| starts[i][lane] + slopes[i] * y;
                    values[0][lane] = least([at(0), at(1), at(2)]);
                    values[1][lane] = at(3);
                }
                let [inside, depth] = values;
                for lane in 0..EIGHT {
                    let is_seen = (inside[lane] > bound) & (depth[lane] + tolerance < before[lane]);
                    let may_be_seen = (inside[lane] >= -bound) & (depth[lane] - tolerance < before[lane]);
                    doubts[lane] |= u32::from(may_be_seen & !is_seen);
                    depths[lane] = if is_seen { depth[lane] } else { before[lane] };
                    faces[lane] = if is_seen { number } else { face_before[lane] };
                }
            }
        }
        doubts.iter().fold(0, |any, doubt| any | doubt) != 0
    }
}
