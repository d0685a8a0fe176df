//! How barycentrics and attributes change from pixel to pixel.

use bokashi_check::strategy::tensor;
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Fragments, differentials, interpolate_differentials, interpolate_differentials_indexed,
    rasterize,
};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::fragments::exact_fragments;
use crate::scenes::{Scene, motley, scenes};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("differentials");
    differentials_of_barycentrics(&mut entry);
    differentials_of_attributes(&mut entry);
    differentials_of_pieces(&mut entry);
    benchmark!(entry, "differentials", |s| [s.clip], |x| {
        differentials(&rasterize(x[0], &s.mesh, s.size)?)?
    });
    benchmark!(entry, "interpolate_differentials", |s| [s.colors, s.slopes, s.clip], |x| {
        interpolate_differentials(x[0], &s.fragments(x[2])?, x[1])?
    });
    entry
}

#[derive(Debug)]
struct Differentials {
    scene: Scene,
}

impl Subject for Differentials {
    /// Clip positions, and perhaps attributes, whose own differentials come out then.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
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
        let ids: Vec<_> = fragments.coverage.faces().zip(fragments.coverage.pixels()).collect();
        Ok(Outcome::from(out).with_state(ids))
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
            Case::new(Differentials { scene }, [clip])
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
            Case::new(Differentials { scene }, inputs)
        });
        entry.check(Check::from_cases(format!("interpolate_differentials, {kind}"), cases));
    }
}

/// Pieces whose vertices and weights are variables of their own: coverage stays.
#[derive(Debug, Clone, Copy)]
struct OfPieces;

impl Subject for OfPieces {
    /// Clip positions and barycentrics.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let (clip, barycentrics) = (inputs[0], inputs[1]);
        let fragments = Fragments { clip, barycentrics, ..exact_fragments(tape)? };
        let pieces = fragments.coverage.centers()..fragments.coverage.count();
        Ok(differentials(&fragments)?.slice(0, pieces)?.into())
    }
}

fn differentials_of_pieces(entry: &mut Entry) {
    let tape = Tape::<f64>::new();
    let fixed = exact_fragments(&tape).expect("the scene is right");
    let noise = |of: Var<'_, f64>| {
        let of = of.value();
        tensor(of.shape(), -0.02..0.02).prop_map(move |noise| {
            Input::leaf(Tensor::from_flat_fn(of.shape(), |k| of.data()[k] + noise.data()[k]))
        })
    };
    let cases = (noise(fixed.clip), noise(fixed.barycentrics))
        .prop_map(|(clip, barycentrics)| Case::new(OfPieces, [clip, barycentrics]));
    entry.check(Check::from_cases("differentials of pieces", cases));
}
