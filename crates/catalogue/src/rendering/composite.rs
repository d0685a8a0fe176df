//! Fragments before every background, as images.

use bokashi_check::{Applied, Case, Check, Input, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Background, composite};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::fragments::{fixed_count, fixed_fragments};
use crate::inputs::leaves_of_shapes;

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("composite");
    let fragments = [fixed_count(), 2];
    for background in [None, Some(&[2][..]), Some(&[4, 6, 2])] {
        let shapes: Vec<&[usize]> = [&fragments[..]].into_iter().chain(background).collect();
        let is_color = shapes.last().is_some_and(|shape| shape.len() == 1);
        let of = move |inputs: Vec<Input>| Case::new(Image { is_color }, inputs);
        entry.check(refusing(Check::from_cases("image", leaves_of_shapes(&shapes).prop_map(of))));
    }
    benchmark!(entry, "image", |s| [s.surface, s.clip], |x| {
        composite(x[0], &s.fragments(x[1])?, Background::Zero)?.image()?
    });
    entry
}

fn refusing(check: Check) -> Check {
    let count = fixed_count();
    let zeros = |shape: &[usize]| Input::leaf(Tensor::zeros(shape));
    let shapes = [&[count][..], &[count + 1, 2], &[count, 0], &[count, 2, 1]];
    let check = shapes.into_iter().fold(check, |check, shape| {
        check.refuses_midway(
            format!("composite needs values of shape [{count}, C], C > 0, got shape {shape:?}"),
            Case::new(Image { is_color: true }, [zeros(shape)]),
        )
    });
    let colors: [&[usize]; 7] = [&[], &[3], &[1], &[6, 4, 2], &[4, 6, 1], &[4, 6, 2], &[48]];
    let images: [&[usize]; 7] = [&[], &[3], &[1], &[2], &[6, 4, 2], &[4, 6, 1], &[48]];
    let rules = [
        (true, colors, "a background colour of shape [2]"),
        (false, images, "a background image of shape [4, 6, 2]"),
    ];
    let wrong = rules.into_iter().flat_map(|(is_color, shapes, rule)| {
        shapes
            .map(|shape| (is_color, shape, format!("composite needs {rule}, got shape {shape:?}")))
    });
    wrong.fold(check, |check, (is_color, shape, message)| {
        let case = Case::new(Image { is_color }, [zeros(&[count, 2]), zeros(shape)]);
        check.refuses_midway(message, case)
    })
}

#[derive(Debug, Clone, Copy)]
struct Image {
    is_color: bool,
}

impl Subject for Image {
    /// Fragments' values, and perhaps a background: a colour or an image.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let background = match *inputs {
            [_, background] if self.is_color => Background::Color(background),
            [_, background] => Background::Image(background),
            _ => Background::Zero,
        };
        Ok(composite(inputs[0], &fixed_fragments(tape, None)?, background)?.image()?.into())
    }
}
