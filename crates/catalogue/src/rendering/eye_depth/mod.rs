//! Distances along the view axis.

mod extremes;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Fragments, eye_depth, eye_depth_slope, rasterize};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::fragments::exact_fragments;
use crate::scenes::{Scene, scenes};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("eye_depth").with_extremes(extremes::EXTREMES);
    eye_depth_of_what_was_rasterized(&mut entry);
    eye_depth_by_the_weights_of_pieces(&mut entry);
    benchmark!(entry, "eye_depth", |s| [s.clip], |x| {
        eye_depth(&rasterize(x[0], &s.mesh, s.size)?)?.values()
    });
    entry
}

#[derive(Debug)]
struct OfScene {
    scene: Scene,
    /// Where depths differ by a million, a slope is a difference of large numbers.
    has_slope: bool,
}

impl Subject for OfScene {
    /// Clip positions.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, self.scene.size)?;
        let distances = eye_depth(&fragments)?;
        let image = distances.image(&fragments, 9.0)?.distances();
        let mut outputs = vec![distances.values(), image];
        if self.has_slope {
            outputs.push(eye_depth_slope(&fragments)?);
        }
        Ok(Outcome::from(outputs).with_state(fragments.coverage.triangle_ids()))
    }
}

fn eye_depth_of_what_was_rasterized(entry: &mut Entry) {
    for (kind, scenes) in scenes() {
        let has_slope = kind == "closed meshes";
        let cases = scenes.prop_map(move |scene| {
            let clip = Input::leaf(scene.clip.clone());
            Case::new(OfScene { scene, has_slope }, [clip])
        });
        entry.check(Check::from_cases(format!("eye_depth of {kind}"), cases));
    }
}

#[derive(Debug, Clone, Copy)]
struct OfPieces;

impl Subject for OfPieces {
    /// Barycentrics and weights of exact coverage, variables of their own.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let (barycentrics, weight) = (inputs[0], Some(inputs[1]));
        let fragments = Fragments { barycentrics, weight, ..exact_fragments(tape)? };
        let distances = eye_depth(&fragments)?;
        let image = distances.image(&fragments, 3.0)?.distances();
        Ok(vec![distances.values(), image].into())
    }
}

fn eye_depth_by_the_weights_of_pieces(entry: &mut Entry) {
    let coverage = exact_fragments::<f64>(&Tape::new()).unwrap().coverage;
    let (count, pieces) = (coverage.count(), coverage.count() - coverage.centers());
    let of = |inputs: [Tensor<f64>; 2]| Case::new(OfPieces, inputs.map(Input::leaf));
    // Within the face: a distance is not negative.
    let cases = (tensor([count, 2], 0.05..0.45), tensor([pieces], number()));
    entry.check(
        Check::from_cases(
            "eye_depth by the weights of pieces",
            cases.prop_map(move |(b, w)| of([b, w])),
        )
        .refuses_midway(
            format!("eye_depth needs weights of shape [{pieces}], got shape [{}]", pieces - 1),
            of([Tensor::zeros([count, 2]), Tensor::zeros([pieces - 1])]),
        ),
    );
}
