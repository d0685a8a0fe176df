//! Pieces of exact coverage: barycentrics, weights and depths, and pictures of them.

mod extremes;

use std::sync::Arc;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Coverage, RasterOptions, Sampling, Size, composite, depth, eye_depth, interpolate,
    rasterize,
};
use glam::DVec3;
use proptest::prelude::*;

use crate::entry::Entry;
use crate::inputs::wide;
use crate::scenes::{Scene, scenes};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("exact_coverage")
        .with_extremes(extremes::inputs::EXTREMES)
        .with_extremes(extremes::shapes::EXTREMES)
        .with_extremes(extremes::depths::EXTREMES)
        .with_extremes(extremes::borders::EXTREMES);
    exact_coverage_to_barycentrics_weights_and_depths(&mut entry);
    pictures_with_exact_coverage_before_every_background(&mut entry);
    entry
}

/// The scenes that have derivatives within the laws' rounding. Others do not:
/// - Slivers: the rounding of a centroid's weights is as many times larger as a piece is narrower
///   than a pixel.
/// - Edges along the borders of pixels, and faces in one plane: they are kinks.
/// - Closed meshes: what each side of an edge inside the surface says of it cancels nearly.
fn smooth_scenes() -> impl Iterator<Item = (&'static str, BoxedStrategy<Scene>)> {
    let kinds = ["faces", "faces through the eye"];
    scenes().into_iter().filter(move |(kind, _)| kinds.contains(kind))
}

/// The picture, and where faces are seen.
fn exact_picture<'t, T: Scalar>(
    scene: &Scene,
    clip: Var<'t, T>,
    colors: Var<'t, T>,
    background: Background<'t, T>,
) -> Result<(Var<'t, T>, Arc<Coverage>), Refusal> {
    let fragments = rasterize(clip, &scene.mesh, options(scene).creases(&[]))?;
    let surface = interpolate(colors, &fragments)?;
    let image = composite(surface, &fragments, background)?.image()?;
    Ok((image, fragments.coverage))
}

fn options(scene: &Scene) -> RasterOptions {
    RasterOptions::new(scene.size).sampling(Sampling::Exact)
}

/// What changes by leaps: which pixels are resolved, into pieces of which faces, and of what shape.
fn state(coverage: &Coverage, clip: &Tensor<f64>) -> Vec<usize> {
    let faces: Vec<_> = coverage.faces().collect();
    let pieces = coverage.boundary().flat_map(|(pixel, fragments)| {
        let mut visible: Vec<_> =
            fragments.iter().map(|&fragment| faces[fragment as usize]).collect();
        visible.sort_unstable();
        std::iter::once(pixel).chain(visible).chain([usize::MAX]).collect::<Vec<_>>()
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
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = rasterize(inputs[0], &self.scene.mesh, options(&self.scene).creases(&[]))?;
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

fn exact_coverage_to_barycentrics_weights_and_depths(entry: &mut Entry) {
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
            entry.check(Check::from_cases(format!("exact coverage of {kind} to {what}"), cases));
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
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let background = match *inputs {
            [_, _, background] if background.shape().rank() == 1 => Background::Color(background),
            [_, _, background] => Background::Image(background),
            _ => Background::Zero,
        };
        let mesh = self.scene.mesh.with_seams(|_, _| self.has_seams);
        let scene = Scene { mesh, ..self.scene.clone() };
        let (image, coverage) = exact_picture(&scene, inputs[0], inputs[1], background)?;
        Ok(Outcome::from(image).with_state(state(&coverage, &wide(inputs[0]))))
    }
}

fn pictures_with_exact_coverage_before_every_background(entry: &mut Entry) {
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
            entry.check(Check::from_cases(format!("a picture of {kind} {what}"), cases));
        }
    }
}
