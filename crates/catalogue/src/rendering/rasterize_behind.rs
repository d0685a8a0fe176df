//! The layer behind the first.

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Fragments, Mesh, rasterize, rasterize_behind};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::scenes::{Scene, scenes};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("rasterize_behind");
    for (kind, scenes) in scenes() {
        // With all faces again, behind where they are.
        let cases = scenes.prop_map(|scene| {
            let count = scene.mesh.vertex_count();
            let moved = |&[a, b, c]: &[u32; 3]| [a, b, c].map(|vertex| vertex + count as u32);
            let faces = scene.mesh.faces();
            let faces = faces.iter().copied().chain(faces.iter().map(moved)).collect();
            let clip = Tensor::from_fn([2 * count, 4], |[v, k]| {
                let row = v % count;
                let shift = if v >= count && k == 2 { 0.3 * scene.clip[[row, 3]] } else { 0.0 };
                scene.clip[[row, k]] + shift
            });
            let mesh = Mesh::new(faces, 2 * count).unwrap();
            let scene = Scene { mesh, clip: clip.clone(), size: scene.size };
            Case::new(Behind { scene }, [Input::leaf(clip)])
        });
        entry.check(Check::from_cases(format!("rasterize_behind, {kind}"), cases));
    }
    benchmark!(entry, "rasterize, the layer behind", |s| [s.clip], |x| {
        let front = rasterize(x[0].detach(), &s.mesh, s.size)?;
        rasterize_behind(&Fragments { clip: x[0], ..front }, s.size)?.barycentrics
    });
    entry
}

#[derive(Debug)]
struct Behind {
    scene: Scene,
}

impl Subject for Behind {
    /// Clip positions.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let front = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let behind = rasterize_behind(&front, self.scene.size)?;
        let ids = [&front, &behind].map(|layer| layer.coverage.triangle_ids());
        Ok(Outcome::from(behind.barycentrics).with_state(ids))
    }
}
