//! Numbers of a surface: its area, the volume inside, and where it crosses itself.

use bokashi_core::{Scalar, Tensor, parallel};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::glam::DVec3;

use crate::box_tree::{Bounds, BoxTree};
use crate::crossing::cross;
use crate::error::MeshError;
use crate::placed::Placed;
use crate::triangle::{area_vector, repeats_a_vertex};

/// Faces whose crossings one thread looks for at once.
const FACES_PER_PIECE: usize = 256;

/// The area of the faces at `positions: [V, 3]`, in square units of these.
///
/// # Errors
/// [`TensorError::Shape`](bokashi_core::TensorError::Shape) unless there is a position for each vertex;
/// [`TensorError::Value`](bokashi_core::TensorError::Value) for one that is not finite.
pub fn surface_area<T: Scalar>(positions: &Tensor<T>, mesh: &Mesh) -> Result<f64, MeshError> {
    let placed = Placed::new("surface_area", positions, mesh)?;
    let twice = mesh.faces().iter().map(|face| area_vector(placed.corners(*face)).length());
    Ok(0.5 * twice.sum::<f64>() * placed.unit * placed.unit)
}

/// The volume inside the faces at `positions: [V, 3]`, in cubic units of these: positive where faces are
/// counterclockwise seen from outside. It is the sum of the volumes between each face and the middle of all
/// positions, whether or not the surface is closed.
///
/// # Errors
/// As [`surface_area`].
pub fn signed_volume<T: Scalar>(positions: &Tensor<T>, mesh: &Mesh) -> Result<f64, MeshError> {
    let placed = Placed::new("signed_volume", positions, mesh)?;
    // Far from the origin the parts would be large and cancel.
    let middle = placed.points.iter().sum::<DVec3>() / placed.points.len().max(1) as f64;
    let six_times = mesh.faces().iter().map(|face| {
        let [a, b, c] = placed.corners(*face).map(|point| point - middle);
        a.dot(b.cross(c))
    });
    Ok(six_times.sum::<f64>() / 6.0 * placed.unit * placed.unit * placed.unit)
}

/// Pairs of faces that cross, the lower index first, in increasing order.
///
/// Two faces without a common vertex cross where an edge of one passes through the inside of the other. Of faces with one
/// common vertex, only the edges that face it count. Faces that share an edge never cross. What touches, to within the
/// rounding of `f64`, does not cross, and neither do faces in one plane. The rule knows no distance: it is the same at
/// any scale.
///
/// # Errors
/// As [`surface_area`].
pub fn self_intersections<T: Scalar>(
    positions: &Tensor<T>,
    mesh: &Mesh,
) -> Result<Vec<[u32; 2]>, MeshError> {
    let placed = Placed::new("self_intersections", positions, mesh)?;
    let faces = mesh.faces();
    let corners: Vec<_> = faces.iter().map(|face| placed.corners(*face)).collect();
    let bounds = faces.iter().zip(&corners).map(|(face, corners)| {
        if repeats_a_vertex(*face) { Bounds::around(&[]) } else { Bounds::around(corners) }
    });
    let bounds: Vec<_> = bounds.collect();
    let tree = BoxTree::new(&bounds);
    let work = |range: std::ops::Range<usize>| {
        let mut pairs = Vec::new();
        for f in range {
            let first = pairs.len();
            tree.for_each_near(&bounds[f], |other, _| {
                let g = other as usize;
                if g > f && cross((&faces[f], &corners[f]), (&faces[g], &corners[g])) {
                    pairs.push([f as u32, other]);
                }
            });
            pairs[first..].sort_unstable();
        }
        pairs
    };
    let mut all = Vec::new();
    parallel::merge_ranges(faces.len(), FACES_PER_PIECE, work, |pairs| all.extend(pairs));
    Ok(all)
}
