//! Textures: coarser levels are made once for a scene, or for a step.

use bokashi_core::{Tape, Tensor};
use bokashi_fit::{Parameter, Parameters};

use super::renderer_of;
use crate::learnables::Values;
use crate::renderer::Renderer;

/// A ball with a texture of 16 x 16 texels, so with four coarser levels, before two cameras.
fn ball(filter: &str) -> Renderer {
    let view = |name: &str, position: &str| {
        format!(
            "[[views]]\nname = \"{name}\"\n[views.camera]\nsize = [24, 24]\nangle = 40\nposition = {position}\n"
        )
    };
    renderer_of(&format!(
        "[[meshes]]\nshape = \"sphere\"\nmaterial = {{ texture_size = 16 }}\n[pipeline]\n{filter}\n{}{}",
        view("a", "[0, 0, 4]"),
        view("b", "[3, 1, 5]")
    ))
}

/// How many levels were made since it was last asked.
fn levels_made(tape: &Tape<f32>) -> u64 {
    let operations = tape.take_report().operations;
    operations.iter().filter(|operation| operation.name == "mipmaps").map(|it| it.calls).sum()
}

#[test]
fn levels_of_constant_maps_are_made_once() {
    let renderer = ball("");
    let draw = || {
        let tape = Tape::new();
        let values = Values { tape: &tape, learnt: None };
        let drawn = renderer.draw(&values, 0, 1, false).unwrap();
        (renderer.image(&values, &drawn, 1).unwrap().value(), levels_made(&tape))
    };
    let [(first, made), (second, made_again)] = [draw(), draw()];
    assert_eq!(first, second);
    assert_eq!([made, made_again], [4, 0]);
}

#[test]
fn views_share_the_levels_of_maps_that_are_learnt() {
    // Without coarser levels nothing is shared.
    let anisotropic = "texture_filter = \"anisotropic\"";
    for (filter, levels) in [("", 4), (anisotropic, 4), ("texture_filter = \"bilinear\"", 0)] {
        let renderer = ball(filter);
        let texels = Tensor::from_flat_fn([16, 16, 3], |k| ((k * 37) % 101) as f32 / 101.0);
        let parameters =
            Parameters::new().with(Parameter::new("texture/sphere", texels).rate(1.0)).unwrap();
        let step = |is_shared: bool| {
            let tape = Tape::new();
            let variables = parameters.record(&tape);
            let with = |learnt| Values { tape: &tape, learnt: Some(learnt) };
            let shared = || renderer.share_values(&with(&variables)).unwrap();
            let shared = is_shared.then(shared).flatten();
            let of_views = shared.as_ref().unwrap_or(&variables);
            let images = [0, 1].map(|view| {
                let drawn = renderer.draw(&with(of_views), view, 1, false).unwrap();
                renderer.image(&with(of_views), &drawn, 1).unwrap()
            });
            let made = levels_made(&tape);
            let sums = images.map(|image| image.square().sum());
            let gradients = sums[0].try_add(sums[1]).unwrap().backward().unwrap();
            let texels = variables.get("texture/sphere").unwrap();
            (images.map(|image| image.value()), gradients.get_or_zeros(texels), made)
        };
        let (images, gradient, made) = step(true);
        let (apart, expected, made_apart) = step(false);
        assert_eq!(images, apart);
        assert_eq!([made, made_apart], [levels, 2 * levels], "{filter}");
        let largest = expected.data().iter().fold(0.0, |largest: f32, x| largest.max(x.abs()));
        assert!(largest > 0.1);
        for (found, expected) in gradient.data().iter().zip(expected.data()) {
            assert!((found - expected).abs() <= 1e-6 * largest, "{filter}: {found} {expected}");
        }
    }
}
