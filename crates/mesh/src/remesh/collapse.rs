//! Collapses of edges that are too short.

use bokashi_render_ops::glam::DVec3;
use smallvec::SmallVec;

use super::changing::{Changing, Edge, Kind};
use super::guard::{MOST_FACES, Proposal, Proposals};
use super::split::LONGEST;
use super::surface::Site;

/// Shorter edges are collapsed.
const SHORTEST: f64 = 4.0 / 5.0;

/// Edges shorter than this are sorted by the power of two of their length, and then by their indices. So edges that are
/// neighbours in memory come one after another.
const TINY: f64 = 0.25;

/// Passes over all short edges: what a pass moves may make others short.
const PASSES: usize = 8;

/// The least cosine between the edges of a boundary at a vertex that may vanish: 30 degrees.
const STRAIGHT: f64 = 0.866;

/// The vertex that vanishes, the vertex that is kept, and the point to which it moves.
type Way = (u32, u32, (Site, DVec3));

/// The key by which edges are sorted: by length, but for [`TINY`] ones.
fn order(length: f64) -> u64 {
    let bits = length.to_bits();
    if length < TINY { bits >> 52 << 52 } else { bits }
}

impl Changing<'_> {
    /// Collapses edges that are shorter than 4/5 of their target length, in their [`order`].
    pub(super) fn collapse_short_edges(&mut self) {
        for _ in 0..PASSES {
            let mut short = Vec::new();
            self.for_each_edge(|a, b| {
                let length = self.relative_length(a, b);
                if length < SHORTEST {
                    short.push((order(length), a, b));
                }
            });
            short.sort_unstable();
            let mut is_done = true;
            for (_, a, b) in short {
                // An end may have vanished or moved since.
                if let Some(edge) = self.edge(a, b)
                    && self.relative_length(a, b) < SHORTEST
                {
                    is_done &= !self.try_collapse(&edge);
                }
            }
            if is_done {
                return;
            }
        }
    }

    fn try_collapse(&mut self, edge: &Edge) -> bool {
        let [a, b] = edge.ends;
        let faces = [a, b].map(|end| self.around[end as usize].len()).iter().sum::<usize>();
        if faces > 2 * MOST_FACES || !self.keeps_topology(edge) {
            return false;
        }
        let at = |vertex: u32| (self.sites[vertex as usize], self.points[vertex as usize]);
        let may_vanish = |vertex: u32, other: u32| match self.kinds[vertex as usize] {
            Kind::Free => !edge.is_boundary(),
            Kind::Boundary => edge.is_boundary() && self.is_straight(edge, vertex, other),
            Kind::Fixed => false,
        };
        let mut ways: SmallVec<[Way; 3]> = SmallVec::new();
        if self.kinds[a as usize] == Kind::Free && self.kinds[b as usize] == Kind::Free {
            ways.push((b, a, self.middle(a, b)));
        }
        for (gone, kept) in [(b, a), (a, b)] {
            if may_vanish(gone, kept) {
                ways.push((gone, kept, at(kept)));
            }
        }
        for (gone, kept, (site, point)) in ways {
            if self.may_join(edge, gone, kept, (site, point)) {
                self.collapse(edge, gone, site, point);
                return true;
            }
        }
        false
    }

    /// Whether a collapse keeps the topology (the link condition). Only the vertices across may be neighbours of both
    /// ends, and no other edge may face both ends. A face whose edges are all at a boundary stays.
    ///
    /// # Source
    /// Dey, Edelsbrunner, Guha and Nekhayev, *Topology preserving edge contraction*, 1999.
    fn keeps_topology(&self, edge: &Edge) -> bool {
        let ([a, b], [c, d]) = (edge.ends, edge.across);
        let neighbors = |vertex: u32| {
            let faces = self.around[vertex as usize].iter();
            let mut all: SmallVec<[u32; 24]> =
                faces.flat_map(|face| self.other_corners(*face, vertex)).collect();
            all.sort_unstable();
            all.dedup();
            all
        };
        let (of_a, of_b) = (neighbors(a), neighbors(b));
        let shared = of_a.iter().filter(|vertex| of_b.binary_search(vertex).is_ok()).count();
        if shared != edge.sides().count() {
            return false;
        }
        if edge.is_boundary() {
            return [a, b].iter().any(|end| !self.edge(*end, c).is_some_and(|it| it.is_boundary()));
        }
        let faces_both = |vertex: u32| {
            let faces = &self.around[vertex as usize];
            faces.iter().any(|face| [c, d].iter().all(|it| self.faces[*face as usize].contains(it)))
        };
        !(faces_both(a) && faces_both(b))
    }

    /// Whether the boundary is [`STRAIGHT`] at `vertex`, between the edge to `other` and the next one.
    fn is_straight(&self, edge: &Edge, vertex: u32, other: u32) -> bool {
        let along = |from: u32, to: u32| {
            (self.points[to as usize] - self.points[from as usize]).normalize_or_zero()
        };
        let faces = self.around[vertex as usize].iter();
        let mut beyond = faces
            .flat_map(|face| self.other_corners(*face, vertex))
            .filter(|it| *it != other && self.ends_at[*it as usize])
            .filter(|it| self.edge(vertex, *it).is_some_and(|it| it.is_boundary()));
        debug_assert!(edge.is_boundary());
        beyond.next().is_some_and(|it| along(it, vertex).dot(along(vertex, other)) >= STRAIGHT)
    }

    /// Whether the ends of an edge may meet at `point`. The faces around them must stay within the limits of `guard`,
    /// and no edge may become so long that it would be split.
    fn may_join(&self, edge: &Edge, gone: u32, kept: u32, (site, point): (Site, DVec3)) -> bool {
        let target = self.target_of(kept, site);
        let (mut proposals, mut faces) = (Proposals::new(), SmallVec::<[u32; 16]>::new());
        for end in [gone, kept] {
            for &old in &self.around[end as usize] {
                if edge.faces.contains(&old) {
                    if end == gone {
                        faces.push(old);
                    }
                    continue;
                }
                // A face at an end that stays where it is does not change.
                if end == kept && site == self.sites[kept as usize] {
                    continue;
                }
                faces.push(old);
                let mut face = self.faces[old as usize];
                let mut points = self.corners(face);
                for k in 0..3 {
                    if face[k] == end {
                        (face[k], points[k]) = (kept, point);
                        continue;
                    }
                    let other = face[k] as usize;
                    let longest = LONGEST * target.min(self.targets[other]);
                    if self.points[other].distance_squared(point) > longest * longest {
                        return false;
                    }
                }
                proposals.push(Proposal { face, points, old });
            }
        }
        self.allows(&faces, &proposals)
    }

    /// The target length at `vertex` after it is moved to `site`.
    fn target_of(&self, vertex: u32, site: Site) -> f64 {
        if site == self.sites[vertex as usize] {
            self.targets[vertex as usize]
        } else {
            self.target_at(site)
        }
    }
}
