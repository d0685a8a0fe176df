//! Exact coverage keeps the laws.

use std::cell::Cell;
use std::sync::Arc;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Coverage, RasterOptions, Sampling, Size, composite, depth, eye_depth, interpolate,
    rasterize,
};
use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

use crate::rendering::{check, wide};
use crate::scenes::{Scene, closed, motley, scenes};

/// The scenes that have derivatives within the laws' rounding. Others do not:
/// - Slivers: the rounding of a centroid's weights is as many times larger as a piece is narrower
///   than a pixel.
/// - Edges along the borders of pixels, and faces in one plane: they are kinks.
/// - Closed meshes: what each side of an edge inside the surface says of it cancels nearly.
fn smooth_scenes() -> impl Iterator<Item = (&'static str, BoxedStrategy<Scene>)> {
    let kinds = ["faces", "faces through the eye"];
    scenes().into_iter().filter(move |(kind, _)| kinds.contains(kind))
}

/// Whether a closed mesh has a volume to speak of: the sides of a flat one pass through each other
/// wherever its vertices go.
fn is_solid(scene: &Scene) -> bool {
    let vertex = |index: u32| {
        let [x, y, _, w] = std::array::from_fn(|k| scene.clip.data()[4 * index as usize + k]);
        DVec3::new(x, y, w)
    };
    let corners = scene.mesh.faces().iter().map(|face| face.map(vertex));
    corners.map(|[p, q, r]| p.dot(q.cross(r)) / 6.0).sum::<f64>().abs() > 0.02
}

/// The picture, and where faces are seen.
fn picture<'t, T: Scalar>(
    scene: &Scene,
    clip: Var<'t, T>,
    colors: Var<'t, T>,
    background: Background<'t, T>,
) -> Result<(Var<'t, T>, Arc<Coverage>), Refusal> {
    let fragments = rasterize(clip, &scene.mesh, options(scene))?;
    let surface = interpolate(colors, &fragments)?;
    let image = composite(surface, &fragments, background)?.image()?;
    Ok((image, fragments.coverage))
}

#[test]
fn gradients_of_closed_meshes_are_difference_quotients() {
    let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(40) };
    let (compared, left_out) = (Cell::new(0), Cell::new(0));
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
        .run(&closed().prop_filter("sides in one plane", is_solid), |scene| {
            let colors = Tensor::from_flat_fn([scene.mesh.vertex_count(), 2], motley);
            let run = |clip: &Tensor<f64>, is_wanted: bool| {
                let tape = Tape::new();
                let [clip, colors] = [tape.leaf(clip), tape.leaf(&colors)];
                let (image, coverage) = picture(&scene, clip, colors, Background::Zero).unwrap();
                // Pieces come and go smoothly, but a pixel leaps where it starts to have them.
                let pixels: Vec<_> = coverage.boundary().map(|(pixel, _)| pixel).collect();
                let upstream =
                    tape.constant(&Tensor::from_flat_fn(image.shape(), |k| motley(3 * k)));
                let loss = (image * upstream).sum();
                let gradient = is_wanted.then(|| loss.backward().unwrap().get_or_zeros(clip));
                (loss.item(), gradient, pixels)
            };
            let (_, gradient, pixels) = run(&scene.clip, true);
            let gradient = gradient.unwrap();
            let largest = gradient.data().iter().fold(0.01, |most: f64, g| most.max(g.abs()));
            for k in 0..gradient.size() {
                let at = |offset: f64| {
                    let mut clip = scene.clip.clone();
                    clip.data_mut()[k] += offset;
                    let (loss, _, moved) = run(&clip, false);
                    (moved == pixels).then_some(loss)
                };
                let slope = |h: f64| Some((at(h)? - at(-h)?) / (2.0 * h));
                let Some((wide, narrow)) = slope(2e-5).zip(slope(1e-5)) else {
                    left_out.set(left_out.get() + 1);
                    continue;
                };
                compared.set(compared.get() + 1);
                let (found, expected) = (gradient.data()[k], (4.0 * narrow - wide) / 3.0);
                let bound = 1e-6 * largest + 2.0 * (expected - narrow).abs();
                prop_assert!((found - expected).abs() < bound, "{k}: {found} {expected}");
            }
            Ok(())
        })
        .unwrap();
    let (compared, left_out) = (compared.get(), left_out.get());
    println!("{left_out} of {} difference quotients left out", compared + left_out);
    assert!(compared > 500 && left_out < compared / 10, "{left_out} left out, {compared} not");
}

fn options(scene: &Scene) -> RasterOptions {
    RasterOptions::new(scene.size).sampling(Sampling::Exact)
}

/// What changes by leaps: which pixels are resolved, into pieces of which faces, and of what shape.
fn state(coverage: &Coverage, clip: &Tensor<f64>) -> Vec<usize> {
    let faces: Vec<_> = coverage.faces().collect();
    let pieces = coverage.boundary().flat_map(|(pixel, fragments)| {
        let mut own: Vec<_> = fragments.iter().map(|&fragment| faces[fragment as usize]).collect();
        own.sort_unstable();
        std::iter::once(pixel).chain(own).chain([usize::MAX]).collect::<Vec<_>>()
    });
    let centers = coverage.pixels().take(coverage.centers());
    centers.chain(pieces).chain(shapes(coverage, clip)).collect()
}

