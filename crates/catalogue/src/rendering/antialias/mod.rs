//! Images along edges that move.

mod extremes;

use std::sync::Arc;

use bokashi_check::strategy::image_of;
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Background, Size, antialias, antialias_image, composite, rasterize};
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
                format!(
                    "antialias_image needs an image of shape [4, 4, C], C > 0, got shape {shape:?}"
                ),
                Case::new(Antialias { scene: face.clone() }, inputs),
            )
        }));
    }
    benchmark!(entry, "antialias", |s| [s.surface, s.clip], |x| {
        antialias(composite(x[0], &s.fragments(x[1])?, Background::Zero)?)?.values()
    });
    benchmark!(entry, "antialias_image", |s| [s.aliased, s.clip], |x| antialias_image(
        x[0],
        &s.fragments(x[1])?
    )?);
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
        // The dense image, and the same as a picture before itself.
        let (image, size) = (inputs[1], self.scene.size);
        let dense = antialias_image(image, &fragments)?;
        let pixels: Arc<[u32]> = fragments.coverage.pixels().map(|pixel| pixel as u32).collect();
        let values = image.reshape([size.pixels(), image.shape()[2]])?.gather_rows(&pixels)?;
        let picture = composite(values, &fragments, Background::Image(image))?;
        let picture = antialias(picture)?.image()?;
        let ids = fragments.coverage.triangle_ids();
        Ok(Outcome::from(vec![dense, picture]).with_state(ids).with_state(choices))
    }
}
