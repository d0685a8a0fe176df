//! The automorphisms of a triangulation: permutations of the vertices that map its faces onto its
//! faces.
//!
//! A learnt mesh whose vertices are permuted by one of them, and whose colours are permuted alike,
//! gives the same image as the original from everywhere: which one a fit ends in is chance.
//! Windings don't count, since both sides of a face are drawn.

/// Every permutation `p` of `0..vertex_count` such that `{p(a), p(b), p(c)}` is a face for every
/// face `{a, b, c}`, in lexicographic order. The identity is the first.
pub fn automorphisms(faces: &[[u32; 3]], vertex_count: usize) -> Vec<Vec<usize>> {
    let mut set: Vec<[u32; 3]> = faces.iter().copied().map(sorted).collect();
    set.sort_unstable();
    set.dedup();
    let mut search = Search {
        faces: &set,
        image: Vec::with_capacity(vertex_count),
        used: vec![false; vertex_count],
        automorphisms: Vec::new(),
    };
    search.extend();
    search.automorphisms
}

fn sorted(mut face: [u32; 3]) -> [u32; 3] {
    face.sort_unstable();
    face
}

/// A depth-first search over the images of the vertices 0, 1, 2, ... in turn.
struct Search<'a> {
    /// Each face with its vertices in order; the faces in order.
    faces: &'a [[u32; 3]],
    image: Vec<usize>,
    used: Vec<bool>,
    automorphisms: Vec<Vec<usize>>,
}

impl Search<'_> {
    fn extend(&mut self) {
        let vertex = self.image.len();
        if vertex == self.used.len() {
            self.automorphisms.push(self.image.clone());
            return;
        }
        for candidate in 0..self.used.len() {
            if self.used[candidate] {
                continue;
            }
            self.image.push(candidate);
            if self.keeps_faces_of(vertex) {
                self.used[candidate] = true;
                self.extend();
                self.used[candidate] = false;
            }
            self.image.pop();
        }
    }

    /// Whether the faces whose last vertex to get an image is `vertex` have faces for images. A
    /// permutation that passes this for every vertex maps faces to faces, and so, being one to
    /// one, faces onto faces.
    fn keeps_faces_of(&self, vertex: usize) -> bool {
        let image = |corner: u32| self.image[corner as usize] as u32;
        let mut closed = self.faces.iter().filter(|face| face[2] as usize == vertex);
        closed.all(|face| self.faces.binary_search(&sorted(face.map(image))).is_ok())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FACES;

    #[test]
    fn the_cube_has_twenty_four_that_keep_its_poles() {
        let all = automorphisms(&FACES, 8);
        assert_eq!(all.len(), 24);
        assert_eq!(all[0], [0, 1, 2, 3, 4, 5, 6, 7]);
        // A hexagonal bipyramid: the poles, of degree 6, stay or swap, and the ring turns or flips.
        let ring = [1, 3, 2, 6, 4, 5];
        for p in &all {
            assert!((p[0], p[7]) == (0, 7) || (p[0], p[7]) == (7, 0));
            let at = |vertex| ring.iter().position(|&other| other == vertex).unwrap();
            let turn = (at(p[ring[1]]) + 6 - at(p[ring[0]])) % 6;
            assert!(turn == 1 || turn == 5);
            assert!((0..6).all(|k| at(p[ring[k]]) == (at(p[ring[0]]) + k * turn) % 6));
        }
    }

    #[test]
    fn they_form_a_group() {
        let all = automorphisms(&FACES, 8);
        for p in &all {
            for q in &all {
                let composed: Vec<usize> = p.iter().map(|&image| q[image]).collect();
                assert!(all.binary_search(&composed).is_ok());
            }
        }
    }

    #[test]
    fn one_face_has_six_and_a_tetrahedron_all_permutations() {
        assert_eq!(automorphisms(&[[0, 1, 2]], 3).len(), 6);
        assert_eq!(automorphisms(&[[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 2, 3]], 4).len(), 24);
        // A path of two faces: its two tips may swap, and so may the two shared vertices.
        assert_eq!(automorphisms(&[[0, 1, 2], [1, 3, 2]], 4).len(), 4);
    }
}
