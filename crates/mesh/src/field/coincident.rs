//! Merges vertices at one place, and drops faces without an area, without opening the surface.
//!
//! Where the field is 0 at a point of the grid, the vertices of all its edges stand at this point. An edge between two
//! of them is collapsed where the topology stays the same: the links of its ends meet in the link of the edge alone.
//! Other edges stay with their faces, since collapses would pinch or tear the surface. A tetrahedron of vertices at one
//! point has no volume and is dropped.
//!
//! The vertex that stays is the one with the lower number. A border counts as the link to a vertex beyond.
//!
//! # Source
//! Dey, Edelsbrunner, Guha and Nekhayev, *Topology preserving edge contraction*, 1999.

use smallvec::SmallVec;

use crate::derived_mesh::kept_part;
use crate::groups::Groups;
use crate::triangle::other_corners;

/// A vertex beyond the border.
const BEYOND: u32 = u32::MAX;

/// The edges of faces with both ends at one place, each once and with the lower end first.
pub(super) fn coincident_edges<T: PartialEq>(
    faces: &[[u32; 3]],
    vertices: &[[T; 3]],
) -> Vec<[u32; 2]> {
    let edges = faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
    let is_same = |[a, b]: &[u32; 2]| vertices[*a as usize] == vertices[*b as usize];
    let mut edges: Vec<_> = edges.filter(is_same).map(|[a, b]| [a.min(b), a.max(b)]).collect();
    edges.sort_unstable();
    edges.dedup();
    edges
}

/// Collapses `edges`, those of [`coincident_edges`], as far as the topology allows. Returns the vertices that are left,
/// and the faces, with indices into this list.
pub(super) fn collapse(
    faces: Vec<[u32; 3]>,
    vertex_count: usize,
    mut edges: Vec<[u32; 2]>,
) -> (Vec<u32>, Vec<[u32; 3]>) {
    let mut surface = Surface::new(faces, vertex_count, &edges);
    // What is collapsed can make way for what could not be.
    loop {
        let before = edges.len();
        edges.retain(|&edge| !surface.is_settled(edge));
        if edges.len() == before {
            return surface.compact();
        }
    }
}

/// Faces over vertices of which some stand at one place.
#[derive(Debug)]
struct Surface {
    /// A face that was dropped names one vertex three times.
    faces: Vec<[u32; 3]>,
    /// By vertex: its faces.
    stars: Vec<SmallVec<[u32; 8]>>,
    /// Vertices that were merged: the lowest of a group is left.
    merged: Groups,
    /// Vertices at one place, as far as edges lead.
    places: Groups,
}

impl Surface {
    fn new(faces: Vec<[u32; 3]>, vertex_count: usize, edges: &[[u32; 2]]) -> Self {
        let mut stars = vec![SmallVec::new(); vertex_count];
        for (number, face) in (0..).zip(&faces) {
            face.iter().for_each(|&vertex| stars[vertex as usize].push(number));
        }
        let mut places = Groups::new(vertex_count);
        edges.iter().for_each(|&[a, b]| places.join(a, b));
        Self { faces, stars, merged: Groups::new(vertex_count), places }
    }

    /// The link of a vertex: the edges of its faces that it faces. On a border the chain of these edges continues from
    /// both ends to [`BEYOND`].
    fn link(&self, vertex: u32) -> Vec<[u32; 2]> {
        let star = &self.stars[vertex as usize];
        let across = |&face: &u32| {
            let [a, b] = other_corners(self.faces[face as usize], vertex);
            [a.min(b), a.max(b)]
        };
        let mut link: Vec<_> = star.iter().map(across).collect();
        let mut ends = link.as_flattened().to_vec();
        ends.sort_unstable();
        let alone = ends.chunk_by(|a, b| a == b).filter(|same| same.len() == 1);
        link.extend(alone.map(|same| [same[0], BEYOND]));
        link
    }

