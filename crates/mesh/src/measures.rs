//! Measures of a surface: its area, its volume, and the pairs of its faces that cross.

use bokashi_core::{Scalar, Tensor, parallel};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::edges::repeats_a_vertex;
use bokashi_render_ops::glam::DVec3;

use crate::box_tree::{Bounds, BoxTree};
use crate::crossing::cross;
use crate::error::MeshError;
use crate::placed::Placed;
use crate::triangle::area_vector;

/// Faces whose crossings one thread looks for at once.
const FACES_PER_PIECE: usize = 256;

/// The area of the faces at `positions: [V, 3]`, in squared units of the positions.
///
/// # Errors
/// [`TensorError::Shape`](bokashi_core::TensorError::Shape) unless there is a position for each vertex;
/// [`TensorError::Value`](bokashi_core::TensorError::Value) for one that is not finite.
pub fn surface_area<T: Scalar>(positions: &Tensor<T>, mesh: &Mesh) -> Result<f64, MeshError> {
    let placed = Placed::new("surface_area", positions, mesh)?;
    let twice = mesh.faces().iter().map(|face| area_vector(placed.corners(*face)).length());
    Ok(0.5 * twice.sum::<f64>() * placed.unit * placed.unit)
}

/// The volume inside the faces at `positions: [V, 3]`, in cubed units of the positions. It is positive where faces are
/// counterclockwise seen from outside. Each face adds the tetrahedron between it and the middle of all positions, also
/// where the surface is not closed.
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
/// Two faces without a common vertex cross where an edge of one passes through the inside of the other. Of faces with
/// one common vertex, only the edges that face it count. Faces that share an edge never cross. A pair is returned only
/// where rounding cannot have decided. No tolerance is involved, so the result is the same at any scale.
///
/// Faces that touch do not cross: an edge may end on a face, or faces may lie in one plane. An edge that passes through
/// an edge of the other face, to within rounding, does not count either.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{Model, cube, sheet, sphere, tetrahedron, torus};

    fn crossings(model: &Model) -> Vec<[u32; 2]> {
        self_intersections(&model.positions(), &model.mesh()).unwrap()
    }

    #[test]
    fn areas_and_volumes_are_those_that_are_known() {
        for scale in [1e-100, 1e-6, 1.0, 1e6, 1e100] {
            let near = |found: f64, known: f64| assert!((found / known - 1.0).abs() < 1e-12);
            let cube = cube().moved(|p| scale * (p + 100.0));
            near(surface_area(&cube.positions(), &cube.mesh()).unwrap(), 24.0 * scale * scale);
            near(signed_volume(&cube.positions(), &cube.mesh()).unwrap(), 8.0 * scale.powi(3));
        }
        let inside_out = tetrahedron().moved(|p| -p);
        let volume = signed_volume(&inside_out.positions(), &inside_out.mesh()).unwrap();
        assert!((volume + 8.0 / 3.0).abs() < 1e-14, "{volume}");
        let ball = sphere(60);
        let volume = signed_volume(&ball.positions(), &ball.mesh()).unwrap();
        assert!((volume / (4.0 / 3.0 * std::f64::consts::PI) - 1.0).abs() < 1e-3);
        let empty = Model { points: Vec::new(), faces: Vec::new() };
        assert_eq!(surface_area(&empty.positions(), &empty.mesh()).unwrap(), 0.0);
        assert_eq!(signed_volume(&empty.positions(), &empty.mesh()).unwrap(), 0.0);
    }

    #[test]
    fn plain_surfaces_do_not_cross_themselves() {
        let models = [tetrahedron(), cube(), torus(30, 12, 0.4), sphere(9), sheet(6)];
        for model in models {
            for scale in [1e-6, 1.0, 1e6] {
                assert!(crossings(&model.clone().moved(|p| scale * p)).is_empty());
            }
            // The same surface twice touches everywhere, and crosses nowhere.
            assert!(crossings(&model.clone().and(model)).is_empty());
        }
    }

    #[test]
    fn crossings_are_those_of_all_pairs_for_any_number_of_threads() {
        let slid = |p: DVec3| p + DVec3::new(0.31, 0.2, 0.1);
        let model = torus(30, 20, 0.4).shaken(0.08, 3).and(sphere(10).moved(slid));
        let corners = |face: &[u32; 3]| face.map(|vertex| model.points[vertex as usize]);
        let mut all = Vec::new();
        for (f, one) in model.faces.iter().enumerate() {
            for (g, other) in model.faces.iter().enumerate().skip(f + 1) {
                if cross((one, &corners(one)), (other, &corners(other))) {
                    all.push([f as u32, g as u32]);
                }
            }
        }
        assert!(all.len() > 100, "{}", all.len());
        for threads in [1, 2, 5] {
            let found = parallel::with_threads(threads, || crossings(&model));
            assert_eq!(found, all);
        }
    }

    #[test]
    fn a_vertex_pushed_through_a_sheet_crosses_it() {
        let tip = Model { points: vec![DVec3::ZERO, DVec3::X, DVec3::Y], faces: vec![[0, 1, 2]] };
        let through = |z: f64| {
            let tip = tip.clone().moved(|p| DVec3::new(0.4 + 0.1 * p.y, 0.31, z + p.x + p.y));
            crossings(&sheet(1).and(tip)).len()
        };
        assert_eq!((through(-0.1), through(-1e-12), through(0.0), through(0.1)), (1, 1, 0, 0));
    }
}
