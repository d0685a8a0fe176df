//! Antialiasing is the sum of the blends of its definition.

use std::cell::Cell;

use bokashi_catalogue::blends;
use bokashi_catalogue::scenes::{Scene, motley, scenes};
use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{antialias_image, rasterize};
use proptest::prelude::*;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};

#[test]
fn antialias_is_the_sum_of_the_blends_of_its_definition() {
    let config = ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) };
    for (kind, scenes) in scenes() {
        let count = Cell::new(0);
        TestRunner::new_with_rng(config.clone(), TestRng::deterministic_rng(RngAlgorithm::ChaCha))
            .run(&scenes, |Scene { mesh, clip, size }| {
                let tape = Tape::<f64>::new();
                let clip = tape.leaf(&clip);
                let fragments = rasterize(clip, &mesh, size).unwrap();
                let image = Tensor::from_flat_fn([size.height, size.width, 1], motley);
                let out = antialias_image(tape.leaf(&image), &fragments).unwrap().value();
                // Shares that add up to more than 1 are divided by their sum.
                let mut moved = vec![[0.0; 2]; image.data().len()];
                for blend in blends::blends(&fragments, &clip.value()) {
                    let [first, second] = blend.pair;
                    let target = if blend.alpha > 0.0 { first } else { second };
                    moved[target][0] += blend.alpha.abs();
                    moved[target][1] += blend.alpha * (image.data()[second] - image.data()[first]);
                    count.set(count.get() + 1);
                }
                let expected = image.data().iter().zip(moved);
                let expected = expected.map(|(value, [sum, step])| value + step / sum.max(1.0));
                for (found, expected) in out.data().iter().zip(expected) {
                    prop_assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
                }
                Ok(())
            })
            .unwrap();
        println!("{kind}: {} blends", count.get());
        assert!(count.get() > 20, "{kind}: {} blends", count.get());
    }
}
