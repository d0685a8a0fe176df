//! Flips of edges, toward six edges at each vertex, and four at a boundary.

use bokashi_render_ops::glam::DVec3;

use super::changing::{Changing, Edge};
use super::guard::{Proposal, keeps_normal};
use crate::triangle::{area_vector, quality};

/// Passes over all edges: a flip may make way for another.
const PASSES: usize = 8;

/// The least cosine between normals of the faces after a flip and those before: a flip over a crease would cut it.
const FLAT: f64 = 0.866;

/// The least ratio of the worse quality after a flip and before it, where the flip makes valences no better.
const GAIN: f64 = 1.05;

impl Changing<'_> {
    /// Flips edges in the order of the faces.
    pub(super) fn flip_edges(&mut self) {
        for _ in 0..PASSES {
            let mut edges = Vec::new();
            self.for_each_edge(|a, b| edges.push((a, b)));
            let mut is_done = true;
            for (a, b) in edges {
                if let Some(edge) = self.edge(a, b)
                    && !edge.is_boundary()
                    && self.may_flip(&edge)
                {
                    self.flip(&edge);
                    is_done = false;
                }
            }
            if is_done {
                return;
            }
        }
    }

    /// Whether the flip of an edge of two faces is allowed and gains something.
    fn may_flip(&self, edge: &Edge) -> bool {
        let ([a, b], [c, d]) = (edge.ends, edge.across);
        if c == d || self.is_seam(a, b) {
            return false;
        }
        // The faces at a vertex beyond the six (or three) of a regular mesh. A flip takes one from a and b, and adds
        // one to c and d.
        let excess = |vertex: u32| {
            let faces = self.around[vertex as usize].len() as i64;
            if self.ends_at[vertex as usize] { faces - 3 } else { faces - 6 }
        };
        let ends = excess(a) + excess(b);
        let across = excess(c) + excess(d);
        // The change of the sum of squares of the excess, halved: (x - 1)^2 - x^2 = 1 - 2 x, (x + 1)^2 - x^2 = 1 + 2 x.
        let change = 2 - ends + across;
        if change > 0 {
            return false;
        }
        let faces = edge.faces.map(|face| self.faces[face as usize]);
        let old = faces.map(|face| self.corners(face));
        let replaced = |face: [u32; 3], old: u32, new: u32| {
            face.map(|vertex| if vertex == old { new } else { vertex })
        };
        let faces = [replaced(faces[0], b, d), replaced(faces[1], a, c)];
        let new = faces.map(|face| self.corners(face));
        let worst = |of: [[DVec3; 3]; 2]| quality(of[0]).min(quality(of[1]));
        let (before, after) = (worst(old), worst(new));
        let gains = if change < 0 { after >= 0.5 * before } else { after > GAIN * before };
        if !gains || !is_flat(old, new) || self.are_neighbors(c, d) {
            return false;
        }
        let proposal = |k: usize| Proposal { face: faces[k], points: new[k], old: edge.faces[k] };
        self.allows(&edge.faces, &[proposal(0), proposal(1)])
    }

    /// Whether an edge lies between two vertices.
    fn are_neighbors(&self, a: u32, b: u32) -> bool {
        let [least, other] = self.by_faces([a, b]);
        self.around[least as usize].iter().any(|face| self.faces[*face as usize].contains(&other))
    }
}

/// Whether all normals before and after a flip are close.
fn is_flat(old: [[DVec3; 3]; 2], new: [[DVec3; 3]; 2]) -> bool {
    let crossed = [(old[0], new[1]), (old[1], new[0])];
    let straight = [(old[0], new[0]), (old[1], new[1])];
    straight.into_iter().chain(crossed).all(|(before, after)| {
        let [m, n] = [before, after].map(area_vector);
        m.dot(n) >= FLAT * (m.length() * n.length())
            || (quality(before) < 1e-6 && keeps_normal(before, after))
    })
}
