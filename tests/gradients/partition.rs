//! With exact coverage what is seen in a pixel and its background are a partition of it. This holds
//! for meshes of every kind: closed, loose, through each other, in one plane, far smaller than a
//! pixel, far larger than the image.

use bokashi_catalogue::scenes::{Scene, scenes};
use bokashi_catalogue::visible_areas;
use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{
    Background, Mesh, RasterOptions, Sampling, Size, composite, interpolate, rasterize,
};
use proptest::prelude::*;
use proptest::strategy::Union;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

/// Scenes of every kind, perhaps made smaller or larger around the middle of the image, perhaps with
/// each face drawn twice.
fn meshes() -> impl Strategy<Value = Scene> {
    let kinds = Union::new(scenes().into_iter().map(|(_, scenes)| scenes));
    let power = prop_oneof![3 => Just(0), 1 => -12..8_i32];
    (kinds, power, prop::bool::weighted(0.2)).prop_map(|(mut scene, power, is_twice)| {
        let scale = f64::powi(2.0, power);
        let entries = scene.clip.data_mut().iter_mut().enumerate();
        entries.filter(|(k, _)| k % 4 < 2).for_each(|(_, entry)| *entry *= scale);
        if is_twice {
            let faces = scene.mesh.faces();
            let again = faces.iter().map(|&[a, b, c]| [b, c, a]);
            let both = faces.iter().copied().chain(again).collect();
            scene.mesh = Mesh::new(both, scene.mesh.vertex_count()).unwrap();
        }
        scene
    })
}

/// The share of each pixel that is covered: the sum of its weights. Asserts that each is positive, and
/// that an image of 1 before 0, and one of 0 before 1, are that share and what is left.
fn covered<T: Scalar>(scene: &Scene, slack: f64) -> Result<Vec<f64>, TestCaseError> {
    let tape = Tape::<T>::new();
    let clip =
        tape.leaf(&Tensor::from_flat_fn(scene.clip.shape(), |k| T::from_f64(scene.clip.data()[k])));
    let options = RasterOptions::new(scene.size).sampling(Sampling::Exact);
    let fragments = rasterize(clip, &scene.mesh, options.creases(&[])).unwrap();
    let weights = fragments.weight.unwrap().value();
    let mut covered = vec![0.0; scene.size.pixels()];
    for (n, pixel) in fragments.coverage.pixels().enumerate() {
        let piece = n.checked_sub(fragments.coverage.centers());
        let weight = piece.map_or(1.0, |piece| weights.data()[piece].to_f64());
        prop_assert!(weight > 0.0, "a weight of {weight}");
        covered[pixel] += weight;
    }
    let ones = [1.0, 0.0].map(|own| {
        let colors = tape.constant_full([scene.mesh.vertex_count(), 1], T::from_f64(own));
        let behind = tape.constant_full([1], T::from_f64(1.0 - own));
        let surface = interpolate(colors, &fragments).unwrap();
        composite(surface, &fragments, Background::Color(behind)).unwrap().image().unwrap().value()
    });
    for (pixel, &covered) in covered.iter().enumerate() {
        let [own, behind] = [0, 1].map(|k| ones[k].data()[pixel].to_f64());
        prop_assert!(covered <= 1.0 + slack, "{covered} of pixel {pixel}");
        prop_assert!((own - covered).abs() <= slack, "{own} of {covered} in pixel {pixel}");
        prop_assert!((own + behind - 1.0).abs() <= slack, "{own} + {behind} in pixel {pixel}");
    }
    Ok(covered)
}

/// With a wall through the scene, over the whole image: no pixel has anything left for the background.
fn walled(scene: &Scene) -> Scene {
    let mut mesh = scene.mesh.faces().to_vec();
    let first = scene.mesh.vertex_count();
    mesh.push([0, 1, 2].map(|corner| first as u32 + corner));
    let wall = [[-3.0, -3.0, 0.3, 1.0], [9.0, -3.0, 0.3, 1.0], [-3.0, 9.0, 0.3, 1.0]];
    let entries = [scene.clip.data(), wall.as_flattened()].concat();
    let clip = Tensor::new([first + 3, 4], entries).unwrap();
    Scene { mesh: Mesh::new(mesh, first + 3).unwrap(), clip, size: scene.size }
}

/// The same by a sweep, or for many faces by 32 x 32 samples; and how far that may be off.
fn expected(scene: &Scene) -> (Vec<f64>, f64) {
    let Size { width, height } = scene.size;
    let faces = scene.mesh.faces();
    if faces.len() <= 6 {
        let clip: Vec<_> =
            scene.clip.data().chunks_exact(4).map(|p| p.try_into().unwrap()).collect();
        let pixels = (0..width * height).map(|pixel| [pixel % width, pixel / width]);
        let areas = pixels.map(|pixel| visible_areas(&clip, faces, scene.size, pixel));
        return (areas.map(|areas| areas.iter().sum()).collect(), 1e-7);
    }
    const TIMES: usize = 32;
    let tape = Tape::<f64>::new();
    let large = Size { width: TIMES * width, height: TIMES * height };
    let fragments = rasterize(tape.leaf(&scene.clip), &scene.mesh, large).unwrap();
    let mut covered = vec![0.0; width * height];
    for sample in fragments.coverage.pixels() {
        let (column, row) = (sample % large.width / TIMES, sample / large.width / TIMES);
        covered[row * width + column] += 1.0 / (TIMES * TIMES) as f64;
    }
    // A side that runs along a row of samples may be off by all of it, and there are several.
    (covered, 4.0 / TIMES as f64)
}

#[test]
fn pieces_and_background_are_a_partition_of_each_pixel() {
    let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
        .run(&meshes(), |scene| {
            covered::<f32>(&scene, 1e-6)?;
            let found = covered::<f64>(&scene, 1e-12)?;
            let walled = walled(&scene);
            let full =
                [(covered::<f32>(&walled, 1e-6)?, 1e-6), (covered::<f64>(&walled, 1e-12)?, 1e-12)];
            for (covered, slack) in full {
                for (pixel, covered) in covered.into_iter().enumerate() {
                    prop_assert!((covered - 1.0).abs() <= slack, "{covered} of pixel {pixel}");
                }
            }
            let (expected, bound) = expected(&scene);
            for (pixel, (found, expected)) in found.iter().zip(expected).enumerate() {
                let off = (found - expected).abs();
                prop_assert!(off <= bound, "{found} of pixel {pixel}, not {expected}");
            }
            Ok(())
        })
        .unwrap();
}
