//! Regularizers of vertices.

mod extremes;

use bokashi_check::strategy::tensor;
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::{
    RigidWeights, Rigidity, Topology, edge_length_error, laplacian_error, normal_error,
};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("vertices").with_extremes(extremes::EXTREMES);
    let of = |side: usize| {
        let (topology, rest) = bowl(side);
        let rigid = |weights| OfVertices::Rigid(Rigidity::new(&topology, &rest, weights).unwrap());
        let subjects = [
            OfVertices::Laplacian(topology.clone()),
            OfVertices::Edges(topology.clone(), 0.0),
            OfVertices::Edges(topology.clone(), 0.7),
            OfVertices::Normals(topology.clone()),
            rigid(RigidWeights::Uniform),
            rigid(RigidWeights::Cotangent),
        ];
        (subjects, rest)
    };
    let names = ["laplacian", "edges", "edges of a length", "normals", "rigidity", "by cotangents"];
    let refused = [
        "sparse_product",
        "edge_length_error",
        "edge_length_error",
        "normal_error",
        "rigidity",
        "rigidity",
    ];
    let ((small, rest), (large, large_rest)) = (of(2), of(48));
    for (((name, operation), small), large) in names.into_iter().zip(refused).zip(small).zip(large)
    {
        let rest = rest.clone();
        let moved = tensor(&[11, 3][..], (-0.3..0.3).boxed());
        let few = Case::new(small.clone(), vec![leaf([10, 3], 1.0)]);
        let targets = match &small {
            OfVertices::Edges(topology, _) => [-1.0, f64::NAN, f64::INFINITY]
                .map(|target| (target, OfVertices::Edges(topology.clone(), target)))
                .to_vec(),
            _ => Vec::new(),
        };
        let cases = moved.prop_map(move |moved| {
            let at = |k: usize| rest.data()[k] + moved.data()[k];
            Case::new(small.clone(), vec![Input::leaf(Tensor::from_flat_fn([11, 3], at))])
        });
        let motley = |k: usize| ((k * 7919 + 13) % 1009) as f64 / 1009.0;
        let shifted = |k: usize| large_rest.data()[k] + 0.3 * motley(k);
        let positions = Tensor::from_flat_fn(large_rest.shape(), shifted);
        let rule = match operation {
            "sparse_product" => "shape [11] or [11, C]",
            _ => "positions of shape [11, 3]",
        };
        let check = Check::from_cases(name, cases)
            .large(1, Just(Case::new(large, vec![Input::leaf(positions)])))
            .refuses(format!("{operation} needs {rule}, got shape [10, 3]"), few);
        entry.check(targets.into_iter().fold(check, |check, (target, edges)| {
            let rule = "edge_length_error needs a finite target length from 0 up, got";
            check.refuses(format!("{rule} {target}"), Case::new(edges, [leaf([11, 3], 0.5)]))
        }));
    }
    benchmark!(entry, "edge_length_error", |s| [s.positions], |x| {
        edge_length_error(x[0], &s.topology, 0.125)?
    });
    benchmark!(entry, "normal_error", |s| [s.positions], |x| normal_error(x[0], &s.topology)?);
    benchmark!(entry, "rigidity", |s| [s.positions], |x| s.rigidity.error(x[0])?);
    entry
}

/// A sheet of `side` by `side` quads in a bowl, one face that shares an edge with two others, a face that
/// names a vertex twice, and a vertex without a face.
fn bowl(side: usize) -> (Topology, Tensor<f64>) {
    let width = side as u32 + 1;
    let mut faces = Vec::new();
    for k in 0..(side * side) as u32 {
        let first = k / side as u32 * width + k % side as u32;
        faces.extend([
            [first, first + 1, first + width + 1],
            [first, first + width + 1, first + width],
        ]);
    }
    let count = (side + 1) * (side + 1);
    faces.extend([[0, width + 1, count as u32], [1, 1, 0]]);
    let positions = Tensor::from_fn([count + 2, 3], |[v, axis]| {
        let [x, y] = [v % (side + 1), v / (side + 1)].map(|at| at as f64 - 0.5 * side as f64);
        let at = if v < count { [x, y, 0.2 * (x * x + y * y)] } else { [0.3, -0.4, 3.0] };
        at[axis]
    });
    (Topology::new(&faces, count + 2).unwrap(), positions)
}

/// A regularizer of vertices.
#[derive(Debug, Clone)]
enum OfVertices {
    Laplacian(Topology),
    Edges(Topology, f64),
    Normals(Topology),
    Rigid(Rigidity),
}

impl Subject for OfVertices {
    /// Positions.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let positions = inputs[0];
        Ok(Outcome::from(match self {
            Self::Laplacian(topology) => laplacian_error(positions, &topology.uniform_laplacian())?,
            Self::Edges(topology, target) => edge_length_error(positions, topology, *target)?,
            Self::Normals(topology) => normal_error(positions, topology)?,
            Self::Rigid(rigidity) => rigidity.error(positions)?,
        }))
    }
}
