//! Images along edges that move.

mod extremes;

use bokashi_check::strategy::image_of;
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Background, Composite, Size, antialias, composite, rasterize};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::blends;
use crate::entry::Entry;
use crate::inputs::wide;
use crate::scenes::{Scene, scene, scenes, size};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("antialias").with_extremes(extremes::EXTREMES);
    for (kind, scenes) in scenes() {
        let cases = scenes.prop_flat_map(|scene| {
            let Size { width, height } = scene.size;
            image_of([height, width, 2]).prop_map(move |image| {
                let inputs = [scene.clip.clone(), image].map(Input::leaf);
                Case::new(Antialias { scene: scene.clone() }, inputs)
            })
        });
        let face = scene(vec![[0.0, 0.0, 0.0, 1.0]; 3], vec![[0, 1, 2]], size(4, 4));
        let check = Check::from_cases(format!("antialias {kind}"), cases);
        let shapes = [&[4, 5, 1][..], &[4, 4], &[16, 2], &[4, 4, 0]];
        entry.check(shapes.into_iter().fold(check, |check, shape| {
            let inputs = [face.clip.clone(), Tensor::zeros(shape)].map(Input::leaf);
            check.refuses_midway(
                format!("composite needs an image of shape [4, 4, C], C > 0, got shape {shape:?}"),
                Case::new(Antialias { scene: face.clone() }, inputs),
            )
        }));
    }
    benchmark!(entry, "antialias", |s| [s.surface, s.clip], |x| {
        antialias(composite(x[0], &s.fragments(x[1])?, Background::Zero)?)?.values()
    });
    entry
}

#[derive(Debug)]
struct Antialias {
    scene: Scene,
}

impl Subject for Antialias {
    /// Clip positions and an image.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let choices = blends::choices(&fragments, &wide(inputs[0]));
        let image = antialias(Composite::from_image(inputs[1], &fragments)?)?.image()?;
        let ids = fragments.coverage.triangle_ids();
        Ok(Outcome::from(image).with_state(ids).with_state(choices))
    }
}
