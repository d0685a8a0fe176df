//! Losses and regularizers of `bokashi-fit`.

use std::fs;

use bokashi_check::strategy::{around, number, tensor};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject, sides, subject};
use bokashi_core::{Mask, Scalar, Tape, Tensor, Var};
use bokashi_fit::{
    DepthAlignment, Penalty, RigidWeights, Rigidity, Topology, depth_error, edge_length_error,
    halved, laplacian_error, masked_error, mean_error, multiscale_ssim_error, normal_error,
    pyramid_error, silhouette_error, ssim_error, total_variation, weighted_error,
};
use proptest::prelude::*;

use crate::rendering::{check, leaf};

type Inputs = BoxedStrategy<Vec<Input>>;

/// Two leaves of one shape.
fn pair(shape: &'static [usize], entries: BoxedStrategy<f64>) -> Inputs {
    let two = (tensor(shape, entries.clone()), tensor(shape, entries));
    two.prop_map(|(x, y)| vec![Input::leaf(x), Input::leaf(y)]).boxed()
}

/// Leaves of these shapes that are worked on in several pieces.
fn large(shapes: &[&[usize]]) -> Inputs {
    let leaf = |(at, shape): (usize, &&[usize])| {
        let entry = |k: usize| 0.2 + ((k * 7919 + at * 389 + 13) % 1009) as f64 / 1009.0;
        Input::leaf(Tensor::from_flat_fn(*shape, entry))
    };
    Just(shapes.iter().enumerate().map(leaf).collect()).boxed()
}

/// The laws for a subject, on its inputs and on large ones.
fn laws(name: &str, subject: impl Subject + Copy, inputs: Inputs, large: Inputs) -> Check {
    let case = move |inputs: Vec<Input>| Case::new(subject, inputs);
    Check::new(name, subject, inputs).large(1, large.prop_map(case))
}

/// An error with kinks where `difference` has one of these values.
fn kinked<'t, T: Scalar>(error: Var<'t, T>, of: Var<'t, T>, kinks: &[f64]) -> Outcome<'t, T> {
    Outcome::from(error).with_state(sides(of, kinks))
}

/// A mask that shows two of three entries.
fn two_of_three(shape: &[usize]) -> Mask {
    Mask::from_flat_fn(shape, |k| k % 3 > 0)
}

const SMALL: &[usize] = &[3, 2, 2];
const MANY: &[usize] = &[60, 61, 5];
const ROWS: &[usize] = &[60, 61];

#[test]
fn mean_errors() {
    subject!(Squared: |x| mean_error(x[0], x[1], Penalty::Squared)?);
    subject!(Absolute: |x| {
        kinked(mean_error(x[0], x[1], Penalty::Absolute)?, x[0] - x[1], &[0.0])
    });
    subject!(Huber: |x| {
        let penalty = Penalty::Huber { delta: 0.5 };
        kinked(mean_error(x[0], x[1], penalty)?, x[0] - x[1], &[-0.5, 0.0, 0.5])
    });
    let values = || pair(SMALL, around(&[0.5], -2.0..2.0));
    let of = |bad: Vec<Input>| Case::new(Squared, bad);
    check(
        laws("mean squared error", Squared, values(), large(&[MANY; 2]))
            .refuses("shapes that differ", of(vec![leaf([2], 1.0), leaf([3], 1.0)]))
            .refuses("no entries", of(vec![leaf([0], 1.0), leaf([0], 1.0)])),
    );
    check(laws("mean absolute error", Absolute, values(), large(&[MANY; 2])));
    check(laws("mean Huber error", Huber, values(), large(&[MANY; 2])));
    subject!(Charbonnier: |x| mean_error(x[0], x[1], Penalty::Charbonnier { scale: 0.5 })?);
    check(laws("mean Charbonnier error", Charbonnier, values(), large(&[MANY; 2])));
}

/// The relative error takes its denominator as a constant: here it is one.
#[test]
fn relative_error_of_what_is_fixed() {
    subject!(Relative: |x| mean_error(x[0], x[1], Penalty::Relative { epsilon: 0.01 })?);
    let values = (tensor(SMALL, number()), tensor(SMALL, number()));
    let values = values.prop_map(|(x, y)| vec![Input::constant(x), Input::leaf(y)]).boxed();
    let many = large(&[MANY; 2]).prop_map(|mut inputs| {
        inputs[0].differentiable = false;
        inputs
    });
    check(laws("mean relative error", Relative, values, many.boxed()));
}

