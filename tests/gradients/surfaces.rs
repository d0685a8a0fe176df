//! Operations on surfaces: normals and tangents; and the downsampling of images.

use std::hash::Hash;

use bokashi_check::strategy::{
    ClosedMesh, closed_mesh, image_of, number, tensor, unit_quaternion, well_shaped,
};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Border, Filter, Mesh, Weighting, downsample, face_normals, perturbed_normals, tangents,
    transform_normals, vertex_normals,
};
use glam::{DMat3, DVec3};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::rendering::{check, leaf, wide};
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
        DMat3::from_cols_array_2d(&[0, 1, 2].map(|i| [0, 1, 2].map(|j| at(i, j)))).determinant()
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

/// A mesh, and texture coordinates with indices of their own.
#[derive(Debug, Clone)]
struct Tangents {
    mesh: Mesh,
    indices: Mesh,
}

impl Subject for Tangents {
    /// Positions, normals and texture coordinates.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let out = tangents(inputs[0], inputs[1], inputs[2], &self.indices, &self.mesh)?;
        // On which side of a face each normal lies, and which way the texture is turned there.
        let [positions, normals] = [0, 1].map(|i| wide(inputs[i]));
        let at =
            |of: &Tensor<f64>, vertex: u32| DVec3::from_slice(&of.data()[3 * vertex as usize..]);
        let sides = self.mesh.faces().iter().flat_map(|&face| {
            let [p, q, r] = face.map(|vertex| at(&positions, vertex));
            let cross = (q - p).cross(r - p);
            face.map(|vertex| cross.dot(at(&normals, vertex)) > 0.0)
        });
        let signs: Vec<_> = wide(out).data().chunks(4).map(|row| row[3] > 0.0).collect();
        Ok(Outcome::from(out)
            .with_state(vanishing(out, 3))
            .with_state(sides.collect::<Vec<_>>())
            .with_state(signs))
    }
}

/// A surface with normals that are somewhat askew, and crooked coordinates: two for each vertex, of which
/// the second half of the faces takes the second.
fn textured(surface: &Surface, noise: &[f64]) -> (Tangents, Vec<Input>) {
    let positions = &surface.positions;
    let count = positions.shape()[0];
    let tape = Tape::new();
    let upright = vertex_normals(tape.constant(positions), &surface.mesh, Weighting::Angle);
    let upright = upright.unwrap().value();
    let normals =
        Tensor::from_flat_fn([count, 3], |k| 2.0 * upright.data()[k] + 0.4 * noise[k % 40]);
    let coordinate = |k: usize| {
        let p = DVec3::from_slice(&positions.data()[k / 2 % count * 3..]);
        let slopes = [DVec3::new(1.0, 0.3, -0.2), DVec3::new(-0.1, 0.9, 0.8)];
        slopes[k % 2].dot(p) + 0.4 * noise[7 * k % 40]
    };
    let coordinates = Tensor::from_flat_fn([2 * count, 2], coordinate);
    let faces = surface.mesh.faces();
    let named = faces.iter().enumerate().map(|(k, face)| {
        let shift = if 2 * k < faces.len() { 0 } else { count as u32 };
        face.map(|vertex| vertex + shift)
    });
    let indices = Mesh::new(named.collect(), 2 * count).unwrap();
    let inputs = [positions.clone(), normals, coordinates].map(Input::leaf).to_vec();
    (Tangents { mesh: surface.mesh.clone(), indices }, inputs)
}

/// Whether no edge of a face is nearly along a normal at its ends: the angles there bend so much that a
/// difference quotient has no step.
fn are_across(surface: &Surface, normals: &Tensor<f64>) -> bool {
    let at = |of: &Tensor<f64>, vertex: u32| DVec3::from_slice(&of.data()[3 * vertex as usize..]);
    surface.mesh.faces().iter().all(|&[a, b, c]| {
        let mut edges = [[a, b], [b, c], [c, a], [b, a], [c, b], [a, c]].into_iter();
        edges.all(|[from, to]| {
            let edge = at(&surface.positions, to) - at(&surface.positions, from);
            let normal = at(normals, from);
            normal.cross(edge).length() >= 0.3 * normal.length() * edge.length()
        })
    })
}

#[test]
fn tangents_of_textures_with_indices_of_their_own() {
    let of = |surface: &Surface, noise: &[f64]| {
        let (subject, inputs) = textured(surface, noise);
        Case::new(subject, inputs)
    };
    let noises = || vec(-1.0..1.0, 40);
    for (kind, surfaces) in surfaces() {
        let across = |(surface, noise): &(Surface, Vec<f64>)| {
            are_across(surface, &textured(surface, noise).1[1].tensor)
        };
        let cases = (surfaces, noises()).prop_filter("an edge along a normal", across);
        let cases = cases.prop_map(move |(surface, noise)| of(&surface, &noise));
        let noise: Vec<f64> = (0..40).map(motley).collect();
        let (subject, right) = textured(&Surface::sheet(1), &noise);
        let wrong = |input: usize, tensor: Input| {
            let mut inputs = right.clone();
            inputs[input] = tensor;
            Case::new(subject.clone(), inputs)
        };
        let few = Mesh::new(vec![], 8).unwrap();
        let few = Case::new(Tangents { indices: few, ..subject.clone() }, right.clone());
        check(
            Check::of_cases(format!("tangents of {kind}"), cases)
                .large(1, Just(of(&Surface::sheet(48), &noise)))
                .refuses("another number of positions", wrong(0, leaf([5, 3], 1.0)))
                .refuses("normals of four coordinates", wrong(1, leaf([4, 4], 1.0)))
                .refuses("a coordinate that is no number", wrong(2, leaf([8, 2], f64::NAN)))
                .refuses("another number of faces", few),
        );
    }
}

