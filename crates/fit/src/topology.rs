//! The topology of a triangle mesh, for regularizers of its vertices: neighbours, edges and pairs of faces.

use std::sync::Arc;

use bokashi_core::{Scalar, SparseMatrix, Tensor, TensorError};

/// The operation in messages.
const NAME: &str = "topology";

/// Edges, neighbours and pairs of faces of a triangle mesh. Cheap to clone.
///
/// An edge is listed once, however many faces have it. An edge of exactly two faces makes a pair of them; boundaries
/// and edges of three faces and more make none. A face that names a vertex twice is in no pair, and has only edges
/// between different vertices.
#[derive(Debug, Clone)]
pub struct Topology(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    faces: Vec<[u32; 3]>,
    vertex_count: usize,
    edges: Vec<[u32; 2]>,
    neighbors: Lists,
    corners: Lists,
    pairs: Vec<FacePair>,
    pairs_of_faces: Lists,
}

/// Two faces that share an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FacePair {
    pub(crate) faces: [u32; 2],
    /// Whether they run through the edge in opposite directions, as in an oriented surface.
    pub(crate) is_oriented: bool,
}

/// Lists of numbers, one after another.
#[derive(Debug, Default)]
struct Lists {
    starts: Vec<usize>,
    entries: Vec<u32>,
}

impl Lists {
    /// The entries by the list they belong to, each list in the order in which they come.
    fn new(count: usize, entries: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut starts = vec![0; count + 1];
        entries.clone().for_each(|(list, _)| starts[list as usize + 1] += 1);
        for list in 0..count {
            starts[list + 1] += starts[list];
        }
        let mut next = starts.clone();
        let mut sorted = vec![0; starts[count]];
        for (list, entry) in entries {
            let position = &mut next[list as usize];
            sorted[*position] = entry;
            *position += 1;
        }
        Self { starts, entries: sorted }
    }

    fn range(&self, list: usize) -> std::ops::Range<usize> {
        self.starts[list]..self.starts[list + 1]
    }

    fn list(&self, list: usize) -> &[u32] {
        &self.entries[self.range(list)]
    }
}