#[test]
fn weighted_and_masked_errors() {
    subject!(Weighted: |x| weighted_error(x[0], x[1], x[2], Penalty::Squared)?);
    subject!(WeightedHuber: |x| {
        let penalty = Penalty::Huber { delta: 0.5 };
        let error = weighted_error(x[0], x[1], x[2], penalty)?;
        kinked(error, x[0] - x[1], &[-0.5, 0.5])
    });
    subject!(Masked: |x| {
        let mask = two_of_three(&x[0].shape()[..2]);
        masked_error(x[0], x[1], &mask, Penalty::Squared)?
    });
    let weighted = || {
        let weights = tensor([3, 2], (0.1..2.0).boxed());
        let inputs = (pair(SMALL, around(&[0.5], -2.0..2.0)), weights);
        inputs.prop_map(|(mut inputs, weights)| {
            inputs.push(Input::leaf(weights));
            inputs
        })
    };
    let negative = vec![leaf([3, 2], 1.0), leaf([3, 2], 0.5), leaf([3], -1.0)];
    check(
        laws("weighted error", Weighted, weighted().boxed(), large(&[MANY, MANY, ROWS]))
            .refuses("negative weights", Case::new(Weighted, negative)),
    );
    let many = large(&[MANY, MANY, ROWS]);
    check(laws("weighted Huber error", WeightedHuber, weighted().boxed(), many));
    check(laws("masked error", Masked, pair(SMALL, number()), large(&[MANY; 2])));
}

#[test]
fn structural_similarity() {
    subject!(Ssim: |x| ssim_error(x[0], x[1], 1.0)?);
    subject!(Multiscale: |x| multiscale_ssim_error(x[0], x[1], 1.0, Some(2))?);
    let unit = || (0.0..1.0).boxed();
    let small = vec![leaf([10, 12, 1], 1.0), leaf([10, 12, 1], 1.0)];
    check(
        laws("ssim", Ssim, pair(&[12, 13, 2], unit()), large(&[&[60, 90, 1][..]; 2]))
            .refuses("images smaller than a window", Case::new(Ssim, small)),
    );
    let flat = pair(&[11, 12, 1], (0.5..0.501).boxed());
    check(laws("ssim of flat images", Ssim, flat, large(&[&[50, 30, 2][..]; 2])));
    // Alike: where the mean of a level is near 0, a power of it bends too much for difference quotients.
    let alike = pair(&[21, 22, 1], unit()).prop_map(|mut inputs| {
        let [x, y] = [0, 1].map(|k| inputs[k].tensor.clone());
        let mixed = Tensor::from_flat_fn(x.shape(), |k| 0.6 * x.data()[k] + 0.4 * y.data()[k]);
        inputs[1].tensor = mixed;
        inputs
    });
    check(laws("ms-ssim", Multiscale, alike.boxed(), large(&[&[50, 70, 1][..]; 2])));
}

#[test]
fn halves_and_pyramids() {
    subject!(Halved: |x| halved(x[0])?);
    subject!(Pyramid: |x| {
        pyramid_error(x[0], x[1], 3, |x, y| mean_error(x, y, Penalty::Squared))?
    });
    let image = tensor([5, 4, 2], number()).prop_map(|x| vec![Input::leaf(x)]).boxed();
    check(
        laws("halved", Halved, image, large(&[&[70, 91, 6]]))
            .refuses("a matrix", Case::new(Halved, vec![leaf([3, 3], 1.0)])),
    );
    check(laws("pyramid", Pyramid, pair(&[5, 7, 1], number()), large(&[&[70, 61, 8][..]; 2])));
}

#[test]
fn silhouettes() {
    subject!(Silhouette: |x| silhouette_error(x[0], x[1])?);
    let masks = pair(&[3, 4], (0.05..1.0).boxed());
    check(
        laws("silhouette", Silhouette, masks, large(&[ROWS, ROWS]))
            .refuses("shapes that differ", {
                Case::new(Silhouette, vec![leaf([2], 1.0), leaf([3], 1.0)])
            }),
    );
}

