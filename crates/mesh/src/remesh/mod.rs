//! Remeshing: splits, collapses and flips of edges until they have about their target lengths.
//!
//! # Method
//! Each iteration splits edges longer than 4/3 of their target, and collapses those shorter than 4/5. It flips edges
//! toward six at each vertex, or four at a boundary, and moves vertices along the surface. Every vertex is a point of
//! the old surface: a face and barycentric coordinates. A walk over the old faces finds the point for a vertex that is
//! made or moved.
//!
//! # What is kept
//! - The Euler characteristic and the parts; closed surfaces stay closed. (A collapse meets the link condition, and a
//!   flip makes no edge that exists.)
//! - Boundaries. Their vertices never leave them, and vanish only where a boundary bends by less than 30 degrees.
//!   Vertices that lie at one place, as at a texture seam, are boundaries: the two sides may part. Join them first.
//! - Seams of the [`Mesh`]: they are split, but neither collapsed nor flipped, and their vertices stay.
//! - Edges of three faces and more, and of two that run through them in one direction.
//! - Vertices at which faces meet that share no edge, and vertices without a face.
//! - Faces that name a vertex twice.
//! - The fronts of faces: no change turns a normal by more than 45 degrees, or makes a sliver of better faces.
//! - With [`keeps_apart`](RemeshOptions::keeps_apart) no change lets more faces cross than before.
//!
//! One thread changes one edge after another, in the order of lengths and indices. Edges shorter than a quarter of
//! their target are collapsed in the order of powers of two of their lengths.
//!
//! # Source
//! Botsch and Kobbelt, *A Remeshing Approach to Multiresolution Modeling*, SGP 2004; lengths per vertex as in
//! Palfinger, *Continuous remeshing for inverse rendering*, Computer Animation and Virtual Worlds 2022.

mod changing;
mod collapse;
mod flip;
mod guard;
mod options;
mod relax;
mod split;
mod surface;
#[cfg(test)]
mod tests;

use bokashi_core::{Scalar, SparseMatrix, Tensor};
use bokashi_render_ops::Mesh;

use crate::derived_mesh::{DerivedMesh, kept_part};
use crate::error::MeshError;
use crate::placed::Placed;
use changing::{Changing, NONE};
pub use options::{EdgeLengths, RemeshOptions};
use surface::Site;

/// Remeshes the faces of `mesh` at `positions: [V, 3]`.
///
/// New vertices are points of the old surface, so each row of the weights has at most three entries. Vertices and
/// faces that are kept have their order, and new ones follow. 20,000 faces take about a tenth of a second.
///
/// ```
/// use bokashi_core::Tensor;
/// use bokashi_mesh::{RemeshOptions, remesh};
/// use bokashi_render_ops::Mesh;
///
/// // A square of two faces, and a brightness at each corner.
/// let mesh = Mesh::new(vec![[0, 1, 2], [0, 2, 3]], 4)?;
/// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
/// let fine = remesh(&Tensor::<f32>::from(corners), &mesh, &RemeshOptions::uniform(0.1))?;
/// assert!(fine.mesh.faces().len() > 100);
///
/// let brightness = fine.carry(&Tensor::<f32>::from([0.0, 1.0, 1.0, 0.0]))?;
/// for vertex in 0..fine.mesh.vertex_count() {
///     // It is that of the old square: it grows with x.
///     assert!((brightness[[vertex]] - fine.positions[[vertex, 0]]).abs() < 1e-6);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`TensorError::Shape`](bokashi_core::TensorError::Shape) unless there is a position for each vertex;
/// [`TensorError::Value`](bokashi_core::TensorError::Value) for positions that are not finite, lengths that are not
/// positive numbers, and another number of lengths than of vertices.
pub fn remesh<T: Scalar>(
    positions: &Tensor<T>,
    mesh: &Mesh,
    options: &RemeshOptions,
) -> Result<DerivedMesh<T>, MeshError> {
    let placed = Placed::new("remesh", positions, mesh)?;
    let lengths = options.lengths_of(mesh.vertex_count(), placed.unit)?;
    let mut changing = Changing::new(mesh, &placed.points, lengths);
    for _ in 0..options.iterations {
        if options.keeps_apart {
            changing.plant();
        }
        changing.split_long_edges(options.most_faces);
        changing.collapse_short_edges();
        if options.keeps_apart {
            changing.plant();
        }
        changing.flip_edges();
        if options.moves_vertices {
            changing.relax();
        }
    }
    changing.finish(positions)
}

impl Changing<'_> {
    /// The mesh without the faces and vertices that were removed.
    fn finish<T: Scalar>(&self, positions: &Tensor<T>) -> Result<DerivedMesh<T>, MeshError> {
        let old_count = positions.shape()[0];
        // A vertex without a proper face was there before, or has vanished.
        let stays = |v: usize| self.sites[v] == Site::NOWHERE || !self.around[v].is_empty();
        let is_left = |face: &&[u32; 3]| face[0] != NONE;
        let left: Vec<_> = self.faces.iter().filter(is_left).copied().collect();
        let (kept, faces) = kept_part(self.points.len(), stays, left.iter().copied());
        let mut triplets = Vec::new();
        for (row, &kept) in (0..).zip(&kept) {
            match self.sites[kept as usize] {
                Site::NOWHERE => triplets.push((row, kept, 1.0)),
                site => {
                    let weights = self.surface.weights(site).into_iter().filter(|it| it.1 != 0.0);
                    triplets.extend(weights.map(|(vertex, weight)| (row, vertex, weight)));
                }
            }
        }
        let mut mesh = Mesh::new(faces, kept.len())?;
        let is_seam = |face: usize, corner: usize| {
            let [a, b] = [1, 2].map(|step| left[face][(corner + step) % 3]);
            self.is_seam(a, b)
        };
        if (0..left.len()).any(|face| (0..3).any(|corner| is_seam(face, corner))) {
            mesh = mesh.with_seams(is_seam);
        }
        let weights = SparseMatrix::new(kept.len(), old_count, triplets)?;
        DerivedMesh::new(positions, mesh, weights)
    }
}