impl Topology {
    /// The topology of `faces` over `vertex_count` vertices, of which some may have no face.
    ///
    /// # Errors
    /// [`TensorError::Index`] for an index that is not below `vertex_count`; [`TensorError::Value`] for
    /// 2^31 faces or vertices and more.
    pub fn new(faces: &[[u32; 3]], vertex_count: usize) -> Result<Self, TensorError> {
        for given in [faces.len(), vertex_count] {
            if given >= 1 << 31 {
                let rule = "fewer than 2^31 faces and vertices".into();
                return Err(TensorError::Value { operation: NAME, rule, value: given as f64 });
            }
        }
        let indices = faces.iter().flatten().map(|&index| index as usize);
        if let Some(index) = indices.clone().find(|&index| index >= vertex_count) {
            return Err(TensorError::Index { operation: NAME, index, extent: vertex_count });
        }
        // Each face's edges, sorted: equal ones lie side by side.
        let mut sides: Vec<([u32; 2], u32, bool)> = Vec::with_capacity(indices.size_hint().0);
        for (&[a, b, c], face) in faces.iter().zip(0..) {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                if from != to {
                    sides.push(([from.min(to), from.max(to)], face, from < to));
                }
            }
        }
        sides.sort_unstable();
        let (mut edges, mut pairs) = (Vec::new(), Vec::new());
        let is_proper = |face: u32| {
            let [a, b, c] = faces[face as usize];
            a != b && b != c && c != a
        };
        for same in sides.chunk_by(|left, right| left.0 == right.0) {
            edges.push(same[0].0);
            if let [(_, f, rises), (_, g, also_rises)] = *same
                && is_proper(f)
                && is_proper(g)
            {
                pairs.push(FacePair { faces: [f, g], is_oriented: rises != also_rises });
            }
        }
        let both = edges.iter().flat_map(|&[a, b]| [(a, b), (b, a)]);
        let neighbors = Lists::new(vertex_count, both);
        let corners = faces.iter().flatten().copied().zip(0..);
        let corners = Lists::new(vertex_count, corners);
        let of_faces =
            pairs.iter().zip(0..).flat_map(|(pair, index)| pair.faces.map(|f| (f, index)));
        let pairs_of_faces = Lists::new(faces.len(), of_faces);
        let faces = faces.to_vec();
        Ok(Self(Arc::new(Inner {
            faces,
            vertex_count,
            edges,
            neighbors,
            corners,
            pairs,
            pairs_of_faces,
        })))
    }

    /// The faces.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.0.faces
    }

    /// The number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.0.vertex_count
    }

    /// The edges, the lower vertex first, sorted.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.0.edges
    }

    /// The vertices that share an edge with `vertex`, in increasing order.
    ///
    /// # Panics
    /// Unless there is such a vertex.
    pub fn neighbors(&self, vertex: usize) -> &[u32] {
        self.0.neighbors.list(vertex)
    }

    /// Pairs of faces that share an edge.
    pub fn face_pairs(&self) -> impl ExactSizeIterator<Item = [u32; 2]> + '_ {
        self.0.pairs.iter().map(|pair| pair.faces)
    }

    /// The range of the neighbours of `vertex` in the list of all neighbours.
    pub(crate) fn places(&self, vertex: usize) -> std::ops::Range<usize> {
        self.0.neighbors.range(vertex)
    }

    /// The corners at `vertex`: three times the face, plus the corner's place in it.
    pub(crate) fn corners(&self, vertex: usize) -> &[u32] {
        self.0.corners.list(vertex)
    }

    pub(crate) fn pairs(&self) -> &[FacePair] {
        &self.0.pairs
    }

    /// The pairs to which `face` belongs.
    pub(crate) fn pairs_of(&self, face: usize) -> &[u32] {
        self.0.pairs_of_faces.list(face)
    }

    /// The combinatorial Laplacian `D - A`, `[V, V]`: the number of neighbours on the diagonal, and -1
    /// for each neighbour. It is symmetric and positive semi-definite; `(L v)_i = sum_j (v_i - v_j)`.
    pub fn combinatorial_laplacian<T: Scalar>(&self) -> SparseMatrix<T> {
        self.laplacian(|_, _| -T::ONE, |vertex| T::from_f64(self.neighbors(vertex).len() as f64))
    }

    /// The uniform Laplacian `I - D^-1 A`, `[V, V]`: `(L v)_i` is how far vertex i is from the mean of
    /// its neighbours, whatever their number. A vertex without neighbours has a row of 0.
    pub fn uniform_laplacian<T: Scalar>(&self) -> SparseMatrix<T> {
        let degree = |vertex: usize| self.neighbors(vertex).len() as f64;
        self.laplacian(
            |vertex, _| T::from_f64(-1.0 / degree(vertex)),
            |vertex| if degree(vertex) > 0.0 { T::ONE } else { T::ZERO },
        )
    }

    /// The cotangent Laplacian of the positions `[V, 3]`, `[V, V]`, a constant. An edge has the weight `w_ij`, half the
    /// sum of the cotangents of the angles that face it. Off the diagonal the entries are `-w_ij`, and on it the sums
    /// of weights. The matrix is symmetric and positive semi-definite.
    ///
    /// A face without an area adds nothing. Where a cotangent is above 1000, at an angle below a seventeenth of a
    /// degree, all three of the face are scaled down to that bound. The matrix stays positive semi-definite so.
    ///
    /// # Errors
    /// [`TensorError::Shape`] unless the positions are `[V, 3]` with as many vertices as the mesh;
    /// [`TensorError::Value`] for a position that is not finite.
    pub fn cotangent_laplacian<T: Scalar>(
        &self,
        positions: &Tensor<T>,
    ) -> Result<SparseMatrix<T>, TensorError> {
        let weights = self.cotangent_weights(positions)?;
        let places = |vertex: usize| self.places(vertex);
        let weight = |entry: usize| T::from_f64(-weights[entry]);
        let total = |vertex| T::from_f64(weights[places(vertex)].iter().sum());
        Ok(self.laplacian(|_, entry| weight(entry), total))
    }

    /// The cotangent weights of all neighbours, vertex by vertex ([`Topology::places`]).
    pub(crate) fn cotangent_weights<T: Scalar>(
        &self,
        positions: &Tensor<T>,
    ) -> Result<Vec<f64>, TensorError> {
        let operation = "cotangent_laplacian";
        let count = self.vertex_count();
        if **positions.shape() != [count, 3] {
            let rule = format!("positions of shape [{count}, 3]").into();
            let shape = positions.shape().clone();
            return Err(TensorError::Shape { operation, rule, shape });
        }
        if let Some(lost) = positions.data().iter().find(|x| !x.is_finite()) {
            let (rule, value) = ("finite positions".into(), lost.to_f64());
            return Err(TensorError::Value { operation, rule, value });
        }
        let rows = positions.data().as_chunks::<3>().0;
        let position = |vertex: u32| rows[vertex as usize].map(Scalar::to_f64);
        let cotangents: Vec<_> =
            self.faces().iter().map(|face| cotangents(face.map(position))).collect();
        let mut weights = vec![0.0; self.0.neighbors.entries.len()];
        for vertex in 0..count {
            let (neighbors, first) = (self.neighbors(vertex), self.places(vertex).start);
            for &corner in self.corners(vertex) {
                let (face, k) = (corner as usize / 3, corner as usize % 3);
                for (other, facing) in [((k + 1) % 3, (k + 2) % 3), ((k + 2) % 3, (k + 1) % 3)] {
                    // A face that names a vertex twice has no area, and no part in it.
                    if let Ok(index) = neighbors.binary_search(&self.faces()[face][other]) {
                        weights[first + index] += 0.5 * cotangents[face][facing];
                    }
                }
            }
        }
        // Both ends of an edge add the same numbers, in the order of the faces.
        Ok(weights)
    }

    /// The matrix of `off(vertex, entry)` for each neighbour and of `diagonal(vertex)` on the diagonal.
    fn laplacian<T: Scalar>(
        &self,
        off: impl Fn(usize, usize) -> T,
        diagonal: impl Fn(usize) -> T,
    ) -> SparseMatrix<T> {
        let count = self.vertex_count();
        let (mut triplets, neighbors) = (Vec::new(), &self.0.neighbors);
        for vertex in 0..count {
            let row = vertex as u32;
            triplets.push((row, row, diagonal(vertex)));
            for entry in self.places(vertex) {
                triplets.push((row, neighbors.entries[entry], off(vertex, entry)));
            }
        }
        SparseMatrix::new(count, count, triplets).expect("all neighbours are vertices")
    }
}

