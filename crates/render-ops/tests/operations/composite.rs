use crate::fixtures::surface;
use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{Background, composite};

#[test]
fn fragments_at_centres_are_a_picture_as_they_are() {
    let tape = Tape::<f64>::new();
    let (fragments, values) = surface(&tape);
    let sky = Background::Color(tape.leaf(&Tensor::zeros([2])));
    let before = tape.len();
    let picture = composite(values, &fragments, sky).unwrap();
    assert_eq!((tape.len(), picture.values().value()), (before, values.value()));
}
