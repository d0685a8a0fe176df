use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Fragments, Mesh, RasterOptions, Sampling, Size, antialias, composite, depth,
    eye_depth, interpolate, rasterize,
};
use std::sync::Arc;
use std::thread;

fn fragments(tape: &Tape<f64>) -> (Var<'_, f64>, Fragments<'_, f64>) {
    let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
    let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    (clip, rasterize(clip, &mesh, Size::square(6)).unwrap())
}

/// What every operation makes of fragments, and the gradient of the colours.
fn drawn(fragments: &Fragments<'_, f64>) -> Vec<Tensor<f64>> {
    let tape = fragments.clip.tape();
    let colors = tape.leaf(&Tensor::from([[0.1, 0.5], [0.9, 0.2], [0.4, 0.7]]));
    let eye = eye_depth(fragments).unwrap();
    let surface = interpolate(colors, fragments).unwrap();
    let picture = composite(surface, fragments, Background::Zero).unwrap();
    let image = match fragments.weight {
        None => antialias(picture).unwrap().image().unwrap(),
        Some(_) => picture.image().unwrap(),
    };
    let gradients = image.square().sum().backward().unwrap();
    vec![
        image.value(),
        depth(fragments).unwrap().value(),
        eye.values().value(),
        eye.image(fragments, 5.0).unwrap().distances().value(),
        gradients.get(colors).unwrap().clone(),
    ]
}

#[test]
fn constant_fragments_are_the_same_to_every_operation_on_later_steps_and_other_tapes() {
    for sampling in [Sampling::Center, Sampling::Exact] {
        let mut tape = Tape::new();
        let (constant, expected) = {
            let (clip, whole) = fragments(&tape);
            let options = RasterOptions::new(Size::square(6)).sampling(sampling);
            let fragments = rasterize(clip, whole.coverage.mesh(), options.creases(&[])).unwrap();
            (fragments.constant(), drawn(&fragments))
        };
        for _ in 0..2 {
            tape.reset();
            // What the step before has left is written over, but for what is still held.
            let (clip, whole) = fragments(&tape);
            let options = RasterOptions::new(Size::square(5)).sampling(sampling);
            rasterize(clip * 0.7, whole.coverage.mesh(), options.creases(&[])).unwrap();
            let again = constant.on(&tape);
            assert!(!again.clip.needs_gradient() && !again.barycentrics.needs_gradient());
            assert_eq!(drawn(&again), expected);
        }
        let elsewhere = constant.clone();
        let there = thread::spawn(move || drawn(&elsewhere.on(&Tape::new())));
        assert_eq!(there.join().unwrap(), expected);
        assert!(Arc::ptr_eq(constant.coverage(), &constant.on(&Tape::new()).coverage));
    }
}

#[test]
fn nothing_covers_a_pixel_outside_the_image() {
    let tape = Tape::new();
    let (_, fragments) = fragments(&tape);
    let coverage = &fragments.coverage;
    assert!((0..36).any(|pixel| coverage.fragment_at(pixel).is_some()));
    assert!([36, 37, usize::MAX].iter().all(|&pixel| coverage.fragment_at(pixel).is_none()));
}

#[test]
fn pieces_without_their_weights_are_refused() {
    let tape = Tape::new();
    let (clip, whole) = fragments(&tape);
    let options = RasterOptions::new(Size::square(6)).sampling(Sampling::Exact);
    let exact = rasterize(clip, whole.coverage.mesh(), options.creases(&[])).unwrap();
    let values = tape.leaf(&Tensor::full([exact.coverage.count(), 1], 0.5));
    let pieces = exact.coverage.count() - exact.coverage.centers();
    let lost = Fragments { weight: None, ..exact };
    let error = composite(values, &lost, Background::Zero).unwrap_err().to_string();
    let rule = format!("composite needs a weight for each of the {pieces} pieces");
    assert_eq!(error, format!("{rule} of exact coverage, got none"));
}

#[test]
fn fragments_that_are_not_whole_or_of_another_tape_are_refused_by_every_operation() {
    let (tape, other) = (Tape::new(), Tape::new());
    let (_, whole) = fragments(&tape);
    let count = whole.coverage.count();
    let colors = tape.leaf(&Tensor::full([3, 1], 0.5));
    let values = tape.leaf(&Tensor::full([count, 1], 0.5));
    let messages = |fragments: &Fragments<'_, f64>| {
        [
            interpolate(colors, fragments).map(drop),
            composite(values, fragments, Background::Zero).map(drop),
        ]
        .map(|result| result.unwrap_err().to_string())
    };
    let few =
        Fragments { barycentrics: tape.leaf(&Tensor::zeros([count - 1, 2])), ..whole.clone() };
    let flat = Fragments { clip: tape.leaf(&Tensor::zeros([4, 3])), ..whole.clone() };
    let (_, foreign) = fragments(&other);
    let before = tape.len();
    for (at, operation) in ["interpolate", "composite"].iter().enumerate() {
        assert_eq!(
            messages(&few)[at],
            format!(
                "{operation} needs barycentrics of shape [{count}, 2], got shape [{}, 2]",
                count - 1
            )
        );
        assert_eq!(
            messages(&flat)[at],
            format!("{operation} needs clip positions of shape [3, 4], got shape [4, 3]")
        );
        assert_eq!(
            messages(&foreign)[at],
            format!("{operation} needs variables of one tape, got one of another")
        );
    }
    assert_eq!(tape.len(), before);
    // What is exchanged for its like is accepted.
    let moved = Fragments { clip: whole.clip * 0.5, ..whole };
    assert!(composite(values, &moved, Background::Zero).is_ok());
}
