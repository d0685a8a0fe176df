//! The edges of a mesh, and which faces have them.

/// A side of a face. An edge has a side for each face that it belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Side {
    /// The vertices at its ends, the lower one first.
    pub ends: [u32; 2],
    /// The face.
    pub face: u32,
    /// The corner that faces the side.
    pub corner: u8,
    /// Whether the face runs from the lower to the higher vertex.
    pub rises: bool,
}

/// Whether a face names a vertex twice. Such a face has no area, and no sides.
pub fn repeats_a_vertex([a, b, c]: [u32; 3]) -> bool {
    a == b || b == c || c == a
}

/// The sides of all faces that name three vertices, sorted by their ends. Those of an edge are neighbours, in the
/// order of the faces.
pub fn sides(faces: &[[u32; 3]]) -> Vec<Side> {
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
pub fn edges(sides: &[Side]) -> impl Iterator<Item = &[Side]> {
    sides.chunk_by(|one, other| one.ends == other.ends)
}
