//! Attributes at fragments.

use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Var};
use bokashi_render_ops::{Mesh, interpolate, interpolate_indexed};
use proptest::prelude::*;

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
        let of_five = of(vec![leaf([5, channels], 1.0), leaf([fragments, 2], 0.3)]);
        let one_short = of(vec![leaf([4, channels], 1.0), leaf([fragments - 1, 2], 0.3)]);
        entry.check(
            Check::of_cases("interpolate", inputs.prop_map(of))
                .refuses_midway("another number of vertices", of_five)
                .refuses_midway("a fragment without weights", one_short),
        );
    }
    // More attributes than vertices, one of them used by both faces, one by none, one twice.
    let indices = Some(Mesh::new(vec![[5, 0, 2], [2, 3, 3]], 6).unwrap());
    let (inputs, subject) =
        (leaves_of_shapes(&[&[6, 2], &[fragments, 2]]), Interpolate { indices });
    let of = move |inputs: Vec<Input>| Case::new(subject.clone(), inputs);
    let of_five = of(vec![leaf([5, 2], 1.0), leaf([fragments, 2], 0.3)]);
    let name = "interpolate with an index buffer of its own";
    entry.check(
        Check::of_cases(name, inputs.prop_map(of))
            .refuses_midway("fewer attributes than indices", of_five),
    );
    entry
}

#[derive(Debug, Clone)]
struct Interpolate {
    indices: Option<Mesh>,
}

impl Subject for Interpolate {
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = fixed_fragments(tape, Some(inputs[1]))?;
        Ok(match &self.indices {
            None => interpolate(inputs[0], &fragments)?.into(),
            Some(indices) => interpolate_indexed(inputs[0], indices, &fragments)?.into(),
        })
    }
}
