//! Surfaces one behind another, as a lens sees them.

mod extremes;

use std::sync::Arc;

use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Fragments, Iris, LensLayer, Size, ThinLens, ThinLensOptions, depth_layers,
    lens_picture, rasterize,
};
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::fragments::exact_fragments;
use crate::inputs::{leaf, with_one};
use crate::scenes::{Scene, motley, scenes};

pub(crate) fn entry() -> Entry {
    // A case takes its time. Of 24 cases one breaks the law of precision: the gradients of a face in two layers, of
    // 1e-3 each, cancel to 1e-12, and the tape adds them in `f32`.
    let mut entry = Entry::new("lens_picture").cases(6).with_extremes(extremes::EXTREMES);
    for (kind, scenes) in scenes() {
        // A colour is held against every kind of scene; what differs of the others is the background alone.
        let backgrounds = if matches!(kind, "faces" | "closed meshes") { 0..3 } else { 1..2 };
        for background in backgrounds {
            let has_layers = |scene: &Scene| {
                let tape = Tape::<f64>::new();
                let seen = rasterize(tape.constant(&scene.clip), &scene.mesh, scene.size);
                seen.unwrap().coverage.count() > 0
            };
            let scenes = scenes.clone().prop_filter("nothing is seen", has_layers);
            let cases = (scenes, 1..3_usize, 0.3..1.5, 1.8..2.2, 0..100_usize);
            let cases = cases.prop_map(move |(scene, channels, aperture, focus, seed)| {
                let inputs = inputs_of(&scene, channels, background, [aperture, focus], seed);
                Case::new(Hidden { scene, background }, inputs)
            });
            let check = Check::from_cases(format!("lens_picture, {kind}, {background}"), cases);
            entry.check(check);
        }
    }
    let exact = (0.3..1.5, 1.8..2.2, 0..100_usize).prop_map(|(aperture, focus, seed)| {
        let numbers = [aperture, focus].map(Tensor::scalar);
        let inputs = exact_inputs(seed).into_iter().chain(numbers);
        Case::new(Exact, inputs.map(Input::leaf).collect::<Vec<_>>())
    });
    entry.check(refusing(Check::from_cases("lens_picture, exact coverage", exact)));
    benchmark!(
        entry,
        "lens_picture",
        |s| [s.surface, s.alphas, s.clip, Tensor::scalar(4.0), Tensor::scalar(1.25)],
        |x| {
            let all = depth_layers(x[2].detach(), &s.mesh, s.size, Some(2))?;
            let mut layers = Vec::with_capacity(all.len());
            for fragments in &all {
                // The layer behind has no more fragments.
                let rows = 0..fragments.coverage.count();
                let premultiplied = x[0].slice(0, rows.clone())?;
                let alpha = x[1].slice(0, rows)?;
                layers.push(LensLayer {
                    fragments,
                    premultiplied,
                    alpha,
                    distance: alpha + T::ONE,
                    slope: None,
                });
            }
            let lens = ThinLens { aperture: x[3], focus: x[4] };
            let options = ThinLensOptions::default();
            lens_picture(layers[0], &layers, Background::Zero, 3.0, lens, &options)?.image
        }
    );
    entry
}

/// How many layers are looked at.
const LAYERS: usize = 3;

/// Colours of all pixels of all layers, alphas and distances of all faces, a lens, slopes of all faces, and a
/// background: 0: zeros, 1: a colour, 2: an image. A face of one colour would hardly show how far it is out of focus.
fn inputs_of(
    scene: &Scene,
    channels: usize,
    background: usize,
    lens: [f64; 2],
    seed: usize,
) -> Vec<Input> {
    let faces = scene.mesh.faces().len();
    let places = LAYERS * scene.size.pixels();
    let mut inputs = vec![
        Tensor::from_flat_fn([places, channels], |k| motley(k + seed)),
        Tensor::from_flat_fn([faces], |k| 0.5 + 0.8 * motley(7 * k + seed)),
        Tensor::from_flat_fn([faces], |k| 2.2 + 2.4 * motley(11 * k + 3 * seed)),
        Tensor::scalar(lens[0]),
        Tensor::scalar(lens[1]),
        Tensor::from_flat_fn([faces, 2], |k| 2.0 * motley(13 * k + seed) - 1.0),
    ];
    let Size { width, height } = scene.size;
    match background {
        1 => inputs.push(Tensor::from_flat_fn([channels], motley)),
        2 => inputs.push(Tensor::from_flat_fn([height, width, channels], motley)),
        _ => {}
    }
    inputs.into_iter().map(Input::leaf).collect()
}

#[derive(Debug)]
struct Hidden {
    scene: Scene,
    background: usize,
}

