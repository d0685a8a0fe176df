//! Points that keep their faces and barycentrics, and so move along with a surface.

use std::sync::Arc;

use bokashi_core::mixing::{GOLDEN, mixed};
use bokashi_core::{Scalar, SparseMatrix, Tensor, TensorError, Var};
use bokashi_render_ops::Mesh;

use crate::error::MeshError;
use crate::placed::Placed;
use crate::triangle::area_vector;

/// Points on the faces of a mesh, each with the face on which it lies and its barycentrics there.
///
/// A sparse matrix makes values at the points of values at the vertices: positions, colours, normals.
#[derive(Debug, Clone)]
pub struct SurfacePoints<T: Scalar> {
    faces: Arc<[u32]>,
    barycentrics: Vec<[f64; 3]>,
    matrix: SparseMatrix<T>,
}

impl<T: Scalar> SurfacePoints<T> {
    /// Makes points of faces of `mesh` and barycentrics there.
    pub(super) fn new(
        faces: Vec<u32>,
        barycentrics: Vec<[f64; 3]>,
        mesh: &Mesh,
    ) -> Result<Self, TensorError> {
        let corners = faces.iter().map(|&face| mesh.faces()[face as usize]);
        let entries =
            (0..).zip(corners.zip(&barycentrics)).flat_map(|(row, (corners, weights))| {
                [0, 1, 2].map(|k| (row, corners[k], T::from_f64(weights[k])))
            });
        let matrix = SparseMatrix::new(faces.len(), mesh.vertex_count(), entries)?;
        Ok(Self { faces: faces.into(), barycentrics, matrix })
    }

    /// How many points there are.
    pub fn count(&self) -> usize {
        self.faces.len()
    }

    /// The face of each point.
    pub fn faces(&self) -> &Arc<[u32]> {
        &self.faces
    }

    /// The weights of the corners of each point's face.
    pub fn barycentrics(&self) -> &[[f64; 3]] {
        &self.barycentrics
    }

    /// The weights of the vertices at each point, `[n, V]`.
    pub fn weights(&self) -> &SparseMatrix<T> {
        &self.matrix
    }

    /// Interpolates values at the vertices, `[V, C]`, at the points: `[n, C]`. Positions of vertices give the points
    /// themselves. The result is differentiable with respect to the values.
    ///
    /// # Errors
    /// `TensorError::Shape` unless there is a row for each vertex of the mesh.
    pub fn interpolate<'t>(&self, attributes: Var<'t, T>) -> Result<Var<'t, T>, TensorError> {
        self.matrix.product(attributes)
    }

    /// [`Self::interpolate`] without a tape.
    ///
    /// # Errors
    /// As [`Self::interpolate`].
    pub fn interpolated(&self, attributes: &Tensor<T>) -> Result<Tensor<T>, TensorError> {
        let tape = bokashi_core::Tape::new();
        Ok(self.interpolate(tape.constant(attributes))?.value())
    }
}

/// Draws `count` points on the surface of `mesh` with vertices `positions: [V, 3]`, uniformly by area.
///
/// The draw is stratified: point k lies in the k-th of `count` equal shares of the area, in the order of the faces. The
/// same seed gives the same points on every machine.
///
/// # Errors
/// `TensorError::Shape` unless the positions are `[V, 3]`; `TensorError::Value` for one that is not finite;
/// [`MeshError::NoArea`] where the surface has no area; `TensorError::Value` for 2^31 points and more.
pub fn draw_points<T: Scalar>(
    positions: &Tensor<T>,
    mesh: &Mesh,
    count: usize,
    seed: u64,
) -> Result<SurfacePoints<T>, MeshError> {
    if count >= 1 << 31 {
        let (rule, value) = ("fewer than 2^31 points".into(), count as f64);
        return Err(TensorError::Value { operation: "draw_points", rule, value }.into());
    }
    let placed = Placed::new("draw_points", positions, mesh)?;
    let mut total = 0.0;
    let below = mesh.faces().iter().map(|&face| {
        total += area_vector(placed.corners(face)).length();
        total
    });
    let below: Vec<f64> = below.collect();
    if total <= 0.0 {
        return Err(MeshError::NoArea { operation: "draw_points", faces: mesh.faces().len() });
    }
    let mut random = Random { state: seed };
    let draw = |k: usize| {
        let share = (k as f64 + random.uniform()) / count as f64 * total;
        // The first face up to which there is more area; the last one with an area, where rounding leads to the end.
        let face = below.partition_point(|&area| area <= share);
        let last = || below.partition_point(|&area| area < total);
        let face = if face < below.len() { face } else { last() };
        let (root, along) = (random.uniform().sqrt(), random.uniform());
        (face as u32, [1.0 - root, root * (1.0 - along), root * along])
    };
    let (faces, barycentrics) = (0..count).map(draw).unzip();
    Ok(SurfacePoints::new(faces, barycentrics, mesh)?)
}

/// The generator SplitMix64.
struct Random {
    state: u64,
}

impl Random {
    /// A number from 0 up, below 1.
    fn uniform(&mut self) -> f64 {
        self.state = self.state.wrapping_add(GOLDEN);
        (mixed(self.state) >> 11) as f64 / (1_u64 << 53) as f64
    }
}