    /// Whether an edge is done: it is collapsed now, or was with others. Otherwise it is tried again later.
    fn is_settled(&mut self, edge: [u32; 2]) -> bool {
        let [a, b] = edge.map(|end| self.merged.first(end));
        let (kept, gone) = (a.min(b), a.max(b));
        if kept == gone || self.stars[kept as usize].is_empty() {
            return true;
        }
        let [link, other] = [kept, gone].map(|end| self.link(end));
        let has = |edges: &[[u32; 2]], x: u32| edges.as_flattened().contains(&x);
        // The link of the edge: what the link of one end joins to the other end.
        let joined = |[x, y]: &[u32; 2]| match (*x == gone, *y == gone) {
            (true, _) => Some(*y),
            (_, true) => Some(*x),
            _ => None,
        };
        let of_edge: Vec<_> = link.iter().filter_map(joined).collect();
        let [first, second] = of_edge[..] else { return false };
        let is_common = |x: &u32| ![first, second].contains(x) && has(&other, *x);
        if link.as_flattened().iter().any(is_common) {
            return false;
        }
        let across = [first.min(second), first.max(second)];
        if link.contains(&across) && other.contains(&across) {
            return second != BEYOND && self.drops_tetrahedron([kept, gone, first, second]);
        }
        self.merge(kept, gone);
        true
    }

    /// Drops a tetrahedron that is a part of its own, if its vertices stand at one place.
    fn drops_tetrahedron(&mut self, vertices: [u32; 4]) -> bool {
        let places = vertices.map(|vertex| self.places.first(vertex));
        let is_apart = vertices.iter().all(|&vertex| self.stars[vertex as usize].len() == 3);
        if !is_apart || places.iter().any(|&place| place != places[0]) {
            return false;
        }
        for vertex in vertices {
            for face in std::mem::take(&mut self.stars[vertex as usize]) {
                self.faces[face as usize] = [vertex; 3];
            }
        }
        true
    }

    /// Merges a vertex into another one.
    fn merge(&mut self, kept: u32, gone: u32) {
        self.merged.join(kept, gone);
        for face in std::mem::take(&mut self.stars[gone as usize]) {
            let corners = self.faces[face as usize];
            if !corners.contains(&kept) {
                self.faces[face as usize] = corners.map(|it| if it == gone { kept } else { it });
                self.stars[kept as usize].push(face);
                continue;
            }
            for corner in corners {
                self.stars[corner as usize].retain(|other| *other != face);
            }
            self.faces[face as usize] = [kept; 3];
        }
    }

    /// The vertices that are left, and the faces with their places among these.
    fn compact(self) -> (Vec<u32>, Vec<[u32; 3]>) {
        let faces = self.faces.into_iter().filter(|[a, b, _]| a != b);
        kept_part(self.stars.len(), |vertex| !self.stars[vertex].is_empty(), faces)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_octahedron_loses_two_faces_with_an_edge_and_all_of_them_at_one_place() {
        // The vertices 0 to 3 around, 4 above, 5 below.
        let faces: Vec<_> =
            (0..4).flat_map(|k| [[k, (k + 1) % 4, 4], [(k + 1) % 4, k, 5]]).collect();
        // Vertices 0 and 4 at one place: two faces go.
        let (vertices, kept) = collapse(faces.clone(), 6, vec![[0, 4]]);
        assert_eq!((vertices, kept.len()), (vec![0, 1, 2, 3, 5], 6));
        // All at one place: nothing is left.
        let everywhere = coincident_edges(&faces, &[[0.0; 3]; 6]);
        assert_eq!(everywhere.len(), 12);
        assert_eq!(collapse(faces, 6, everywhere), (vec![], vec![]));
    }

    #[test]
    fn what_would_pinch_the_surface_stays() {
        // A ring of three around a hole, open above and below: prisms without caps.
        let ring: Vec<_> = (0..3)
            .flat_map(|k| [[k, (k + 1) % 3, k + 3], [(k + 1) % 3, (k + 1) % 3 + 3, k + 3]])
            .collect();
        let (vertices, faces) = collapse(ring.clone(), 6, vec![[0, 1], [0, 2], [1, 2]]);
        assert_eq!((vertices.len(), faces), (6, ring));
        // Across, from border to border: it would cut the ring.
        let ring = vec![[0, 1, 3], [1, 4, 3], [1, 2, 4], [2, 5, 4], [2, 0, 5], [0, 3, 5]];
        let (vertices, faces) = collapse(ring.clone(), 6, vec![[0, 3], [1, 4]]);
        assert_eq!((vertices.len(), faces), (6, ring));
    }

    #[test]
    fn a_face_at_the_border_goes_with_its_edge() {
        let fan = vec![[0, 1, 2], [0, 2, 3]];
        let (vertices, faces) = collapse(fan, 4, vec![[0, 1]]);
        assert_eq!((vertices, faces), (vec![0, 2, 3], vec![[0, 1, 2]]));
        let alone = vec![[0, 1, 2]];
        assert_eq!(collapse(alone.clone(), 3, vec![[0, 1]]).1, alone);
    }
}
