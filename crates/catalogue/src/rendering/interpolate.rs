//! Attributes at fragments.

use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Fragments, Mesh, interpolate, interpolate_indexed};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::fragments::{fixed_count, fixed_fragments};
use crate::inputs::{leaf, leaves_of_shapes};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("interpolate");
    let fragments = fixed_count();
    for channels in [1, 3, 9] {
        let inputs = leaves_of_shapes(&[&[4, channels], &[fragments, 2]]);
        let subject = Interpolate { indices: None };
        let of = move |inputs: Vec<Input>| Case::new(subject.clone(), inputs);
        let few = fragments - 1;
        let one_short = of(vec![leaf([4, channels], 1.0), leaf([few, 2], 0.3)]);
        let wrong = of.clone();
        let check = Check::from_cases("interpolate", inputs.prop_map(of)).refuses_midway(
            format!(
                "interpolate needs barycentrics of shape [{fragments}, 2], got shape [{few}, 2]"
            ),
            one_short,
        );
        let shapes = [&[4][..], &[3, 2], &[4, 0], &[4, 1, 1]];
        entry.check(shapes.into_iter().fold(check, |check, shape| {
            let attributes = Input::leaf(Tensor::zeros(shape));
            check.refuses_midway(
                format!("interpolate needs attributes of shape [4, C], C > 0, got shape {shape:?}"),
                wrong(vec![attributes, leaf([fragments, 2], 0.3)]),
            )
        }));
    }
    // More attributes than vertices, one of them used by both faces, one by none, one twice.
    let indices = Some(Mesh::new(vec![[5, 0, 2], [2, 3, 3]], 6).unwrap());
    let (inputs, subject) =
        (leaves_of_shapes(&[&[6, 2], &[fragments, 2]]), Interpolate { indices });
    let of = move |inputs: Vec<Input>| Case::new(subject.clone(), inputs);
    let of_five = of(vec![leaf([5, 2], 1.0), leaf([fragments, 2], 0.3)]);
    let single = Interpolate { indices: Some(Mesh::new(vec![[0, 1, 2]], 3).unwrap()) };
    let single = Case::new(single, [leaf([3, 1], 1.0), leaf([fragments, 2], 0.3)]);
    let name = "interpolate with an index buffer of its own";
    entry.check(
        Check::from_cases(name, inputs.prop_map(of))
            .refuses_midway(
                "interpolate needs attributes of shape [6, C], C > 0, got shape [5, 2]",
                of_five,
            )
            .refuses_midway("indices need one face per face of the mesh, 2, got 1", single),
    );
    benchmark!(entry, "interpolate", |s| [s.colors, s.barycentrics, s.clip], |x| {
        let barycentrics = x[1];
        interpolate(x[0], &Fragments { barycentrics, ..s.fragments(x[2])? })?
    });
    entry
}

#[derive(Debug, Clone)]
struct Interpolate {
    indices: Option<Mesh>,
}

impl Subject for Interpolate {
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = fixed_fragments(tape, Some(inputs[1]))?;
        Ok(match &self.indices {
            None => interpolate(inputs[0], &fragments)?.into(),
            Some(indices) => interpolate_indexed(inputs[0], indices, &fragments)?.into(),
        })
    }
}
