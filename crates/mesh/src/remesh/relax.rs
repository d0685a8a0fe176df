//! Tangential smoothing: vertices move along the surface toward the middle of their neighbours.
//!
//! With neighbours `x_j` and target lengths `t`, the middle is their mean with the weights `1 / (t + t_j)`. If all
//! edges have their target lengths, it is the vertex itself. The offset along the normal is left out (Botsch and
//! Kobbelt), and the point is projected to the old surface.

use bokashi_render_ops::glam::DVec3;

use super::changing::{Changing, Kind};
use super::guard::{MOST_FACES, Proposal, Proposals};
use crate::triangle::area_vector;

/// Shares of the move that are tried, one after another.
const SHARES: [f64; 3] = [1.0, 0.5, 0.25];

/// A move shorter than this share of the target length is left out.
const LEAST_MOVE: f64 = 0.01;

impl Changing<'_> {
    /// Moves the free vertices, one after another in their order.
    pub(super) fn relax(&mut self) {
        for vertex in 0..self.points.len() as u32 {
            if self.kinds[vertex as usize] == Kind::Free
                && (1..=MOST_FACES).contains(&self.around[vertex as usize].len())
            {
                self.relax_vertex(vertex);
            }
        }
    }

    fn relax_vertex(&mut self, vertex: u32) {
        let index = vertex as usize;
        let (from, target) = (self.points[index], self.targets[index]);
        let (mut sum, mut weights, mut normal) = (DVec3::ZERO, 0.0, DVec3::ZERO);
        for &face in &self.around[index] {
            let neighbor = self.other_corners(face, vertex)[0] as usize;
            let weight = target / (target + self.targets[neighbor]);
            sum += weight * self.points[neighbor];
            weights += weight;
            normal += area_vector(self.corners(self.faces[face as usize]));
        }
        let normal = normal.normalize_or_zero();
        let way = sum / weights - from;
        let way = way - normal * normal.dot(way);
        if way.length_squared() < LEAST_MOVE * LEAST_MOVE * target * target {
            return;
        }
        for share in SHARES {
            let (site, _) = self.surface.nearest(self.sites[index], from + share * way);
            let point = self.surface.point(site);
            let proposals: Proposals = self.around[index]
                .iter()
                .map(|&old| {
                    let face = self.faces[old as usize];
                    let mut points = self.corners(face);
                    for k in (0..3).filter(|k| face[*k] == vertex) {
                        points[k] = point;
                    }
                    Proposal { face, points, old }
                })
                .collect();
            if self.allows(&self.around[index], &proposals) {
                self.place(vertex, site, point);
                self.note(vertex);
                return;
            }
        }
    }
}
