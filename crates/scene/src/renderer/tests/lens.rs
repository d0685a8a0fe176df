//! Views through a thin lens.

use bokashi_core::{Tape, Tensor};
use bokashi_fit::{Parameter, Parameters};
use bokashi_render_ops::{Border, Filter, downsample};

use super::{draw_text, renderer_of};
use crate::learnables::Values;

/// Two tilted boards, and what the lens has.
fn boards(size: [usize; 2], lens: &str) -> String {
    format!(
        "[[meshes]]\nshape = \"plane\"\nplace = {{ rotation = [0.3, 0, 0, 1], scale = 0.6, translation = [-0.3, 0, 1] }}\n\
         [[meshes]]\nname = \"far\"\nshape = \"plane\"\nplace = {{ rotation = [0, 0.3, 0, 1] }}\n\
         material = {{ base_color = [0.2, 0.5, 0.8] }}\n\
         [[views]]\nname = \"a\"\n[views.camera]\nsize = {size:?}\nangle = 40\nposition = [0.2, 0.3, 4]\n\
         [pipeline]\ntone = \"linear\"\nlens = {{ {lens} }}\n"
    )
}

/// The mean square of the picture of two tilted boards through a lens with these keys, and its gradient by opening
/// and focus, raw.
fn contrast(opening: &str, keys: &str, values: [f32; 2]) -> (f64, [f64; 2]) {
    let lens = format!("{opening} = 1, focus = 1{keys}");
    let text = boards([48, 40], &lens) + "[learn.lens]\nper_view = [\"focus\"]\n";
    let renderer = renderer_of(&text);
    let tape = Tape::new();
    let named = [(opening.to_owned(), values[0]), ("focus/a".to_owned(), values[1])];
    let parameters = named.iter().fold(Parameters::new(), |all, (name, value)| {
        let parameter = Parameter::new(name.clone(), Tensor::scalar(*value)).rate(1.0);
        all.with(parameter).unwrap()
    });
    let variables = parameters.record(&tape);
    let step = Values { tape: &tape, learnt: Some(&variables) };
    let drawn = renderer.draw(&step, 0, 1, false).unwrap();
    let image = renderer.image(&step, &drawn, 1).unwrap();
    let sum = image.value().data().iter().map(|&x| f64::from(x).powi(2)).sum::<f64>();
    let gradients = image.square().sum().backward().unwrap();
    let slopes =
        named.map(|(name, _)| gradients.get_or_zeros(variables.get(&name).unwrap()).item().into());
    (sum, slopes)
}

#[test]
fn gradients_of_a_lens_are_those_of_differences() {
    let more = ", samples = 2, slopes = true";
    for (opening, keys, width) in [
        ("aperture", "", 6.0),
        ("radius", "", 0.25),
        ("aperture", more, 6.0),
        ("radius", more, 0.25),
    ] {
        for focus in [2.4, 3.5] {
            let at = [width, focus];
            let (_, slopes) = contrast(opening, keys, at);
            for k in 0..2 {
                // Slopes step where circles pass rungs: the step is short.
                let step = 1e-4 * at[k];
                let moved = |sign: f32| {
                    let mut at = at;
                    at[k] += sign * step;
                    contrast(opening, keys, at).0
                };
                let quotient = (moved(1.0) - moved(-1.0)) / (2.0 * f64::from(step));
                println!("{opening} {keys} {at:?} {k}: {} {quotient}", slopes[k]);
                assert!(
                    (slopes[k] / quotient - 1.0).abs() < 0.025,
                    "{opening} {keys} {at:?} by {k}"
                );
            }
        }
    }
}

#[test]
fn circles_that_are_cut_are_counted_without_drawing_where_none_can_be() {
    // Half of an aperture at this distance, and at most 64.
    for (aperture, is_cut) in [(120, false), (140, true)] {
        let renderer = renderer_of(&format!(
            "[[meshes]]\nshape = \"plane\"\n[[views]]\nname = \"a\"\n[views.camera]\nsize = [32, 24]\n\
             focal = 30\nposition = [0, 0, 4]\n[pipeline.lens]\naperture = {aperture}\nfocus = 2\n"
        ));
        let tape = Tape::new();
        let capped = renderer.capped(&Values { tape: &tape, learnt: None }, 0).unwrap();
        let done = tape.take_report().operations;
        let is_drawn = done.iter().any(|operation| operation.name == "rasterize");
        assert_eq!((capped > 0, is_drawn), (is_cut, is_cut), "{aperture}");
    }
}

#[test]
fn samples_are_the_pixels_of_a_larger_picture_whose_mean_is_seen() {
    let least = boards([48, 40], "aperture = 6, focus = 3.5");
    let once = draw_text(&least, 1);
    for (samples, more) in [(2, ""), (3, ", slopes = true"), (2, ", surfaces = 0")] {
        for (opening, larger) in [(6.0, "aperture"), (0.25, "radius")] {
            let lens = format!("{larger} = {opening:?}, focus = 3.5{more}, samples = {samples}");
            let found = draw_text(&boards([48, 40], &lens), 1);
            // A radius is a length in the scene, and an aperture one in pixels.
            let opening = if larger == "aperture" { opening * samples as f64 } else { opening };
            let lens = format!("{larger} = {opening:?}, focus = 3.5{more}, largest_radius = 192");
            let large = draw_text(&boards([48 * samples, 40 * samples], &lens), 1);
            let tape = Tape::new();
            let mean = downsample(tape.constant(&large), samples, &Filter::Box, Border::Clamp);
            let off = furthest(&found, &mean.unwrap().value());
            assert!(off < 2e-5, "{samples} {larger}{more}: {off}");
            assert!(furthest(&found, &once) > 0.01, "{samples} {larger}{more}");
        }
    }
    // A smaller image has as many samples a pixel.
    let lens = "focus = 3.5, samples = 2, aperture";
    let off = |aperture: &str, size: [usize; 2], reduce: usize| {
        draw_text(&boards(size, &format!("{lens} = {aperture}")), reduce)
    };
    assert!(furthest(&off("6", [48, 40], 2), &off("3", [24, 20], 1)) < 2e-5);
}

#[test]
fn samples_and_slopes_of_fragments_that_are_kept_are_those_of_new_ones() {
    let lens = "aperture = 6, focus = 3.5, samples = 2, slopes = true";
    let renderer = renderer_of(&boards([48, 40], lens));
    let tape = Tape::new();
    let values = Values { tape: &tape, learnt: None };
    let image = |drawn| renderer.image(&values, &drawn, 1).unwrap().value();
    let first = image(renderer.draw(&values, 0, 1, false).unwrap());
    for step in 0..2 {
        assert_eq!(image(renderer.draw_again(&values, 0, 1, false).unwrap()), first, "{step}");
    }
    let without = draw_text(&boards([48, 40], "aperture = 6, focus = 3.5, samples = 2"), 1);
    let moved = furthest(&first, &without);
    assert!(moved > 1e-3, "{moved}");
}

/// The largest difference of two images.
fn furthest(a: &Tensor<f32>, b: &Tensor<f32>) -> f32 {
    assert_eq!(a.shape(), b.shape());
    a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}
