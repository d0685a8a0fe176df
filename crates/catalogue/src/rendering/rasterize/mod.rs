//! Barycentrics and depths of the faces at pixel centres.

mod faces;
mod vertices;

use std::ops::Range;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, RasterOptions, Sampling, composite, depth, interpolate, rasterize,
};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::{Scene, scene, scenes, size};

pub(crate) fn entry() -> Entry {
    let mut entry =
        Entry::new("rasterize").with_extremes(faces::EXTREMES).with_extremes(vertices::EXTREMES);
    for (kind, scenes) in scenes() {
        for (what, outputs) in [("barycentrics", 0..1), ("depth", 1..2), ("both", 0..2)] {
            let cases = scenes.clone().prop_map(move |scene| {
                let clip = Input::leaf(scene.clip.clone());
                Case::new(Rasterize { scene, outputs: outputs.clone() }, [clip])
            });
            entry.check(refusing(Check::from_cases(format!("rasterize {kind} to {what}"), cases)));
        }
    }
    benchmark!(entry, "rasterize", |s| [s.clip], |x| rasterize(x[0], &s.mesh, s.size)?
        .barycentrics);
    // The number of pieces depends on the precision, a picture's shape does not.
    benchmark!(entry, "rasterize, exact", |s| [s.clip, s.colors], |x| {
        let options = RasterOptions::new(s.size).sampling(Sampling::Exact);
        let fragments = rasterize(x[0], &s.mesh, options.creases(&[x[1].into()]))?;
        composite(interpolate(x[1], &fragments)?, &fragments, Background::Zero)?.image()?
    });
    entry
}

fn refusing(check: Check) -> Check {
    let one = scene(vec![[0.0, 0.0, 0.0, 1.0]; 4], vec![[0, 1, 2]], size(4, 4));
    let of_one = |clip| Case::new(Rasterize { scene: one.clone(), outputs: 0..1 }, [clip]);
    let none = Rasterize { scene: Scene { size: size(0, 5), ..one.clone() }, outputs: 0..1 };
    let check = check.refuses(
        "an image needs at least one pixel and fewer than 2^32 - 1, got 0 x 5",
        Case::new(none, [leaf([4, 4], 1.0)]),
    );
    // A vertex that no face uses is refused too.
    let with = |bad: f64| [0.5, bad, 0.0, 1.0];
    let check =
        [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().fold(check, |check, bad| {
            let clip = |k: usize| if k < 12 { 1.0 } else { with(bad)[k - 12] };
            check.refuses(
                format!("clip positions need to be finite, got (0.5, {bad}, 0, 1) at vertex 3"),
                of_one(Input::leaf(Tensor::from_flat_fn([4, 4], clip))),
            )
        });
    [&[16][..], &[4, 3], &[2, 4], &[4, 4, 1]].into_iter().fold(check, |check, shape| {
        check.refuses(
            format!("rasterize needs clip positions of shape [4, 4], got shape {shape:?}"),
            of_one(Input::leaf(Tensor::zeros(shape))),
        )
    })
}

#[derive(Debug)]
struct Rasterize {
    scene: Scene,
    outputs: Range<usize>,
}

impl Subject for Rasterize {
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let all = [fragments.barycentrics, depth(&fragments)?];
        let outputs = all[self.outputs.clone()].to_vec();
        Ok(Outcome::from(outputs).with_state(fragments.coverage.triangle_ids()))
    }
}
