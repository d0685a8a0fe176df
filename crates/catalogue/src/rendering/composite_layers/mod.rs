//! Layers in depth before every background.

mod extremes;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Background, Layer, composite_layers, depth_layers, rasterize};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::scenes::{Scene, motley, scenes};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("composite_layers").with_extremes(extremes::EXTREMES);
    for (kind, scenes) in scenes() {
        for background in 0..3 {
            let has_layers = |scene: &Scene| {
                let tape = Tape::<f64>::new();
                let seen = rasterize(tape.constant(&scene.clip), &scene.mesh, scene.size);
                seen.unwrap().coverage.count() > 0
            };
            let cases = (scenes.clone().prop_filter("nothing is seen", has_layers), 1..4_usize)
                .prop_map(move |(scene, channels)| {
                    let faces = scene.mesh.faces().len();
                    let mut inputs = vec![
                        Tensor::from_flat_fn([faces, channels], motley),
                        Tensor::from_flat_fn([faces], |k| 0.5 + 0.4 * motley(7 * k)),
                    ];
                    match background {
                        1 => inputs.push(Tensor::from_flat_fn([channels], motley)),
                        2 => {
                            let shape = [scene.size.height, scene.size.width, channels];
                            inputs.push(Tensor::from_flat_fn(shape, motley));
                        }
                        _ => {}
                    }
                    let inputs: Vec<_> = inputs.into_iter().map(Input::leaf).collect();
                    Case::new(Layers { scene, background }, inputs)
                });
            entry
                .check(Check::from_cases(format!("composite_layers, {kind}, {background}"), cases));
        }
    }
    benchmark!(entry, "composite_layers", |s| [s.surface, s.alphas, s.clip], |x| {
        let all = depth_layers(x[2].detach(), &s.mesh, s.size, Some(2))?;
        let mut layers = Vec::with_capacity(all.len());
        for fragments in &all {
            // The layer behind has no more fragments.
            let rows = 0..fragments.coverage.count();
            let premultiplied = x[0].slice(0, rows.clone())?;
            layers.push(Layer { fragments, premultiplied, alpha: x[1].slice(0, rows)? });
        }
        composite_layers(&layers, Background::Zero)?.values()
    });
    entry
}

#[derive(Debug)]
struct Layers {
    scene: Scene,
    /// 0: zeros, 1: a colour, 2: an image.
    background: usize,
}

impl Subject for Layers {
    /// Colours and alphas of all faces, and a background. The geometry stays, so that layers have as many
    /// fragments in any precision.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let clip = tape.constant(&self.scene.clip.cast());
        let layers = depth_layers(clip, &self.scene.mesh, self.scene.size, Some(3))?;
        let ids: Vec<_> = layers.iter().map(|layer| layer.coverage.triangle_ids()).collect();
        let mut all = Vec::new();
        for layer in &layers {
            let faces: Vec<u32> = layer.coverage.faces().map(|face| face as u32).collect();
            let rows = faces.into();
            all.push((inputs[0].gather_rows(&rows)?, inputs[1].gather_rows(&rows)?));
        }
        let with = |(fragments, &(premultiplied, alpha))| Layer { fragments, premultiplied, alpha };
        let layers: Vec<_> = layers.iter().zip(&all).map(with).collect();
        let background = match self.background {
            0 => Background::Zero,
            1 => Background::Color(inputs[2]),
            _ => Background::Image(inputs[2]),
        };
        let picture = composite_layers(&layers, background)?;
        Ok(Outcome::from(picture.image()?).with_state(ids))
    }
}
