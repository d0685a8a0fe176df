//! How barycentrics and attributes change from pixel to pixel.

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    RasterOptions, Sampling, differentials, interpolate_differentials,
    interpolate_differentials_indexed, rasterize,
};
use proptest::prelude::*;

use crate::entry::Entry;
use crate::scenes::{Scene, motley, scenes};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("differentials");
    differentials_of_barycentrics(&mut entry);
    differentials_of_attributes(&mut entry);
    entry
}

#[derive(Debug)]
struct Differentials {
    scene: Scene,
    sampling: Sampling,
}

impl Subject for Differentials {
    /// Clip positions, and perhaps attributes, whose own differentials come out then.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let options = RasterOptions::new(self.scene.size).sampling(self.sampling);
        let fragments = rasterize(inputs[0], &self.scene.mesh, options)?;
        let slopes = differentials(&fragments)?;
        let out = match inputs {
            [_] => vec![slopes],
            _ => vec![
                interpolate_differentials(inputs[1], &fragments, slopes)?,
                interpolate_differentials_indexed(
                    inputs[1],
                    fragments.coverage.mesh(),
                    &fragments,
                    slopes,
                )?,
            ],
        };
        let pieces: Vec<_> =
            fragments.coverage.boundary().map(|(_, pieces)| pieces.len()).collect();
        let ids: Vec<_> = fragments.coverage.faces().zip(fragments.coverage.pixels()).collect();
        Ok(Outcome::from(out).with_state(ids).with_state(pieces))
    }
}

/// Scenes whose weights do not change by many times more in one pixel than in another: derivatives of
/// derivatives are off by the square of that factor. So no slivers, and no vertex a million times
/// farther away than another.
fn wide_scenes() -> impl Iterator<Item = (&'static str, BoxedStrategy<Scene>)> {
    let is_near = |scene: &Scene| scene.clip.data().iter().all(|entry| entry.abs() < 1e3);
    let wide = scenes().into_iter().filter(|(kind, _)| !kind.contains("sliver"));
    wide.map(move |(kind, scenes)| {
        (kind, scenes.prop_filter("a vertex far behind another", is_near).boxed())
    })
}

fn differentials_of_barycentrics(entry: &mut Entry) {
    for (kind, scenes) in wide_scenes() {
        let cases = scenes.prop_map(|scene| {
            let clip = Input::leaf(scene.clip.clone());
            Case::new(Differentials { scene, sampling: Sampling::Center }, [clip])
        });
        entry.check(Check::from_cases(format!("differentials, {kind}"), cases));
    }
}

fn differentials_of_attributes(entry: &mut Entry) {
    for (kind, scenes) in wide_scenes() {
        let cases = (scenes, 1..4_usize).prop_map(|(scene, channels)| {
            let vertices = scene.mesh.vertex_count();
            let attributes = Tensor::from_flat_fn([vertices, channels], motley);
            let inputs = [scene.clip.clone(), attributes].map(Input::leaf);
            Case::new(Differentials { scene, sampling: Sampling::Center }, inputs)
        });
        entry.check(Check::from_cases(format!("interpolate_differentials, {kind}"), cases));
    }
}
