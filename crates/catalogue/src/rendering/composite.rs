//! Fragments before every background, as images.

use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Var};
use bokashi_render_ops::{Background, composite};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::fragments::{fixed_count, fixed_fragments};
use crate::inputs::{leaf, leaves_of_shapes};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("composite");
    let fragments = [fixed_count(), 2];
    for background in [None, Some(&[2][..]), Some(&[4, 6, 2])] {
        let shapes: Vec<&[usize]> = [&fragments[..]].into_iter().chain(background).collect();
        let of = |inputs: Vec<Input>| Case::new(Image, inputs);
        let one_more = of(vec![leaf([fragments[0] + 1, 2], 0.5)]);
        let turned = of(vec![leaf(fragments, 0.5), leaf([6, 4, 2], 0.5)]);
        entry.check(
            Check::of_cases("image", leaves_of_shapes(&shapes).prop_map(of))
                .refuses_midway("a value without a fragment", one_more)
                .refuses_midway("a background of another size", turned),
        );
    }
    entry
}

#[derive(Debug, Clone, Copy)]
struct Image;

impl Subject for Image {
    /// Fragments' values, and perhaps a background: a colour or an image.
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let background = match *inputs {
            [_, background] if background.shape().rank() == 1 => Background::Color(background),
            [_, background] => Background::Image(background),
            _ => Background::Zero,
        };
        Ok(composite(inputs[0], &fixed_fragments(tape, None)?, background)?.image()?.into())
    }
}
