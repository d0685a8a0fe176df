//! Pictures before every background, with their losses.

mod extremes;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Background, PixelLoss, antialias, composite, interpolate, rasterize};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::blends::choices;
use crate::entry::Entry;
use crate::inputs::wide;
use crate::scenes::{Scene, scenes, size};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("pictures").with_extremes(extremes::EXTREMES);
    for background in 0..3 {
        before(&mut entry, background);
    }
    benchmark!(entry, "squared_error, a picture", |s| [s.surface, s.clip, s.aliased], |x| {
        let picture = composite(x[0], &s.fragments(x[1])?, Background::Zero)?;
        let reference = x[2].value().map(|entry| entry + T::from_f64(0.125));
        picture.loss(&PixelLoss::squared(&reference, &Tensor::zeros([3]))?)?
    });
    entry
}

#[derive(Debug)]
struct Pictures {
    scene: Scene,
    /// 0: zeros, 1: the third input, a colour, 2: the third input, an image.
    background: usize,
}

impl Subject for Pictures {
    /// Clip positions, attributes, and perhaps a background.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let size = self.scene.size;
        let fragments = rasterize(inputs[0], &self.scene.mesh, size)?;
        let choices = choices(&fragments, &wide(inputs[0]));
        let background = match self.background {
            0 => Background::Zero,
            1 => Background::Color(inputs[2]),
            _ => Background::Image(inputs[2]),
        };
        let surface = interpolate(inputs[1], &fragments)?;
        let picture = antialias(composite(surface, &fragments, background)?)?;
        assert!(!matches!(picture.background(), Background::Zero) && picture.size() == size);
        let goal = |k: usize| T::from_f64((k * 13 % 29) as f64 / 29.0);
        let goal = Tensor::from_flat_fn([size.height, size.width, picture.channels()], goal);
        let black = Tensor::zeros([2]);
        let error = picture.loss(&PixelLoss::squared(&goal, &black)?)?;
        let robust = PixelLoss::new(&goal, &black, |seen, goal| {
            Ok((seen.try_sub(goal)?.square() + T::from_f64(0.1)).sqrt())
        })?;
        let robust = picture.map(|seen| Ok(seen.square() + seen))?.loss(&robust)?;
        let (ids, pixels) =
            (fragments.coverage.triangle_ids(), picture.pixels().collect::<Vec<_>>());
        let outputs = vec![picture.image()?, picture.values(), error, robust];
        Ok(Outcome::from(outputs).with_state(ids).with_state(pixels).with_state(choices))
    }
}

fn before(entry: &mut Entry, background: usize) {
    // A colour is held against every kind of scene; what differs of the others is the background alone.
    let kinds = |kind| background == 1 || matches!(kind, "faces" | "closed meshes");
    for (kind, scenes) in scenes().into_iter().filter(|(kind, _)| kinds(kind)) {
        let cases = scenes.clone().prop_map(move |scene| in_pictures(scene, background));
        // Of four bands: the sums of two are the same in either order.
        let large = scenes.prop_map(move |scene| {
            in_pictures(Scene { size: size(190, 300), ..scene }, background)
        });
        let name = format!("picture {background}, {kind}");
        entry.check(Check::from_cases(name, cases).large(1, large));
    }
}

/// A scene before a background: see [`Pictures`].
fn in_pictures(scene: Scene, background: usize) -> Case {
    let (vertices, size) = (scene.mesh.vertex_count(), scene.size);
    let motley = |k: usize| (k * 37 % 101) as f64 / 101.0;
    let mut inputs = vec![scene.clip.clone(), Tensor::from_flat_fn([vertices, 2], motley)];
    match background {
        0 => {}
        1 => inputs.push(Tensor::from_flat_fn([2], motley)),
        _ => inputs.push(Tensor::from_flat_fn([size.height, size.width, 2], motley)),
    }
    let inputs: Vec<_> = inputs.into_iter().map(Input::leaf).collect();
    Case::new(Pictures { scene, background }, inputs)
}
