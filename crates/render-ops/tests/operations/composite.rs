use crate::fixtures::surface;
use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{Background, Composite, composite};

#[test]
fn a_picture_of_an_image_makes_that_image() {
    let tape = Tape::<f64>::new();
    let (fragments, _) = surface(&tape);
    let image = tape.leaf(&Tensor::from_flat_fn([3, 5, 2], |k| (k as f64).sin()));
    let picture = Composite::from_image(image, &fragments).unwrap();
    assert_eq!(picture.values().shape()[0], fragments.coverage.count());
    let same = picture.image().unwrap();
    assert_eq!(same.value(), image.value());
    let upstream = Tensor::from_flat_fn([3, 5, 2], |k| (k as f64).cos());
    let gradients = tape.vjp(&[(same, &upstream)]).unwrap();
    assert_eq!(gradients.get(image).unwrap(), &upstream);
}

#[test]
fn fragments_at_centres_are_a_picture_as_they_are() {
    let tape = Tape::<f64>::new();
    let (fragments, values) = surface(&tape);
    let sky = Background::Color(tape.leaf(&Tensor::zeros([2])));
    let before = tape.len();
    let picture = composite(values, &fragments, sky).unwrap();
    assert_eq!((tape.len(), picture.values().value()), (before, values.value()));
}
