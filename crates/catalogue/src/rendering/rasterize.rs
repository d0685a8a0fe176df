//! Barycentrics and depths of the faces at pixel centres.

use std::ops::Range;

use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Var};
use bokashi_render_ops::{depth, rasterize};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::{Scene, scene, scenes, size};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("rasterize");
    for (kind, scenes) in scenes() {
        for (what, outputs) in [("barycentrics", 0..1), ("depth", 1..2), ("both", 0..2)] {
            let cases = scenes.clone().prop_map(move |scene| {
                let clip = Input::leaf(scene.clip.clone());
                Case::new(Rasterize { scene, outputs: outputs.clone() }, [clip])
            });
            let [face] = [[[0.0, 0.0, 0.0, 1.0]; 3]];
            let one = scene(face.to_vec(), vec![[0, 1, 2]], size(4, 4));
            let of_one = |clip| Case::new(Rasterize { scene: one.clone(), outputs: 0..1 }, [clip]);
            let none = Scene { size: size(0, 4), ..one.clone() };
            let on_none = Rasterize { scene: none, outputs: 0..1 };
            entry.check(
                Check::of_cases(format!("rasterize {kind} to {what}"), cases)
                    .refuses("another number of vertices", of_one(leaf([2, 4], 1.0)))
                    .refuses("points of three coordinates", of_one(leaf([3, 3], 1.0)))
                    .refuses("an infinite position", of_one(leaf([3, 4], f64::INFINITY)))
                    .refuses("no pixels", Case::new(on_none, [leaf([3, 4], 1.0)])),
            );
        }
    }
    entry
}

#[derive(Debug)]
struct Rasterize {
    scene: Scene,
    outputs: Range<usize>,
}

impl Subject for Rasterize {
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let all = [fragments.barycentrics, depth(&fragments)?];
        let outputs = all[self.outputs.clone()].to_vec();
        Ok(Outcome::from(outputs).with_state(fragments.coverage.triangle_ids()))
    }
}
