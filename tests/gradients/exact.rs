//! Exact coverage of closed meshes, whose sides cancel nearly: beyond what the laws know of rounding.

use std::cell::Cell;

use bokashi_catalogue::scenes::{Scene, closed, motley};
use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{Background, RasterOptions, Sampling, composite, interpolate, rasterize};
use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

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
                let options = RasterOptions::new(scene.size).sampling(Sampling::Exact).creases(&[]);
                let fragments = rasterize(clip, &scene.mesh, options).unwrap();
                let surface = interpolate(colors, &fragments).unwrap();
                let composite = composite(surface, &fragments, Background::Zero).unwrap();
                let (image, coverage) = (composite.image().unwrap(), fragments.coverage);
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
