//! Tangents of textures whose coordinates have indices apart from those of positions.

mod extremes;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Mesh, Weighting, tangents, vertex_normals};
use glam::DVec3;
use proptest::collection::vec;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::{leaf, wide};
use crate::scenes::motley;
use crate::surfaces::{Surface, surfaces, vanishing};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("tangents").with_extremes(extremes::EXTREMES);
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
        let [first, ..] = *subject.indices.faces() else { panic!("a sheet has faces") };
        let shared = Mesh::new(vec![first; 2], 8).unwrap();
        let shared = Case::new(Tangents { indices: shared, ..subject.clone() }, right.clone());
        entry.check(
            Check::from_cases(format!("tangents of {kind}"), cases)
                .large(1, Just(of(&Surface::sheet(48), &noise)))
                .refuses(
                    "tangents needs positions of shape [4, 3], got shape [5, 3]",
                    wrong(0, leaf([5, 3], 1.0)),
                )
                .refuses(
                    "tangents needs normals of shape [4, 3], got shape [4, 4]",
                    wrong(1, leaf([4, 4], 1.0)),
                )
                .refuses(
                    "tangents needs texture coordinates of shape [8, 2], got shape [5, 2]",
                    wrong(2, leaf([5, 2], 1.0)),
                )
                .refuses(
                    "tangents needs finite numbers in row 0 of the texture coordinates, got NaN",
                    wrong(2, leaf([8, 2], f64::NAN)),
                )
                .refuses("indices need one face per face of the mesh, 2, got 0", few)
                .refuses("tangents needs texture coordinate 1 at no vertex but 1, got 3", shared),
        );
    }
    benchmark!(entry, "tangents", |s| [s.positions, s.normals, s.coordinates], |x| {
        tangents(x[0], x[1], x[2], &s.mesh, &s.mesh)?
    });
    entry
}

/// A mesh, and texture coordinates with indices of their own.
#[derive(Debug, Clone)]
struct Tangents {
    mesh: Mesh,
    indices: Mesh,
}

impl Subject for Tangents {
    /// Positions, normals and texture coordinates.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
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
