//! Splits of edges that are too long.

use super::changing::{Changing, Edge};
use super::guard::{Proposal, Proposals};
use super::surface::Site;
use bokashi_render_ops::glam::DVec3;

/// Longer edges are split.
pub(super) const LONGEST: f64 = 4.0 / 3.0;

/// A point that is off the middle by less than this share of the edge's length is on the edge.
const STRAIGHT: f64 = 1e-12;

/// The most halvings of an edge: more would leave the range of the numbers.
const PASSES: usize = 64;

impl Changing<'_> {
    /// Splits edges, longest first, until none is longer than 4/3 of its target length, or there are `most_faces`.
    pub(super) fn split_long_edges(&mut self, most_faces: usize) {
        for pass in 0..PASSES {
            // Faces of a pass stand in the leaves of those that they were made of.
            if pass > 0 && self.tree.is_some() {
                self.plant();
            }
            let mut long = Vec::new();
            self.for_each_edge(|a, b| {
                let length = self.relative_length(a, b);
                if length > LONGEST {
                    long.push((length, a, b));
                }
            });
            long.sort_unstable_by(|one, other| {
                other.0.total_cmp(&one.0).then((one.1, one.2).cmp(&(other.1, other.2)))
            });
            let mut is_done = true;
            for (_, a, b) in long {
                if self.live + 2 > most_faces {
                    return;
                }
                if let Some(edge) = self.edge(a, b) {
                    is_done &= !self.try_split(&edge);
                }
            }
            if is_done {
                return;
            }
        }
    }

    /// Splits an edge, unless one of its faces has a longer edge. If that one must not be split, splits of the edges
    /// beside it would never end.
    fn try_split(&mut self, edge: &Edge) -> bool {
        let [a, b] = edge.ends;
        let length = self.relative_length(a, b);
        let is_shorter = |(_, across): (u32, u32)| {
            [a, b].iter().any(|end| self.relative_length(*end, across) > length)
        };
        if edge.sides().any(is_shorter) {
            return false;
        }
        let (site, point) = self.middle(a, b);
        let mut proposals = Proposals::new();
        let middle = self.points.len() as u32;
        for (old, _) in edge.sides() {
            for end in [a, b] {
                let mut face = self.faces[old as usize];
                let mut points = self.corners(face);
                for k in (0..3).filter(|k| face[*k] == end) {
                    points[k] = point;
                }
                face = face.map(|vertex| if vertex == end { middle } else { vertex });
                proposals.push(Proposal { face, points, old });
            }
        }
        let gone = if edge.is_boundary() { &edge.faces[..1] } else { &edge.faces[..] };
        // At the middle of the edge no normal changes. A needle may become worse there until its other edges are split.
        let is_straight = point.distance(0.5 * (self.points[a as usize] + self.points[b as usize]))
            <= STRAIGHT * self.points[a as usize].distance(self.points[b as usize]);
        let allows = is_straight || self.allows(gone, &proposals);
        if allows {
            self.split(edge, site, point);
        }
        allows
    }

    /// The point of the old surface nearest to the middle of an edge, by a walk from either end.
    pub(super) fn middle(&self, a: u32, b: u32) -> (Site, DVec3) {
        let [i, j] = [a as usize, b as usize];
        let middle = 0.5 * (self.points[i] + self.points[j]);
        let [one, other] = [i, j].map(|end| self.surface.nearest(self.sites[end], middle));
        let site = if other.1 < one.1 { other.0 } else { one.0 };
        (site, self.surface.point(site))
    }
}
