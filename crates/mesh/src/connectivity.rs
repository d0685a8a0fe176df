//! The topology of a mesh: its parts, its boundaries and its Euler characteristic.

use bokashi_render_ops::Mesh;
use bokashi_render_ops::edges::{Side, edges, repeats_a_vertex, sides};

use crate::groups::{Groups, NO_GROUP};
use crate::triangle::corner_of;

/// Parts, boundaries and the Euler characteristic of a mesh. A face that names a vertex twice is left out.
///
/// Faces that share an edge are of one part. Faces that share nothing but a vertex are not.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Connectivity {
    /// The number of vertices that belong to a face.
    pub vertices: usize,
    /// The number of edges.
    pub edges: usize,
    /// The number of faces that name three vertices.
    pub faces: usize,
    /// The number of edges of one face.
    pub boundary_edges: usize,
    /// The number of edges of three faces and more.
    pub crowded_edges: usize,
    /// The number of vertices at which fans of faces meet that share no edge.
    pub pinched_vertices: usize,
    /// The number of closed loops of edges that have other than two faces.
    pub boundary_loops: usize,
    /// Whether two faces run through each edge that they share in opposite directions.
    pub is_oriented: bool,
    part_count: usize,
    parts: Vec<u32>,
}

impl Connectivity {
    /// Counts the parts, boundaries and fans of `mesh`. It sorts the sides of all faces.
    pub fn new(mesh: &Mesh) -> Self {
        let faces = mesh.faces();
        let sides = sides(faces);
        let mut found = Self {
            vertices: 0,
            edges: 0,
            faces: faces.iter().filter(|face| !repeats_a_vertex(**face)).count(),
            boundary_edges: 0,
            crowded_edges: 0,
            pinched_vertices: 0,
            boundary_loops: 0,
            is_oriented: true,
            part_count: 0,
            parts: Vec::new(),
        };
        // Corners of a vertex that an edge joins are of one fan; sides that face one way out, of one loop.
        let (mut parts, mut fans) = (Groups::new(faces.len()), Groups::new(3 * faces.len()));
        for edge in edges(&sides) {
            found.edges += 1;
            for pair in edge.windows(2) {
                parts.join(pair[0].face, pair[1].face);
            }
            match edge {
                [_] => found.boundary_edges += 1,
                [one, other] => {
                    found.is_oriented &= one.rises != other.rises;
                    for end in one.ends {
                        fans.join(corner_at(faces, one, end), corner_at(faces, other, end));
                    }
                }
                _ => found.crowded_edges += 1,
            }
        }
        let labels = parts.labels(|face| !repeats_a_vertex(faces[face as usize]));
        (found.parts, found.part_count) = labels;
        found.count_fans(mesh, &mut fans);
        found.boundary_loops = loops(faces, &sides, &mut fans);
        found
    }

    fn count_fans(&mut self, mesh: &Mesh, fans: &mut Groups) {
        let faces = mesh.faces();
        let mut seen = vec![NO_GROUP; mesh.vertex_count()];
        let mut is_pinched = vec![false; mesh.vertex_count()];
        for (face, index) in faces.iter().zip(0..).filter(|(face, _)| !repeats_a_vertex(**face)) {
            for (&vertex, corner) in face.iter().zip(0..) {
                let (fan, vertex) = (fans.first(3 * index + corner), vertex as usize);
                is_pinched[vertex] |= seen[vertex] != NO_GROUP && seen[vertex] != fan;
                seen[vertex] = fan;
            }
        }
        self.vertices = seen.iter().filter(|fan| **fan != NO_GROUP).count();
        self.pinched_vertices = is_pinched.iter().filter(|it| **it).count();
    }

    /// Vertices minus edges plus faces: 2 for each closed part, less 2 for each of its handles.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.faces as i64
    }

    /// The number of parts.
    pub fn parts(&self) -> usize {
        self.part_count
    }

    /// The part of a face, counted from 0 in the order of the faces. `None` for a face that names a vertex twice.
    ///
    /// # Panics
    /// Unless there is such a face.
    pub fn part_of(&self, face: usize) -> Option<usize> {
        let part = self.parts[face];
        (part != NO_GROUP).then_some(part as usize)
    }

    /// Whether each edge has two faces or more.
    pub fn is_closed(&self) -> bool {
        self.boundary_edges == 0
    }

    /// Whether the surface looks like a disc, or half of one, around each point of it.
    pub fn is_manifold(&self) -> bool {
        self.crowded_edges == 0 && self.pinched_vertices == 0
    }
}

