//! Operations on surfaces: normals.

use std::hash::Hash;

use bokashi_check::strategy::{
    ClosedMesh, closed_mesh, number, tensor, unit_quaternion, well_shaped,
};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Mesh, Weighting, face_normals, transform_normals, vertex_normals};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::rendering::{check, leaf};
use crate::scenes::motley;

/// A mesh and its positions `[V, 3]`.
#[derive(Debug, Clone)]
struct Surface {
    mesh: Mesh,
    positions: Tensor<f64>,
}

impl Surface {
    fn new(positions: &[[f64; 3]], faces: Vec<[u32; 3]>) -> Self {
        let mesh = Mesh::new(faces, positions.len()).unwrap();
        let positions = Tensor::from_flat_fn([positions.len(), 3], |k| positions[k / 3][k % 3]);
        Self { mesh, positions }
    }

    /// A bent sheet of `side` by `side` quads.
    fn sheet(side: usize) -> Self {
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

    fn leaf(&self) -> Input {
        Input::leaf(self.positions.clone())
    }
}

/// Closed meshes that are neither flat nor long and thin. On those a difference quotient has no step:
/// from a sliver to a face without an area it is not far.
fn closed() -> BoxedStrategy<Surface> {
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
fn loose() -> BoxedStrategy<Surface> {
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

fn surfaces() -> Vec<(&'static str, BoxedStrategy<Surface>)> {
    vec![("closed meshes", closed()), ("loose faces", loose())]
}

/// Which rows of a tensor are zero.
fn vanishing<T: Scalar>(rows: Var<'_, T>, width: usize) -> impl Hash {
    let rows = rows.value();
    let is_zero = |row: &[T]| row.iter().all(|&entry| entry == T::ZERO);
    rows.data().chunks(width).map(is_zero).collect::<Vec<_>>()
}

#[derive(Debug)]
struct FaceNormals {
    mesh: Mesh,
}

impl Subject for FaceNormals {
    /// Positions.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let normals = face_normals(inputs[0], &self.mesh)?;
        Ok(Outcome::from(normals).with_state(vanishing(normals, 3)))
    }
}

#[test]
fn face_normals_of_closed_meshes_and_loose_faces() {
    let of = |surface: &Surface, positions: Input| {
        Case::new(FaceNormals { mesh: surface.mesh.clone() }, [positions])
    };
    for (kind, surfaces) in surfaces() {
        let cases = surfaces.prop_map(move |surface| of(&surface, surface.leaf()));
        let (small, large) = (Surface::sheet(1), Surface::sheet(48));
        check(
            Check::of_cases(format!("face_normals of {kind}"), cases)
                .large(1, Just(of(&large, large.leaf())))
                .refuses("another number of vertices", of(&small, leaf([5, 3], 1.0)))
                .refuses("points of four coordinates", of(&small, leaf([4, 4], 1.0)))
                .refuses("an infinite position", of(&small, leaf([4, 3], f64::INFINITY))),
        );
    }
}

#[derive(Debug)]
struct VertexNormals {
    mesh: Mesh,
    weighting: Weighting,
}

impl Subject for VertexNormals {
    /// Positions.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let normals = vertex_normals(inputs[0], &self.mesh, self.weighting)?;
        Ok(Outcome::from(normals).with_state(vanishing(normals, 3)))
    }
}

#[test]
fn vertex_normals_by_area_and_by_angle() {
    for weighting in [Weighting::Area, Weighting::Angle] {
        let of = move |surface: &Surface, positions: Input| {
            Case::new(VertexNormals { mesh: surface.mesh.clone(), weighting }, [positions])
        };
        for (kind, surfaces) in surfaces() {
            let cases = surfaces.prop_map(move |surface| of(&surface, surface.leaf()));
            let (small, large) = (Surface::sheet(1), Surface::sheet(48));
            check(
                Check::of_cases(format!("vertex_normals of {kind}, {weighting:?}"), cases)
                    .large(1, Just(of(&large, large.leaf())))
                    .refuses("another number of vertices", of(&small, leaf([3, 3], 1.0)))
                    .refuses("a position that is no number", of(&small, leaf([4, 3], f64::NAN))),
            );
        }
    }
}

#[derive(Debug)]
struct TransformNormals;

impl Subject for TransformNormals {
    /// Normals and a matrix.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let normals = transform_normals(inputs[0], inputs[1])?;
        Ok(Outcome::from(normals).with_state(vanishing(normals, 3)))
    }
}

/// Vectors of any direction whose length is from 0.3 to 3.
fn vectors(count: usize) -> BoxedStrategy<Tensor<f64>> {
    let vector = (0.3..3.0, unit_quaternion()).prop_map(|(length, [x, y, z, w])| {
        let column = [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)];
        column.map(|entry| length * entry)
    });
    let rows = vec(vector, count);
    rows.prop_map(move |rows| Tensor::from_flat_fn([count, 3], |k| rows[k / 3][k % 3])).boxed()
}

/// Square matrices whose linear part is far enough from singular for difference quotients.
fn matrices(side: usize) -> BoxedStrategy<Tensor<f64>> {
    let determinant = move |matrix: &Tensor<f64>| {
        let at = |i: usize, j: usize| matrix.data()[i * side + j];
        glam::DMat3::from_cols_array_2d(&[0, 1, 2].map(|i| [0, 1, 2].map(|j| at(i, j))))
            .determinant()
    };
    let is_regular = move |matrix: &Tensor<f64>| determinant(matrix).abs() > 0.5;
    tensor([side, side], number()).prop_filter("nearly singular", is_regular).boxed()
}

#[test]
fn transform_normals_by_matrices_of_both_shapes() {
    let of = |normals: Input, matrix: Input| Case::new(TransformNormals, [normals, matrix]);
    for side in [3, 4] {
        let cases = (vectors(4), matrices(side))
            .prop_map(move |(normals, matrix)| of(Input::leaf(normals), Input::leaf(matrix)));
        let many = Tensor::from_flat_fn([20_000, 3], |k| motley(7 * k) + 0.6);
        let matrix =
            Tensor::from_flat_fn([side, side], |k| motley(k) + f64::from(k % (side + 1) == 0));
        check(
            Check::of_cases(format!("transform_normals by {side} x {side}"), cases)
                .large(1, Just(of(Input::leaf(many), Input::leaf(matrix))))
                .refuses("rows of four", of(leaf([2, 4], 1.0), leaf([side, side], 1.0)))
                .refuses("a matrix of another shape", of(leaf([2, 3], 1.0), leaf([3, 4], 1.0))),
        );
    }
}
