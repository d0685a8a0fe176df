//! Depth of fragments.

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Mesh, depth, rasterize};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::scenes::{Scene, scenes, size};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("depth");
    for (kind, scenes) in scenes() {
        let cases = scenes.prop_map(|scene| {
            let clip = Input::leaf(scene.clip.clone());
            Case::new(Depth { scene }, [clip])
        });
        entry.check(Check::from_cases(format!("depth, {kind}"), cases).refuses(
            "rasterize needs clip positions of shape [3, 4], got shape [2, 4]",
            of_one_face(leaf([2, 4], 1.0)),
        ));
    }
    benchmark!(entry, "depth", |s| [s.clip], |x| depth(&rasterize(x[0], &s.mesh, s.size)?)?);
    entry
}

#[derive(Debug)]
struct Depth {
    scene: Scene,
}

impl Subject for Depth {
    /// Clip positions.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let depth = depth(&fragments)?;
        Ok(Outcome::from(depth).with_state(fragments.coverage.triangle_ids()))
    }
}

/// The depth of one face with positions `clip`.
fn of_one_face(clip: Input) -> Case {
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let scene = Scene { mesh, clip: Tensor::zeros([3, 4]), size: size(4, 4) };
    Case::new(Depth { scene }, [clip])
}