impl Subject for Hidden {
    /// What [`inputs_of`] gives. The geometry stays, so that layers have as many fragments in any precision.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let clip = tape.constant(&self.scene.clip.cast());
        let layers = depth_layers(clip, &self.scene.mesh, self.scene.size, Some(LAYERS))?;
        let ids: Vec<_> = layers.iter().map(|layer| layer.coverage.triangle_ids()).collect();
        let mut seen = Vec::with_capacity(layers.len());
        for (layer, fragments) in layers.iter().enumerate() {
            let first = layer * self.scene.size.pixels();
            let places = fragments.coverage.pixels().map(|pixel| (first + pixel) as u32);
            let rows: Arc<[u32]> = fragments.coverage.faces().map(|face| face as u32).collect();
            seen.push(LensLayer {
                fragments,
                premultiplied: inputs[0].gather_rows(&places.collect())?,
                alpha: inputs[1].gather_rows(&rows)?,
                distance: inputs[2].gather_rows(&rows)?,
                slope: Some(inputs[5].gather_rows(&rows)?),
            });
        }
        let background = match self.background {
            0 => Background::Zero,
            1 => Background::Color(inputs[6]),
            _ => Background::Image(inputs[6]),
        };
        let lens = ThinLens { aperture: inputs[3], focus: inputs[4] };
        // Circles of which some are capped.
        let options = ThinLensOptions { largest_radius: 1.3, ..telling() };
        let found = lens_picture(seen[0], &seen, background, f64::INFINITY, lens, &options)?;
        Ok(Outcome::from(found.image).with_state((ids, found.piece)))
    }
}

/// Options by which kinks are told.
fn telling() -> ThinLensOptions {
    ThinLensOptions { tells_piece: true, ..ThinLensOptions::default() }
}

/// How many fragments, and how many pieces, the scene with exact coverage has.
fn exact_counts() -> [usize; 2] {
    let tape = Tape::<f64>::new();
    let coverage = exact_fragments(&tape).unwrap().coverage;
    [coverage.count(), coverage.count() - coverage.centers()]
}

/// Colours, alphas and distances of fragments with exact coverage, weights of their pieces, and slopes.
fn exact_inputs(seed: usize) -> [Tensor<f64>; 5] {
    let [count, pieces] = exact_counts();
    [
        Tensor::from_flat_fn([count, 2], |k| motley(k + seed)),
        Tensor::from_flat_fn([count], |k| 0.5 + 0.8 * motley(7 * k + seed)),
        Tensor::from_flat_fn([count], |k| 2.2 + 2.4 * motley(11 * k + 3 * seed)),
        Tensor::from_flat_fn([pieces], |k| 0.25 + 0.2 * motley(13 * k + seed)),
        Tensor::from_flat_fn([count, 2], |k| 2.0 * motley(17 * k + seed) - 1.0),
    ]
}

#[derive(Debug)]
struct Exact;

impl Subject for Exact {
    /// What [`exact_inputs`] gives, the radius of a lens, and its focus.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let fragments = exact_fragments(tape)?;
        let fragments = Fragments { weight: Some(inputs[3]), ..fragments };
        let [premultiplied, alpha, distance] = [inputs[0], inputs[1], inputs[2]];
        let slope = Some(inputs[4]);
        let layer = LensLayer { fragments: &fragments, premultiplied, alpha, distance, slope };
        let focal_length = tape.constant_scalar(T::from_f64(2.0));
        let lens = ThinLens::from_radius(inputs[5], focal_length, inputs[6])?;
        let iris = Iris::Polygon { blades: 5, rotation: 0.4 };
        let options = ThinLensOptions { margin: 1, iris, ..telling() };
        let found = lens_picture(layer, &[], Background::Zero, 6.0, lens, &options)?;
        Ok(Outcome::from(found.image).with_state(found.piece))
    }
}

fn refusing(check: Check) -> Check {
    let [count, _] = exact_counts();
    let numbers = [leaf([], 1.0), leaf([], 2.0)];
    let right: Vec<_> = exact_inputs(3).map(Input::leaf).into_iter().chain(numbers).collect();
    let with = |k: usize, input: Input| {
        let mut inputs = right.clone();
        inputs[k] = input;
        Case::new(Exact, inputs)
    };
    let far = with_one([count], 5, -0.5);
    let rows = [
        (
            format!("values of shape [{count}, C], C > 0, got shape [{count}]"),
            with(0, leaf([count], 0.5)),
        ),
        (
            format!("alphas of shape [{count}], got shape [{count}, 1]"),
            with(1, leaf([count, 1], 0.5)),
        ),
        (format!("distances of shape [{count}], got shape [2]"), with(2, leaf([2], 1.0))),
        ("distances from 0 up, in row 5 too, got -0.5".to_owned(), with(2, far)),
        (
            "distances from 0 up, in row 5 too, got NaN".to_owned(),
            with(2, with_one([count], 5, f64::NAN)),
        ),
        ("a single number for the aperture, got shape [3]".to_owned(), with(5, leaf([3], 1.0))),
        ("a finite aperture of at least 0, got -1".to_owned(), with(5, leaf([], -1.0))),
        (format!("slopes of shape [{count}, 2], got shape [{count}]"), with(4, leaf([count], 1.0))),
    ];
    rows.into_iter().fold(check, |check, (rule, case)| {
        check.refuses_midway(format!("lens_picture needs {rule}"), case)
    })
}
