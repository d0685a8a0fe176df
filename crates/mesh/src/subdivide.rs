//! Subdivision: each face becomes four.
//!
//! # Formulas
//! A new vertex lies on each edge (i, j): at the midpoint, or by Loop's rule. This puts it at
//! `3/8 (x_i + x_j) + 1/8 (x_k + x_l)`, with the corners k and l across. Loop also moves an old vertex with n
//! neighbours, to `(1 - n b) x + b (sum of neighbours)`. Here `b = (5/8 - (3/8 + cos(2 pi / n) / 4)^2) / n`. At a
//! boundary the rules are those of a cubic spline: midpoints, and `3/4 x + 1/8 (x_before + x_after)`. An edge of
//! three faces counts as a boundary. A vertex at other than two of such edges stays.
//!
//! # Backward
//! The map is linear, with constant weights: a product with a sparse matrix.
//!
//! # Source
//! Loop, *Smooth Subdivision Surfaces Based on Triangles*, 1987; the boundary as in Hoppe et al., *Piecewise Smooth
//! Surface Reconstruction*, SIGGRAPH 1994.

use bokashi_core::{Scalar, SparseMatrix, Tensor};
use bokashi_render_ops::Mesh;
use bokashi_render_ops::edges::{Side, edges, repeats_a_vertex, sides};

use crate::derived_mesh::DerivedMesh;
use crate::error::MeshError;
use crate::placed::check_positions;
use crate::rings::Rings;

/// A rule that places the vertices of a subdivided mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subdivision {
    /// Old vertices stay, and new ones lie at the middle of edges: the surface is the same.
    Midpoint,
    /// Loop's weights place old and new vertices: the surface becomes smooth.
    Loop,
}

/// Divides each face of `mesh` at `positions: [V, 3]` into four.
///
/// The old vertices come first, then one for each edge, in the order of the edges' vertices. Face f becomes the faces
/// 4 f to 4 f + 3; a face that names a vertex twice stays one. Seams stay seams.
///
/// The weights make it differentiable:
///
/// ```
/// use bokashi_core::{Tape, Tensor};
/// use bokashi_mesh::{Subdivision, subdivide};
/// use bokashi_render_ops::Mesh;
///
/// let mesh = Mesh::new(vec![[0, 1, 2]], 3)?;
/// let corners = Tensor::from([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]);
/// let fine = subdivide(&corners, &mesh, Subdivision::Midpoint)?;
/// assert_eq!(fine.mesh.faces().len(), 4);
///
/// let tape = Tape::new();
/// let x = tape.leaf(&corners);
/// let positions = fine.weights.product(x)?;
/// assert_eq!(positions.value(), fine.positions);
/// // Each corner has a weight of 1 at itself, and of 1/2 at two middles.
/// let gradients = positions.sum().backward()?;
/// assert_eq!(gradients.get_or_zeros(x), Tensor::full([3, 3], 2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`TensorError::Shape`](bokashi_core::TensorError::Shape) unless there is a position for each vertex;
/// [`TensorError::Value`](bokashi_core::TensorError::Value) for one that is not finite;
/// [`RenderError::MeshSize`](bokashi_render_ops::RenderError::MeshSize) where there would be 2^31 faces or vertices.
pub fn subdivide<T: Scalar>(
    positions: &Tensor<T>,
    mesh: &Mesh,
    scheme: Subdivision,
) -> Result<DerivedMesh<T>, MeshError> {
    check_positions("subdivide", positions, mesh)?;
    let sides = sides(mesh.faces());
    let new_mesh = divided(mesh, &sides)?;
    let triplets = match scheme {
        Subdivision::Midpoint => midpoint_weights(mesh, &sides),
        Subdivision::Loop => loop_weights(mesh, &sides),
    };
    let weights = SparseMatrix::new(new_mesh.vertex_count(), mesh.vertex_count(), triplets)?;
    DerivedMesh::new(positions, new_mesh, weights)
}