#[test]
fn depths() {
    subject!(Plain: |x| {
        let mask = two_of_three(&x[0].shape());
        let error = depth_error(x[0], x[1], Some(&mask), DepthAlignment::None)?;
        kinked(error, x[0] - x[1], &[0.0])
    });
    /// On which side of its reference each aligned depth is.
    fn aligned_sides<T: Scalar>(d: Var<'_, T>, r: Var<'_, T>, has_shift: bool) -> Vec<bool> {
        let [d, r] = [d, r].map(|x| x.value().cast::<f64>());
        let mean = |x: &Tensor<f64>| {
            if has_shift { x.data().iter().sum::<f64>() / x.size() as f64 } else { 0.0 }
        };
        let (of_d, of_r) = (mean(&d), mean(&r));
        let pairs: Vec<_> =
            d.data().iter().zip(r.data()).map(|(d, r)| (d - of_d, r - of_r)).collect();
        let product: f64 = pairs.iter().map(|(d, r)| d * r).sum();
        let square: f64 = pairs.iter().map(|(d, _)| d * d).sum();
        pairs.iter().map(|(d, r)| product / square * d > *r).collect()
    }
    subject!(Scale: |x| {
        let error = depth_error(x[0], x[1], None, DepthAlignment::Scale)?;
        Outcome::from(error).with_state(aligned_sides(x[0], x[1], false))
    });
    subject!(ScaleAndShift: |x| {
        let error = depth_error(x[0], x[1], None, DepthAlignment::ScaleAndShift)?;
        Outcome::from(error).with_state(aligned_sides(x[0], x[1], true))
    });
    let depths = || pair(&[3, 4], (0.5..3.0).boxed());
    let many = || large(&[&[150, 121][..]; 2]);
    check(laws("depth", Plain, depths(), many()));
    check(laws("depth up to scale", Scale, depths(), many()));
    check(laws("depth up to scale and shift", ScaleAndShift, depths(), many()));
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
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let positions = inputs[0];
        Ok(Outcome::from(match self {
            Self::Laplacian(topology) => laplacian_error(positions, &topology.uniform_laplacian())?,
            Self::Edges(topology, target) => edge_length_error(positions, topology, *target)?,
            Self::Normals(topology) => normal_error(positions, topology)?,
            Self::Rigid(rigidity) => rigidity.error(positions)?,
        }))
    }
}

#[test]
fn regularizers_of_vertices() {
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
    let ((small, rest), (large, large_rest)) = (of(2), of(48));
    for ((name, small), large) in names.into_iter().zip(small).zip(large) {
        let rest = rest.clone();
        let moved = tensor(&[11, 3][..], (-0.3..0.3).boxed());
        let refused = Case::new(small.clone(), vec![leaf([10, 3], 1.0)]);
        let cases = moved.prop_map(move |moved| {
            let at = |k: usize| rest.data()[k] + moved.data()[k];
            Case::new(small.clone(), vec![Input::leaf(Tensor::from_flat_fn([11, 3], at))])
        });
        let motley = |k: usize| ((k * 7919 + 13) % 1009) as f64 / 1009.0;
        let entry = |k: usize| large_rest.data()[k] + 0.3 * motley(k);
        let positions = Tensor::from_flat_fn(large_rest.shape(), entry);
        check(
            Check::of_cases(name, cases)
                .large(1, Just(Case::new(large, vec![Input::leaf(positions)])))
                .refuses("another number of vertices", refused),
        );
    }
}

#[test]
fn regularizers_of_textures() {
    subject!(Smooth: |x| total_variation(x[0], Penalty::Charbonnier { scale: 0.1 })?);
    subject!(Plain: |x| {
        let texture = x[0].value();
        let [height, width, channels] = [0, 1, 2].map(|axis| texture.shape()[axis]);
        let mut rises = Vec::new();
        for i in 0..height {
            for j in 0..width {
                for c in 0..channels {
                    let own = texture[[i, j, c]];
                    rises.push(i + 1 < height && texture[[i + 1, j, c]] > own);
                    rises.push(j + 1 < width && texture[[i, j + 1, c]] > own);
                }
            }
        }
        Outcome::from(total_variation(x[0], Penalty::Absolute)?).with_state(rises)
    });
    // Of equal neighbours, or nearly so, there are enough by chance.
    let texture = |shape: &'static [usize]| {
        tensor(shape, (0.0..3.0).boxed()).prop_map(|x| vec![Input::leaf(x)]).boxed()
    };
    let many = || large(&[&[70, 90, 3][..]]);
    check(
        laws("total variation", Smooth, texture(&[4, 3, 2]), many())
            .refuses("a matrix", Case::new(Smooth, vec![leaf([3, 3], 1.0)])),
    );
    check(laws("total variation of rows", Smooth, texture(&[1, 5, 1]), many()));
    check(laws("plain total variation", Plain, texture(&[3, 4, 1]), many()));
}

/// Every function that `bokashi-fit` gives for losses, but those without a tape.
#[test]
fn no_loss_is_forgotten() {
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/../crates/fit/src");
    let laws = include_str!("losses.rs");
    let mut count = 0;
    for folder in ["losses", "regularizers"] {
        for file in fs::read_dir(format!("{source}/{folder}")).unwrap() {
            let text = fs::read_to_string(file.unwrap().path()).unwrap();
            let code = text.split("#[cfg(test)]").next().unwrap();
            for line in code.lines().filter_map(|line| line.trim().strip_prefix("pub fn ")) {
                let name: String =
                    line.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                let declared = code.split(&format!("pub fn {name}<")).nth(1).unwrap_or_default();
                let is_on_a_tape = declared.split('{').next().is_some_and(|d| d.contains("Var<"));
                if is_on_a_tape {
                    assert!(laws.contains(&format!("{name}(")), "{name} has no law");
                    count += 1;
                }
            }
        }
    }
    assert!(count >= 13, "only {count} were found");
}
