//! The edges of a mesh, and which faces have them.

use crate::triangle::repeats_a_vertex;

/// One face's side: the corner that faces it, and the direction in which the face runs through it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Side {
    /// The lower vertex first.
    pub(crate) ends: [u32; 2],
    pub(crate) face: u32,
    pub(crate) corner: u8,
    /// Whether the face runs from the lower to the higher vertex.
    pub(crate) rises: bool,
}

/// The sides of all proper faces by their ends; those of an edge are neighbours, in the order of the faces.
pub(crate) fn sides(faces: &[[u32; 3]]) -> Vec<Side> {
    let mut sides = Vec::with_capacity(3 * faces.len());
    for (face, index) in faces.iter().zip(0..).filter(|(face, _)| !repeats_a_vertex(**face)) {
        for corner in 0..3_u8 {
            let [a, b] = [1, 2].map(|step| face[(usize::from(corner) + step) % 3]);
            let ends = [a.min(b), a.max(b)];
            sides.push(Side { ends, face: index, corner, rises: a < b });
        }
    }
    sides.sort_unstable();
    sides
}

/// The sides of each edge.
pub(crate) fn edges(sides: &[Side]) -> impl Iterator<Item = &[Side]> {
    sides.chunk_by(|one, other| one.ends == other.ends)
}
