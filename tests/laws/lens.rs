//! A lens against the mean of pictures through its points.

use bokashi_catalogue::lens::{Frame, LensScene, Named, UNIT, draw, mean_through, named};
use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::ThinLens;

/// Points of the lens that stand for it, and so many for differences of it.
const POINTS: [usize; 2] = [96, 64];

fn lens_on(tape: &Tape<f64>, [aperture, focus]: [f64; 2]) -> ThinLens<'_, f64> {
    ThinLens { aperture: tape.leaf_scalar(aperture), focus: tape.leaf_scalar(focus) }
}

fn image<'t>(scene: &LensScene, lens: ThinLens<'t, f64>) -> Var<'t, f64> {
    let frame = Frame::new(UNIT);
    let clip = lens.focus.tape().constant(&scene.clip(frame));
    draw(scene, frame, clip, lens).unwrap().image
}

fn truth(scene: &LensScene, numbers: [f64; 2], count: usize) -> Tensor<f64> {
    mean_through(scene, Frame::new(UNIT).without_margin(), numbers, count, 0.0).unwrap()
}

/// The root mean square of the difference, in percent of full intensity.
fn percent_off(found: &Tensor<f64>, truth: &Tensor<f64>) -> f64 {
    let pairs = found.data().iter().zip(truth.data());
    let sum: f64 = pairs.map(|(a, b)| (a - b) * (a - b)).sum();
    100.0 * (sum / found.data().len() as f64).sqrt()
}

#[test]
fn a_lens_sees_the_mean_of_what_its_points_see() {
    for Named { name, scene, numbers, reach } in named() {
        let tape = Tape::new();
        let lens = lens_on(&tape, numbers);
        let image = image(&scene, lens);
        let off = percent_off(&image.value(), &truth(&scene, numbers, POINTS[0]));
        // How the picture moves with aperture and focus, as a share of how the truth moves.
        let moves = [lens.aperture, lens.focus].into_iter().enumerate().map(|(k, leaf)| {
            let [before, after] = [1.0 / 1.03, 1.03].map(|factor| {
                let mut moved = numbers;
                moved[k] *= factor;
                (moved[k], truth(&scene, moved, POINTS[1]))
            });
            let difference = |entry: usize| after.1.data()[entry] - before.1.data()[entry];
            let difference = Tensor::from_flat_fn(before.1.shape(), difference);
            let square: f64 = difference.data().iter().map(|x| x * x).sum();
            let gradients = tape.vjp(&[(image, &difference)]).unwrap();
            gradients.get_or_zeros(leaf).item() * (after.0 - before.0) / square
        });
        let moves: Vec<_> = moves.collect();
        println!("{name}: {off:.3} %, moves {moves:.3?}");
        // Fences and balls miss what they should reach by a twentieth.
        assert!(off <= 1.1 * reach, "{name}: off by {off} %");
        assert!(moves.iter().all(|share| (share - 1.0).abs() < 0.15), "{name}: {moves:?}");
    }
}

#[test]
fn gradients_are_linear_in_the_gradient_of_the_picture() {
    let slope = named().into_iter().find(|scene| scene.name.contains("slanted")).unwrap();
    let tape = Tape::new();
    let lens = lens_on(&tape, slope.numbers);
    let image = image(&slope.scene, lens);
    let motley = |seed: usize| {
        Tensor::from_flat_fn(&*image.shape(), |k| ((k * 7919 + seed) % 1009) as f64 / 504.0 - 1.0)
    };
    let of = |upstream: &Tensor<f64>| {
        let gradients = tape.vjp(&[(image, upstream)]).unwrap();
        [lens.aperture, lens.focus].map(|leaf| gradients.get_or_zeros(leaf).item())
    };
    let (one, other) = (motley(13), motley(400));
    let both = Tensor::from_flat_fn(one.shape(), |k| one.data()[k] + other.data()[k]);
    let [of_one, of_other, of_both] = [&one, &other, &both].map(of);
    for k in 0..2 {
        let off = of_both[k] - of_one[k] - of_other[k];
        let size = of_one[k].abs() + of_other[k].abs();
        assert!(off.abs() <= 1e-12 * (1.0 + size), "{off} of {size}");
    }
    for factor in [2.0_f64.powi(-40), 2.0_f64.powi(40)] {
        assert_eq!(of(&one.map(|entry| entry * factor)), of_one.map(|entry| entry * factor));
    }
    assert_eq!(of(&Tensor::zeros(one.shape())), [0.0; 2]);
}
