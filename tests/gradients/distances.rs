//! Distances along the view axis, and fragments that outlive a step, keep the laws.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, DepthImage, Fragments, RasterOptions, RenderError, Sampling, antialias, composite,
    eye_depth, interpolate, rasterize,
};
use proptest::prelude::*;

use crate::rendering::{check, fixed_fragments, leaf};
use crate::scenes::{Scene, motley, scenes};

#[derive(Debug)]
struct OfScene {
    scene: Scene,
}

impl Subject for OfScene {
    /// Clip positions.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let distances = eye_depth(&fragments)?;
        let image = distances.image(&fragments, 9.0)?.distances();
        let outputs = vec![distances.values(), image];
        Ok(Outcome::from(outputs).with_state(fragments.coverage.triangle_ids()))
    }
}

#[test]
fn eye_depth_of_what_was_rasterized() {
    for (kind, scenes) in scenes() {
        let cases = scenes.prop_map(|scene| {
            let clip = Input::leaf(scene.clip.clone());
            Case::new(OfScene { scene }, [clip])
        });
        check(Check::of_cases(format!("eye_depth of {kind}"), cases));
    }
}

#[derive(Debug, Clone, Copy)]
struct OfPieces;

/// Fragments of a fixed scene with exact coverage.
fn exact_fragments<T: Scalar>(tape: &Tape<T>) -> Result<Fragments<'_, T>, RenderError> {
    let fixed = fixed_fragments(tape, None)?;
    let options = RasterOptions::new(fixed.coverage.size()).sampling(Sampling::Exact);
    rasterize(fixed.clip, fixed.coverage.mesh(), options)
}

impl Subject for OfPieces {
    /// Barycentrics and weights of exact coverage, variables of their own.
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let (barycentrics, weight) = (inputs[0], Some(inputs[1]));
        let fragments = Fragments { barycentrics, weight, ..exact_fragments(tape)? };
        let distances = eye_depth(&fragments)?;
        let image = distances.image(&fragments, 3.0)?.distances();
        Ok(vec![distances.values(), image].into())
    }
}

#[test]
fn eye_depth_by_the_weights_of_pieces() {
    let coverage = exact_fragments::<f64>(&Tape::new()).unwrap().coverage;
    let (count, pieces) = (coverage.count(), coverage.count() - coverage.centers());
    let of = |inputs: [Tensor<f64>; 2]| Case::new(OfPieces, inputs.map(Input::leaf));
    // Within the face: a distance is not negative.
    let cases = (tensor([count, 2], 0.05..0.45), tensor([pieces], number()));
    check(
        Check::of_cases(
            "eye_depth by the weights of pieces",
            cases.prop_map(move |(b, w)| of([b, w])),
        )
        .refuses_midway(
            "a piece without weights",
            of([Tensor::zeros([count, 2]), Tensor::zeros([pieces - 1])]),
        ),
    );
}

#[derive(Debug, Clone, Copy)]
struct OfStillFragments;

impl Subject for OfStillFragments {
    /// Colours, and distances of an image that come from elsewhere.
    fn apply<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let elsewhere = Tape::new();
        let fragments = fixed_fragments(&elsewhere, None)?.still().on(tape);
        let surface = interpolate(inputs[0], &fragments)?;
        let picture = antialias(composite(surface, &fragments, Background::Zero)?)?;
        let distances = DepthImage::of_distances(inputs[1]).distances();
        Ok(vec![picture.image()?, distances * eye_depth(&fragments)?.values().sum()].into())
    }
}

#[test]
fn pictures_of_still_fragments_by_their_colours() {
    let inputs = (tensor([4, 3], number()), tensor([2, 3], number()));
    let cases = inputs.prop_map(|(colors, distances)| {
        Case::new(OfStillFragments, [colors, distances].map(Input::leaf))
    });
    let few = [leaf([3, 3], 0.5), Input::leaf(Tensor::from_flat_fn([2, 3], motley))];
    check(
        Check::of_cases("still fragments", cases)
            .refuses_midway("another number of vertices", Case::new(OfStillFragments, few)),
    );
}