/// The faces.
fn divided(mesh: &Mesh, sides: &[Side]) -> Result<Mesh, MeshError> {
    let old = mesh.faces();
    // Of each face the vertices in the middle of the edges that face its corners.
    let mut middles = vec![[0; 3]; old.len()];
    let mut count = mesh.vertex_count() as u64;
    for edge in edges(sides) {
        for side in edge {
            middles[side.face as usize][usize::from(side.corner)] = count as u32;
        }
        count += 1;
    }
    let mut faces = Vec::with_capacity(4 * old.len());
    // The old face, and which corner of it the new one has, if it has just one.
    let mut origins: Vec<(usize, usize)> = Vec::with_capacity(4 * old.len());
    const WHOLE: usize = 3;
    const INNER: usize = 4;
    for (index, &[a, b, c]) in old.iter().enumerate() {
        if repeats_a_vertex([a, b, c]) {
            faces.push([a, b, c]);
            origins.push((index, WHOLE));
            continue;
        }
        let [bc, ca, ab] = middles[index];
        faces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        origins.extend([0, 1, 2, INNER].map(|corner| (index, corner)));
    }
    let divided = Mesh::new(faces, usize::try_from(count).unwrap_or(usize::MAX))?;
    if !(0..old.len()).any(|face| (0..3).any(|corner| mesh.is_seam(face, corner))) {
        return Ok(divided);
    }
    Ok(divided.with_seams(|face, corner| {
        let (old, own) = origins[face];
        own != INNER && own != corner && mesh.is_seam(old, corner)
    }))
}

type Triplets = Vec<(u32, u32, f64)>;

fn midpoint_weights(mesh: &Mesh, sides: &[Side]) -> Triplets {
    let kept = (0..mesh.vertex_count() as u32).map(|vertex| (vertex, vertex, 1.0));
    let middles = edges(sides).zip(mesh.vertex_count() as u32..);
    kept.chain(middles.flat_map(|(edge, row)| edge[0].ends.map(|end| (row, end, 0.5)))).collect()
}

