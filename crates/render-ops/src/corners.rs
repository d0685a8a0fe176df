//! Which corners of faces stand at each vertex.
//!
//! A sum over the faces of a vertex runs over this list, in the order of the faces. So what faces
//! would add to their vertices is gathered by each vertex, at the same time for many vertices and with
//! the same bits for any number of threads.

/// The corners at each vertex of a mesh. Corner k of face f is number `3 f + k`.
#[derive(Debug, Clone, Default)]
pub(crate) struct Corners {
    /// Per vertex where its corners begin, and the end of the last vertex's.
    starts: Vec<usize>,
    corners: Vec<usize>,
}

impl Corners {
    /// The corners of `faces` over `vertex_count` vertices.
    pub(crate) fn new(faces: &[[u32; 3]], vertex_count: usize) -> Self {
        let mut starts = vec![0; vertex_count + 1];
        for &vertex in faces.as_flattened() {
            starts[vertex as usize + 1] += 1;
        }
        for vertex in 0..vertex_count {
            starts[vertex + 1] += starts[vertex];
        }
        let mut next = starts.clone();
        let mut corners = vec![0; 3 * faces.len()];
        for (corner, &vertex) in faces.as_flattened().iter().enumerate() {
            let position = &mut next[vertex as usize];
            corners[*position] = corner;
            *position += 1;
        }
        Self { starts, corners }
    }

    /// The corners at `vertex`, ascending.
    #[inline(always)]
    pub(crate) fn around(&self, vertex: usize) -> &[usize] {
        &self.corners[self.starts[vertex]..self.starts[vertex + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_corner_stands_at_its_vertex_once_and_in_order() {
        let faces = [[4, 0, 2], [2, 2, 0], [0, 4, 1]];
        let corners = Corners::new(&faces, 6);
        let expected: [&[usize]; 6] = [&[1, 5, 6], &[8], &[2, 3, 4], &[], &[0, 7], &[]];
        for (vertex, expected) in expected.into_iter().enumerate() {
            assert_eq!(corners.around(vertex), expected, "{vertex}");
        }
        assert_eq!(Corners::new(&[], 1).around(0), [0; 0]);
    }
}