/// The corner of a side's face at one of the side's ends, by its place in the list of all corners.
fn corner_at(faces: &[[u32; 3]], side: &Side, end: u32) -> u32 {
    3 * side.face + corner_of(faces[side.face as usize], end) as u32
}

/// The number of closed loops of the sides of edges that have other than two faces. Two sides follow each other where
/// they bound the same fan of faces.
fn loops(faces: &[[u32; 3]], sides: &[Side], fans: &mut Groups) -> usize {
    let ends: Vec<&Side> = edges(sides).filter(|edge| edge.len() != 2).flatten().collect();
    let mut rings = Groups::new(ends.len());
    let mut by_fan: Vec<(u32, u32)> = Vec::with_capacity(2 * ends.len());
    for (side, index) in ends.iter().zip(0..) {
        by_fan.extend(side.ends.map(|end| (fans.first(corner_at(faces, side, end)), index)));
    }
    by_fan.sort_unstable();
    for same in by_fan.chunk_by(|one, other| one.0 == other.0) {
        same.windows(2).for_each(|pair| rings.join(pair[0].1, pair[1].1));
    }
    rings.labels(|_| true).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{Model, cube, sheet, sphere, tetrahedron, torus};

    fn connectivity(faces: &[[u32; 3]], count: usize) -> Connectivity {
        Connectivity::new(&Mesh::new(faces.to_vec(), count).unwrap())
    }

    #[test]
    fn plain_surfaces_have_the_numbers_that_are_known() {
        let numbers = |model: Model| {
            let found = Connectivity::new(&model.mesh());
            assert!(found.is_manifold() && found.is_oriented);
            assert_eq!(found.is_closed(), found.boundary_loops == 0);
            (found.euler_characteristic(), found.parts(), found.boundary_loops)
        };
        assert_eq!(numbers(tetrahedron()), (2, 1, 0));
        assert_eq!(numbers(cube()), (2, 1, 0));
        assert_eq!(numbers(sphere(5)), (2, 1, 0));
        assert_eq!(numbers(torus(7, 5, 0.3)), (0, 1, 0));
        assert_eq!(numbers(sheet(3)), (1, 1, 1));
        assert_eq!(numbers(torus(7, 5, 0.3).and(sheet(2)).and(cube())), (3, 3, 1));
        // A face less is one loop more; two faces that touch at a corner are two loops.
        let mut holes = sphere(6);
        holes.faces.truncate(holes.faces.len() - 1);
        assert_eq!(numbers(holes), (1, 1, 1));
    }

    #[test]
    fn a_bow_tie_is_two_parts_and_two_loops() {
        let bow_tie = connectivity(&[[0, 1, 2], [0, 3, 4]], 5);
        assert_eq!((bow_tie.parts(), bow_tie.boundary_loops, bow_tie.pinched_vertices), (2, 2, 1));
        assert!(!bow_tie.is_manifold());
        assert_eq!([bow_tie.part_of(0), bow_tie.part_of(1)], [Some(0), Some(1)]);
        assert_eq!(bow_tie.euler_characteristic(), 1);
    }

    #[test]
    fn three_faces_at_an_edge_hang_together() {
        let crowded = connectivity(&[[0, 1, 2], [1, 0, 3], [0, 1, 4]], 5);
        assert_eq!((crowded.parts(), crowded.crowded_edges, crowded.boundary_edges), (1, 1, 6));
        assert_eq!((crowded.vertices, crowded.edges, crowded.faces), (5, 7, 3));
    }

    #[test]
    fn turned_faces_and_degenerate_ones_are_told() {
        assert!(!connectivity(&[[0, 1, 2], [0, 1, 3]], 4).is_oriented);
        let degenerate = connectivity(&[[3, 3, 3], [0, 1, 2], [0, 0, 1]], 5);
        assert_eq!((degenerate.faces, degenerate.vertices, degenerate.parts()), (1, 3, 1));
        assert_eq!([0, 1, 2].map(|face| degenerate.part_of(face)), [None, Some(0), None]);
        let empty = connectivity(&[], 4);
        assert_eq!((empty.euler_characteristic(), empty.parts(), empty.boundary_loops), (0, 0, 0));
        assert!(empty.is_closed() && empty.is_manifold());
        // A strip with half a turn has one boundary.
        let strip = [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4], [4, 5, 1], [5, 0, 1]];
        let moebius = connectivity(&strip, 6);
        assert_eq!((moebius.euler_characteristic(), moebius.boundary_loops), (0, 1));
        assert!(!moebius.is_oriented && moebius.is_manifold());
    }
}