#[derive(Debug)]
struct PerturbedNormals;

impl Subject for PerturbedNormals {
    /// Normals, tangents and map values.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let out = perturbed_normals(inputs[0], inputs[1], inputs[2])?;
        let tangents = wide(inputs[1]);
        let kind = |row: &[f64]| (row[3] < 0.0, row[..3] == [0.0; 3]);
        let kinds: Vec<_> = tangents.data().chunks(4).map(kind).collect();
        Ok(Outcome::from(out).with_state(kinds))
    }
}

#[test]
fn perturbed_normals_in_frames_of_every_kind() {
    let of = |n: Input, t: Input, v: Input| Case::new(PerturbedNormals, [n, t, v]);
    let count = 4;
    let rows = |width: usize| {
        let entry = move |k: usize| motley(11 * k + width) + 0.2;
        Input::leaf(Tensor::from_flat_fn([12_000, width], entry))
    };
    // The sign is a number that is not near 0; and a tangent may be missing.
    let sign = select(&[1.0, -1.0, 0.4, -0.7][..]);
    let is_there = prop_oneof![11 => Just(true), 1 => Just(false)];
    // Nearly along the normal a difference quotient has no step.
    let is_across = |[n, t, _]: &[Tensor<f64>; 3]| {
        let mut rows = n.data().chunks(3).zip(t.data().chunks(3));
        rows.all(|(n, t)| DVec3::from_slice(n).cross(DVec3::from_slice(t)).length() > 0.1)
    };
    let vectors = [vectors(count), vectors(count), vectors(count)];
    let vectors = vectors.prop_filter("along the normal", is_across);
    let cases = (vectors, vec((sign, is_there), count)).prop_map(move |([n, t, v], kinds)| {
        let tangent = |k: usize| match (k % 4, kinds[k / 4]) {
            (3, (sign, _)) => sign,
            (_, (_, false)) => 0.0,
            (i, _) => t.data()[k / 4 * 3 + i],
        };
        let t = Tensor::from_flat_fn([count, 4], tangent);
        of(Input::leaf(n), Input::leaf(t), Input::leaf(v))
    });
    check(
        Check::of_cases("perturbed_normals", cases)
            .large(1, Just(of(rows(3), rows(4), rows(3))))
            .refuses(
                "tangents of three",
                of(leaf([2, 3], 1.0), leaf([2, 3], 1.0), leaf([2, 3], 1.0)),
            )
            .refuses("other rows", of(leaf([2, 3], 1.0), leaf([2, 4], 1.0), leaf([3, 3], 1.0))),
    );
}

#[derive(Debug, Clone)]
struct Downsample {
    k: usize,
    filter: Filter,
    border: Border,
}

impl Subject for Downsample {
    /// An image.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        Ok(downsample(inputs[0], self.k, &self.filter, self.border)?.into())
    }
}

#[test]
fn downsample_by_every_filter() {
    let filters = [
        Filter::Box,
        Filter::Triangle,
        Filter::Mitchell,
        Filter::Lanczos(2),
        Filter::custom(0.8, |x| 1.0 + x),
    ];
    for filter in filters {
        let borders = select(&[Border::Zero, Border::Mirror, Border::Clamp][..]);
        let of = filter.clone();
        // From one block, narrower than its window, up.
        let cases = (borders, 1..=3_usize, [1..=3_usize, 1..=3_usize], 1..=4_usize).prop_flat_map(
            move |(border, k, [rows, columns], channels)| {
                let subject = Downsample { k, filter: of.clone(), border };
                image_of([rows * k, columns * k, channels])
                    .prop_map(move |image| Case::new(subject.clone(), [Input::leaf(image)]))
            },
        );
        let by = |k: usize, image: Input| {
            Case::new(Downsample { k, filter: filter.clone(), border: Border::Mirror }, [image])
        };
        let large = Input::leaf(Tensor::from_flat_fn([300, 201, 3], motley));
        check(
            Check::of_cases(format!("downsample, {filter:?}"), cases)
                .large(1, Just(by(3, large)))
                .refuses("a factor of 0", by(0, leaf([4, 4, 1], 0.5)))
                .refuses("rows that are left over", by(2, leaf([5, 4, 1], 0.5)))
                .refuses("an image without channels", by(2, leaf([4, 4], 0.5))),
        );
    }
}
