//! Surfaces, directions and matrices that operations on normals are examined with.

use std::hash::Hash;

use bokashi_check::Input;
use bokashi_check::strategy::{ClosedMesh, closed_mesh, unit_quaternion, well_shaped};
use bokashi_core::{Scalar, Tensor, Var};
use bokashi_render_ops::Mesh;
use proptest::collection::vec;
use proptest::prelude::*;

/// A mesh and its positions `[V, 3]`.
#[derive(Debug, Clone)]
pub(crate) struct Surface {
    pub(crate) mesh: Mesh,
    pub(crate) positions: Tensor<f64>,
}

impl Surface {
    pub(crate) fn new(positions: &[[f64; 3]], faces: Vec<[u32; 3]>) -> Self {
        let mesh = Mesh::new(faces, positions.len()).unwrap();
        let positions = Tensor::from_flat_fn([positions.len(), 3], |k| positions[k / 3][k % 3]);
        Self { mesh, positions }
    }

    /// A bent sheet of `side` by `side` quads.
    pub(crate) fn sheet(side: usize) -> Self {
        let (mut positions, mut faces) = (Vec::new(), Vec::new());
        for k in 0..(side + 1) * (side + 1) {
            let [x, y] = [k % (side + 1), k / (side + 1)];
            let [u, v] = [x, y].map(|at| 3.0 * at as f64 / side as f64);
            positions.push([u, v + 0.1 * u * u, u.sin() * v.cos()]);
            if x < side && y < side {
                let [below, above] = [k, k + side + 1].map(|vertex| vertex as u32);
                faces.extend([[below, below + 1, above + 1], [below, above + 1, above]]);
            }
        }
        Self::new(&positions, faces)
    }

    pub(crate) fn leaf(&self) -> Input {
        Input::leaf(self.positions.clone())
    }
}

/// Closed meshes that are neither flat nor long and thin. On those a difference quotient has no step:
/// from a sliver to a face without an area it is not far.
pub(crate) fn closed_surfaces() -> BoxedStrategy<Surface> {
    let extent = |mesh: &ClosedMesh, axis: usize| {
        let along = mesh.positions.iter().map(|position| position[axis]);
        along.clone().fold(f64::MIN, f64::max) - along.fold(f64::MAX, f64::min)
    };
    let is_round =
        move |mesh: &ClosedMesh| (0..3).all(|axis| (0.1..5.0).contains(&extent(mesh, axis)));
    let meshes = closed_mesh().prop_filter("flat or long", is_round);
    meshes.prop_map(|mesh| Surface::new(&mesh.positions, mesh.faces)).boxed()
}

/// Three faces that share no vertex, beside one without an area and a vertex without a face.
pub(crate) fn loose_surfaces() -> BoxedStrategy<Surface> {
    // One on a line stops being degenerate however little it moves.
    let degenerate =
        prop_oneof![5 => Just([9, 9, 3]), 5 => Just([0, 9, 9]), 1 => Just([9, 10, 11])];
    (vec(well_shaped(), 3), degenerate, 0.0..1.0)
        .prop_map(|(triangles, degenerate, along)| {
            let mut positions: Vec<[f64; 3]> =
                triangles.concat().iter().map(|&[x, y, z, _]| [x, y, z]).collect();
            // The last three lie on a line that is nobody's.
            positions.extend([0.0, 1.0, 3.0].map(|step| [4.0 * step, 0.5 + along, 2.0 * step]));
            Surface::new(&positions, vec![[0, 1, 2], [3, 5, 4], degenerate, [6, 7, 8]])
        })
        .boxed()
}

pub(crate) fn surfaces() -> Vec<(&'static str, BoxedStrategy<Surface>)> {
    vec![("closed meshes", closed_surfaces()), ("loose faces", loose_surfaces())]
}

/// Which rows of a tensor are zero.
pub(crate) fn vanishing<T: Scalar>(rows: Var<'_, T>, width: usize) -> impl Hash {
    let rows = rows.value();
    let is_zero = |row: &[T]| row.iter().all(|&entry| entry == T::ZERO);
    rows.data().chunks(width).map(is_zero).collect::<Vec<_>>()
}

/// Vectors of any direction whose length is from 0.3 to 3.
pub(crate) fn directions(count: usize) -> BoxedStrategy<Tensor<f64>> {
    let vector = (0.3..3.0, unit_quaternion()).prop_map(|(length, [x, y, z, w])| {
        let column = [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)];
        column.map(|entry| length * entry)
    });
    let rows = vec(vector, count);
    rows.prop_map(move |rows| Tensor::from_flat_fn([count, 3], |k| rows[k / 3][k % 3])).boxed()
}

/// A bent sheet of 6 x 6 quads, with coordinates that `T` holds.
pub(crate) fn sheet<T: Scalar>() -> (Vec<f64>, Vec<[u32; 3]>) {
    let (mut positions, mut faces) = (Vec::new(), Vec::new());
    for k in 0..49_u32 {
        let [x, y] = [k % 7, k / 7].map(|at| f64::from(at) / 6.0);
        positions.extend([x, y, (3.0 * x).sin() * y].map(|at| T::from_f64(at).to_f64()));
        if k % 7 < 6 && k / 7 < 6 {
            faces.extend([[k, k + 1, k + 8], [k, k + 8, k + 7]]);
        }
    }
    (positions, faces)
}
