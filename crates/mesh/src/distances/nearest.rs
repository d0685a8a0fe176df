//! The nearest points of a cloud, and on a surface.

use bokashi_core::parallel::write_each;
use bokashi_core::{Scalar, Tensor, TensorError};
use bokashi_render_ops::Mesh;

use super::surface_points::SurfacePoints;
use crate::box_tree::{Bounds, BoxTree};
use crate::error::MeshError;
use crate::placed::{balance, points, vertices};
use crate::triangle;

/// Queries in one piece of work.
const PER_PIECE: usize = 1 << 8;

/// The nearest point to each query, by its index, and its distance.
#[derive(Debug, Clone, PartialEq)]
pub struct NearestPoints {
    /// The index of the nearest point; of several at one distance the lowest.
    pub indices: Vec<u32>,
    /// The distance to the nearest point.
    pub distances: Vec<f64>,
}

/// Finds for each of `queries: [n, 3]` the nearest of `points: [m, 3]`, in a tree of boxes.
///
/// Squared distances are compared in `f64`. Coordinates are scaled first, so points of any size are told apart.
///
/// # Errors
/// `TensorError::Shape` unless the shapes are these, and m is at least 1; `TensorError::Value` for a number that is
/// not finite.
pub fn nearest_points<T: Scalar>(
    queries: &Tensor<T>,
    points: &Tensor<T>,
) -> Result<NearestPoints, MeshError> {
    nearest_of(NAME, queries, points)
}

const NAME: &str = "nearest_points";

/// [`nearest_points`], for the operation of that name.
pub(super) fn nearest_of<T: Scalar>(
    operation: &'static str,
    queries: &Tensor<T>,
    from: &Tensor<T>,
) -> Result<NearestPoints, MeshError> {
    let mut queries = points(operation, queries, "points")?;
    let shape = from.shape();
    let mut from = points(operation, from, "points")?;
    if from.is_empty() {
        let rule = "points of shape [n, 3] with n from 1 up".into();
        return Err(TensorError::Shape { operation, rule, shape: shape.clone() }.into());
    }
    let unit = balance([&mut queries, &mut from]);
    let bounds: Vec<_> = from.iter().map(|&point| Bounds::around(&[point])).collect();
    let tree = BoxTree::new(&bounds);
    let mut found = vec![(0, 0.0); queries.len()];
    write_each(&mut found, PER_PIECE, |k| {
        tree.nearest(queries[k], |point| queries[k].distance_squared(from[point as usize]))
    });
    let distances = found.iter().map(|(_, square)| unit * square.sqrt()).collect();
    Ok(NearestPoints { indices: found.into_iter().map(|(index, _)| index).collect(), distances })
}

/// Finds for each of `queries: [n, 3]` the nearest point on the surface of `mesh` with vertices `positions: [V, 3]`,
/// and its distance. Of faces at one distance the one with the lowest index is taken. Faces without an area count as
/// the edges or points that they are.
///
/// # Errors
/// `TensorError::Shape` unless the shapes are these; `TensorError::Value` for a number that is not finite;
/// [`MeshError::NoFaces`] for a mesh without faces.
pub fn nearest_on_surface<T: Scalar>(
    queries: &Tensor<T>,
    positions: &Tensor<T>,
    mesh: &Mesh,
) -> Result<(SurfacePoints<T>, Vec<f64>), MeshError> {
    const NAME: &str = "nearest_on_surface";
    let mut queries = points(NAME, queries, "queries")?;
    let mut at = vertices(NAME, positions, mesh)?;
    let unit = balance([&mut queries, &mut at]);
    if mesh.faces().is_empty() {
        return Err(MeshError::NoFaces { operation: NAME });
    }
    let corners = |face: u32| mesh.faces()[face as usize].map(|vertex| at[vertex as usize]);
    let bounds: Vec<_> =
        (0..mesh.faces().len() as u32).map(|face| Bounds::around(&corners(face))).collect();
    let tree = BoxTree::new(&bounds);
    let mut found = vec![(0, [0.0; 3], 0.0); queries.len()];
    write_each(&mut found, PER_PIECE, |k| {
        let (face, _) =
            tree.nearest(queries[k], |face| triangle::nearest(corners(face), queries[k]).1);
        let (weights, square) = triangle::nearest(corners(face), queries[k]);
        (face, weights, unit * square.sqrt())
    });
    let distances = found.iter().map(|&(.., distance)| distance).collect();
    let (faces, weights) = found.into_iter().map(|(face, weights, _)| (face, weights)).unzip();
    Ok((SurfacePoints::new(faces, weights, mesh)?, distances))
}