fn loop_weights(mesh: &Mesh, sides: &[Side]) -> Triplets {
    let rings = Rings::new(mesh, sides);
    let mut triplets = Vec::new();
    for vertex in 0..mesh.vertex_count() {
        let (row, neighbors) = (vertex as u32, rings.neighbors(vertex));
        let n = neighbors.len() as f64;
        let share = if neighbors.is_empty() {
            0.0
        } else if rings.is_boundary(vertex) {
            0.125
        } else {
            let middle = 0.375 + 0.25 * (std::f64::consts::TAU / n).cos();
            (0.625 - middle * middle) / n
        };
        triplets.push((row, row, 1.0 - n * share));
        triplets.extend(neighbors.iter().map(|neighbor| (row, *neighbor, share)));
    }
    for (edge, row) in edges(sides).zip(mesh.vertex_count() as u32..) {
        let is_inner = edge.len() == 2;
        let share = if is_inner { 0.375 } else { 0.5 };
        triplets.extend(edge[0].ends.map(|end| (row, end, share)));
        if is_inner {
            let across = |side: &Side| mesh.faces()[side.face as usize][usize::from(side.corner)];
            triplets.extend(edge.iter().map(|side| (row, across(side), 0.125)));
        }
    }
    triplets
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::connectivity::Connectivity;
    use crate::fixtures::{Model, cube, sheet, sphere, tetrahedron, torus};
    use crate::measures::{signed_volume, surface_area};

    fn divided(model: &Model, scheme: Subdivision) -> DerivedMesh<f64> {
        subdivide(&model.positions(), &model.mesh(), scheme).unwrap()
    }

    #[test]
    fn what_hangs_together_stays_so_and_weights_sum_to_one() {
        let crowded = Model { faces: vec![[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 2, 3]], ..sheet(2) };
        let models = [tetrahedron(), cube(), torus(5, 4, 0.3), sheet(3), crowded];
        for model in models {
            for scheme in [Subdivision::Midpoint, Subdivision::Loop] {
                let fine = divided(&model, scheme);
                let [old, new] = [&model.mesh(), &fine.mesh].map(Connectivity::new);
                assert_eq!(old.euler_characteristic(), new.euler_characteristic());
                assert_eq!((old.parts(), old.boundary_loops), (new.parts(), new.boundary_loops));
                assert_eq!((4 * old.faces, old.is_oriented), (new.faces, new.is_oriented));
                assert_eq!(2 * old.crowded_edges, new.crowded_edges);
                for row in 0..fine.weights.rows() {
                    let sum: f64 = fine.weights.row(row).1.iter().sum();
                    assert!((sum - 1.0).abs() < 1e-15, "{sum}");
                }
            }
        }
    }

    #[test]
    fn midpoints_keep_the_surface_and_loop_keeps_flat_sheets_flat() {
        for model in [tetrahedron(), torus(5, 4, 0.3), sheet(2)] {
            let fine = divided(&model, Subdivision::Midpoint);
            let area = surface_area(&model.positions(), &model.mesh()).unwrap();
            let new = surface_area(&fine.positions, &fine.mesh).unwrap();
            assert!((new / area - 1.0).abs() < 1e-14);
        }
        // A straight boundary keeps a sheet's outline but for its corners.
        let fine = divided(&sheet(8), Subdivision::Loop);
        let area = surface_area(&fine.positions, &fine.mesh).unwrap();
        assert!(area < 1.0 && area > 1.0 - 4.0 / 64.0 / 8.0, "{area}");
        assert!(fine.positions.data().as_chunks::<3>().0.iter().all(|row| row[2] == 0.0));
    }

    #[test]
    fn loop_gives_an_octahedron_the_limits_volume() {
        // The limit of a vertex with n neighbours is their mean with the weights 3 / (8 b) for itself, 1 each.
        let mut model = sphere(1);
        let b: f64 = (0.625 - 0.375 * 0.375) / 4.0;
        let limit = 0.375 / b / (0.375 / b + 4.0);
        for _ in 0..5 {
            let fine = divided(&model, Subdivision::Loop);
            let points = fine.positions.data().as_chunks::<3>().0;
            model = Model {
                points: points.iter().map(|row| (*row).into()).collect(),
                faces: fine.mesh.faces().to_vec(),
            };
        }
        // Its first vertex is on an axis.
        let height = model.points[0].length();
        assert!((height - limit).abs() < 1e-3, "{height} {limit}");
        assert!(signed_volume(&model.positions(), &model.mesh()).unwrap() > 0.0);
    }

    #[test]
    fn seams_are_divided_and_an_empty_mesh_stays_empty() {
        let sheet = sheet(2);
        let mesh = sheet.mesh().with_seams(|face, corner| (face, corner) == (0, 1));
        let fine = subdivide(&sheet.positions(), &mesh, Subdivision::Loop).unwrap();
        let seams = |mesh: &Mesh| {
            let of = |face| (0..3).filter(move |corner| mesh.is_seam(face, *corner)).count();
            (0..mesh.faces().len()).map(of).sum::<usize>()
        };
        // From both sides.
        assert_eq!((seams(&mesh), seams(&fine.mesh)), (2, 4));
        let empty = Mesh::new(Vec::new(), 0).unwrap();
        let fine = subdivide(&Tensor::<f32>::zeros([0, 3]), &empty, Subdivision::Loop).unwrap();
        assert_eq!((fine.mesh.vertex_count(), fine.mesh.faces().len()), (0, 0));
    }

    #[test]
    fn what_is_no_position_is_refused() {
        let mesh = sheet(2).mesh();
        let said = |positions: &Tensor<f64>| {
            let refused = subdivide(positions, &mesh, Subdivision::Midpoint);
            refused.map(drop).unwrap_err().to_string()
        };
        for shape in [[4, 3], [9, 2]] {
            let [rows, columns] = shape;
            let shown = format!("got shape [{rows}, {columns}]");
            let message = format!("subdivide needs positions of shape [9, 3], {shown}");
            assert_eq!(said(&Tensor::zeros(shape)), message);
        }
        let lost = Tensor::from_flat_fn([9, 3], |k| if k == 10 { f64::NAN } else { 0.0 });
        let message = "subdivide needs finite numbers in row 3 of the positions, got NaN";
        assert_eq!(said(&lost), message);
    }
}