/// The largest cotangent that counts.
const MOST: f64 = 1e3;

/// The cotangents of a triangle's angles; zeros where it has no area.
fn cotangents(corners: [[f64; 3]; 3]) -> [f64; 3] {
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let mut sides = [0, 1, 2].map(|k| minus(corners[(k + 2) % 3], corners[(k + 1) % 3]));
    // Angles know no scale: neither squares nor products leave the range of the numbers.
    let size = sides.iter().flatten().fold(0.0, |size: f64, x| size.max(x.abs()));
    if !(size > 0.0 && size.is_finite()) {
        return [0.0; 3];
    }
    sides.iter_mut().flatten().for_each(|x| *x /= size);
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let [a, b, _] = sides;
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let area = dot(cross, cross).sqrt();
    if area <= 8.0 * f64::EPSILON * (dot(a, a) * dot(b, b)).sqrt() {
        return [0.0; 3];
    }
    let cotangents = [0, 1, 2].map(|k| -dot(sides[(k + 1) % 3], sides[(k + 2) % 3]) / area);
    let largest = cotangents.iter().fold(0.0, |largest: f64, cot| largest.max(cot.abs()));
    cotangents.map(|cot| if largest > MOST { cot * (MOST / largest) } else { cot })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of two faces with a vertex in the middle of nowhere.
    fn square() -> Topology {
        Topology::new(&[[0, 1, 2], [0, 2, 3]], 5).unwrap()
    }

    fn dense(matrix: &SparseMatrix<f64>) -> Vec<Vec<f64>> {
        let mut dense = vec![vec![0.0; matrix.columns()]; matrix.rows()];
        matrix.triplets().for_each(|(i, j, x)| dense[i as usize][j as usize] = x);
        dense
    }

    #[test]
    fn edges_neighbours_and_pairs_are_those_of_the_faces() {
        let topology = square();
        assert_eq!(topology.edges(), [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]);
        let neighbors: Vec<_> = (0..5).map(|v| topology.neighbors(v)).collect();
        assert_eq!(neighbors, [&[1, 2, 3][..], &[0, 2], &[0, 1, 3], &[0, 2], &[]]);
        assert_eq!(topology.pairs(), [FacePair { faces: [0, 1], is_oriented: true }]);
        assert_eq!((topology.pairs_of(0), topology.pairs_of(1)), (&[0][..], &[0][..]));
        assert_eq!((topology.corners(0), topology.corners(4)), (&[0, 3][..], &[][..]));
        // Wound the other way; three faces at an edge; a vertex named twice.
        let flipped = Topology::new(&[[0, 1, 2], [0, 3, 2]], 4).unwrap();
        assert_eq!(flipped.pairs(), [FacePair { faces: [0, 1], is_oriented: false }]);
        let crowded = Topology::new(&[[0, 1, 2], [0, 2, 3], [2, 0, 4]], 5).unwrap();
        assert_eq!((crowded.face_pairs().len(), crowded.edges().len()), (0, 7));
        let twice = Topology::new(&[[0, 1, 1], [1, 0, 2], [3, 3, 3]], 4).unwrap();
        assert_eq!(twice.edges(), [[0, 1], [0, 2], [1, 2]]);
        assert_eq!(twice.face_pairs().len(), 0);
    }

    #[test]
    fn laplacians_are_those_worked_out_by_hand() {
        let combinatorial = dense(&square().combinatorial_laplacian());
        assert_eq!(combinatorial[0], [3.0, -1.0, -1.0, -1.0, 0.0]);
        assert_eq!(combinatorial[1], [-1.0, 2.0, -1.0, 0.0, 0.0]);
        assert_eq!(combinatorial[4], [0.0; 5]);
        let uniform = dense(&square().uniform_laplacian());
        assert_eq!(uniform[1], [-0.5, 1.0, -0.5, 0.0, 0.0]);
        assert_eq!(uniform[4], [0.0; 5]);
        // A unit square: the angles at the sides are 45 degrees, those at the diagonal right ones.
        let positions =
            [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [9.0; 3]];
        for scale in [1e-300, 1.0, 1e200] {
            let positions = Tensor::from_flat_fn([5, 3], |k| scale * positions[k / 3][k % 3]);
            let cotangent = dense(&square().cotangent_laplacian(&positions).unwrap());
            let expected = [
                [1.0, -0.5, 0.0, -0.5, 0.0],
                [-0.5, 1.0, -0.5, 0.0, 0.0],
                [0.0, -0.5, 1.0, -0.5, 0.0],
                [-0.5, 0.0, -0.5, 1.0, 0.0],
                [0.0; 5],
            ];
            for (found, expected) in cotangent.iter().flatten().zip(expected.iter().flatten()) {
                approx::assert_relative_eq!(found, expected, epsilon = 1e-15);
            }
        }
    }

    #[test]
    fn a_cotangent_laplacian_is_semi_definite_and_takes_linear_functions_to_zero() {
        // A fan around vertex 0, in a plane, with needles and caps.
        let angles = [0.0, 1e-9, 0.1, 1.0, 2.8, 2.9, 4.5, 6.0];
        let rim = angles.map(|angle: f64| [angle.cos(), angle.sin(), 0.0]);
        let rows: Vec<_> = [[0.0; 3]].into_iter().chain(rim).collect();
        let faces: Vec<_> = (1..9).map(|k| [0, k, k % 8 + 1]).collect();
        let topology = Topology::new(&faces, 9).unwrap();
        let positions = Tensor::from_flat_fn([9, 3], |k| rows[k / 3][k % 3]);
        let matrix = topology.cotangent_laplacian(&positions).unwrap();
        let dense = dense(&matrix);
        let energy = |x: &[f64]| -> f64 {
            (0..9).map(|i| (0..9).map(|j| x[i] * dense[i][j] * x[j]).sum::<f64>()).sum()
        };
        for seed in 0..200 {
            let x: Vec<_> = (0..9).map(|k| ((k * 37 + seed * 91) % 101) as f64 - 50.0).collect();
            assert!(energy(&x) > -1e-8, "{seed} {}", energy(&x));
        }
        for i in 0..9 {
            assert!(dense[i].iter().all(|w| w.abs() <= 8.0 * MOST));
            assert!((0..9).all(|j| dense[i][j] == dense[j][i]), "{i}");
        }
        // Without the needle, linear precision is exact at the inner vertex.
        let faces: Vec<_> = [2, 3, 4, 5, 6, 7, 8].windows(2).map(|w| [0, w[0], w[1]]).collect();
        let faces = [&faces[..], &[[0, 8, 2]]].concat();
        let topology = Topology::new(&faces, 9).unwrap();
        let (row, weights) = {
            let matrix = topology.cotangent_laplacian(&positions).unwrap();
            (matrix.row(0).0.to_vec(), matrix.row(0).1.to_vec())
        };
        for axis in 0..2 {
            let sum: f64 = row.iter().zip(&weights).map(|(&j, w)| w * rows[j as usize][axis]).sum();
            assert!(sum.abs() < 1e-12, "{sum}");
        }
    }

    #[test]
    fn faces_without_an_area_have_no_weight() {
        let topology = Topology::new(&[[0, 1, 2], [0, 0, 1], [1, 2, 3]], 4).unwrap();
        let positions = [[0.0; 3], [1.0; 3], [2.0; 3], [2.0; 3]];
        let positions = Tensor::from_flat_fn([4, 3], |k| positions[k / 3][k % 3]);
        let matrix = topology.cotangent_laplacian(&positions).unwrap();
        assert!(matrix.triplets().all(|(.., weight)| weight == 0.0));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let said = |error: TensorError| error.to_string();
        let error = Topology::new(&[[0, 1, 2], [1, 4, 2]], 4).unwrap_err();
        assert_eq!(said(error), "topology needs indices within an axis of extent 4, got 4");
        let error = Topology::new(&[], 1 << 31).unwrap_err();
        let message = "topology needs fewer than 2^31 faces and vertices, got 2147483648";
        assert_eq!(said(error), message);
        let error = square().cotangent_laplacian(&Tensor::<f64>::zeros([4, 3])).unwrap_err();
        let message = "cotangent_laplacian needs positions of shape [5, 3], got shape [4, 3]";
        assert_eq!(said(error), message);
        let error = square().cotangent_laplacian(&Tensor::full([5, 3], f32::NAN)).unwrap_err();
        assert_eq!(said(error), "cotangent_laplacian needs finite positions, got NaN");
        let empty = Topology::new(&[], 0).unwrap();
        assert_eq!(empty.uniform_laplacian::<f32>().entries(), 0);
    }
}