/// On which side of each line each corner of a pixel lies, and in which pixel each two lines meet. As
/// long as these stay, a piece's corners stay of one kind, and its area is smooth. Lines are edges,
/// where two faces have one depth, and where one leaves the depth range.
fn shapes(coverage: &Coverage, clip: &Tensor<f64>) -> Vec<usize> {
    let Size { width, height } = coverage.size();
    let vertex = |index: u32| -> [f64; 4] {
        let [x, y, z, w] = std::array::from_fn(|k| clip.data()[4 * index as usize + k]);
        [0.5 * width as f64 * (x + w), 0.5 * height as f64 * (w - y), z, w]
    };
    let faces = coverage.mesh().faces();
    let corners: Vec<_> = faces.iter().map(|face| face.map(vertex)).collect();
    let point = |[x, y, _, w]: [f64; 4]| DVec3::new(x, y, w);
    let mut lines: Vec<DVec3> = Vec::new();
    let mut depths = Vec::new();
    for [p, q, r] in &corners {
        let edges = [[q, r], [r, p], [p, q]].map(|[a, b]| point(*a).cross(point(*b)));
        lines.extend(edges);
        let depth = p[2] * edges[0] + q[2] * edges[1] + r[2] * edges[2];
        depths.push(depth / point(*p).dot(edges[0]));
    }
    for (k, one) in depths.iter().enumerate() {
        lines.extend(depths[..k].iter().map(|other| one - other));
        lines.extend([-1.0, 1.0].map(|end| one - DVec3::new(0.0, 0.0, end)));
    }
    let places = (0..=height).flat_map(|y| (0..=width).map(move |x| [x, y]));
    let sides = places.flat_map(|[x, y]| {
        let corner = DVec3::new(x as f64, y as f64, 1.0);
        lines.iter().map(move |line| usize::from(line.dot(corner) > 0.0)).collect::<Vec<_>>()
    });
    let meetings = lines.iter().enumerate().flat_map(|(k, one)| {
        let meet = |other: &DVec3| {
            let meeting = one.cross(*other);
            let cell = |place: f64, extent: usize| {
                (place / meeting.z + 1.0).floor().clamp(0.0, extent as f64 + 1.0) as usize
            };
            [cell(meeting.x, width), cell(meeting.y, height)]
        };
        lines[..k].iter().flat_map(meet).collect::<Vec<_>>()
    });
    sides.chain(meetings).collect()
}

#[derive(Debug)]
struct Pieces {
    scene: Scene,
    output: usize,
}

impl Subject for Pieces {
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, options(&self.scene))?;
        let weight = fragments.weight.ok_or("exact coverage has weights")?;
        let coverage = &fragments.coverage;
        let pieces = coverage.centers()..coverage.count();
        // The centroid of a tiny piece moves fast, and counts little.
        let share = weight.reshape([pieces.len(), 1])?;
        let output = match self.output {
            0 => fragments.barycentrics.slice(0, pieces)? * share,
            1 => weight,
            2 => depth(&fragments)?.slice(0, pieces)? * weight,
            _ => eye_depth(&fragments)?.values().slice(0, pieces)? * weight,
        };
        // Fragments are ordered by where faces are first seen.
        let order: Vec<_> = coverage.faces().collect();
        Ok(Outcome::from(output)
            .with_state(state(&fragments.coverage, &wide(inputs[0])))
            .with_state(order))
    }
}

#[test]
fn exact_coverage_to_barycentrics_weights_and_depths() {
    for (kind, scenes) in smooth_scenes() {
        let outputs = ["barycentrics", "weights", "depths", "distances"];
        for (output, what) in outputs.into_iter().enumerate() {
            if output > 1 && kind != "faces" {
                // The rounding of depths near the eye is beyond what the laws know.
                continue;
            }
            let cases = scenes.clone().prop_map(move |scene| {
                let clip = Input::leaf(scene.clip.clone());
                Case::new(Pieces { scene, output }, [clip])
            });
            check(Check::of_cases(format!("exact coverage of {kind} to {what}"), cases));
        }
    }
}

#[derive(Debug)]
struct Picture {
    scene: Scene,
    has_seams: bool,
}

impl Subject for Picture {
    /// Clip positions, colours, and perhaps a background.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let background = match *inputs {
            [_, _, background] if background.shape().rank() == 1 => Background::Color(background),
            [_, _, background] => Background::Image(background),
            _ => Background::Zero,
        };
        let mesh = self.scene.mesh.with_seams(|_, _| self.has_seams);
        let scene = Scene { mesh, ..self.scene.clone() };
        let (image, coverage) = picture(&scene, inputs[0], inputs[1], background)?;
        Ok(Outcome::from(image).with_state(state(&coverage, &wide(inputs[0]))))
    }
}

#[test]
fn pictures_with_exact_coverage_before_every_background() {
    for (kind, scenes) in smooth_scenes() {
        for (what, has_seams) in [("without seams", false), ("with seams", true)] {
            let cases = scenes.clone().prop_flat_map(move |scene| {
                let vertices = scene.mesh.vertex_count();
                let (height, width) = (scene.size.height, scene.size.width);
                let background = prop_oneof![
                    Just(None),
                    tensor([2], number()).prop_map(Some),
                    tensor([height, width, 2], number()).prop_map(Some),
                ];
                let colors = tensor([vertices, 2], number());
                (colors, background).prop_map(move |(colors, background)| {
                    let inputs = [Some(scene.clip.clone()), Some(colors), background];
                    let inputs: Vec<_> = inputs.into_iter().flatten().map(Input::leaf).collect();
                    Case::new(Picture { scene: scene.clone(), has_seams }, inputs)
                })
            });
            check(Check::of_cases(format!("a picture of {kind} {what}"), cases));
        }
    }
}
