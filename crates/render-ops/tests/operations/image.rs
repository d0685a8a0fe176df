use crate::fixtures::{SMALL, surface};
use bokashi_core::{Tape, Tensor};
use bokashi_render_ops::{Background, Fragments, Mesh, composite, rasterize};

/// The image by looking up each pixel's fragment.
fn expected(
    fragments: &Fragments<'_, f64>,
    value: impl Fn(usize) -> f64,
    behind: impl Fn(usize) -> f64,
) -> Vec<f64> {
    (0..30)
        .map(|k| match fragments.coverage.fragment_at(k / 2) {
            Some(fragment) => value(2 * fragment + k % 2),
            None => behind(k),
        })
        .collect()
}

#[test]
fn a_pixel_is_its_fragments_value_or_the_background() {
    let tape = Tape::new();
    let (fragments, values) = surface(&tape);
    let color = tape.leaf(&Tensor::new([2], vec![0.25, 0.5]).unwrap());
    let image = tape.leaf(&Tensor::from_flat_fn([3, 5, 2], |k| -(k as f64)));
    for background in [Background::Zero, Background::Color(color), Background::Image(image)] {
        let out = composite(values, &fragments, background).unwrap().image().unwrap().value();
        assert_eq!(*out.shape(), [3, 5, 2].into());
        let behind = |k: usize| match background {
            Background::Zero => 0.0,
            Background::Color(_) => [0.25, 0.5][k % 2],
            Background::Image(_) => -(k as f64),
        };
        assert_eq!(out.data(), expected(&fragments, |k| 100.0 + k as f64, behind));
    }
}

#[test]
fn each_upstream_entry_goes_to_the_fragment_or_to_the_background() {
    let tape = Tape::new();
    let (fragments, values) = surface(&tape);
    let upstream = Tensor::from_flat_fn([3, 5, 2], |k| (k + 1) as f64);
    let at_uncovered = expected(&fragments, |_| 0.0, |k| (k + 1) as f64);
    let at_covered: Vec<_> = fragments
        .coverage
        .pixels()
        .flat_map(|pixel| [2 * pixel + 1, 2 * pixel + 2].map(|entry| entry as f64))
        .collect();
    let color = tape.leaf(&Tensor::zeros([2]));
    let image = tape.leaf(&Tensor::zeros([3, 5, 2]));
    for background in [Background::Zero, Background::Color(color), Background::Image(image)] {
        let out = composite(values, &fragments, background).unwrap().image().unwrap();
        let gradients = tape.vjp(&[(out, &upstream)]).unwrap();
        assert_eq!(gradients.get(values).unwrap().data(), at_covered);
        match background {
            Background::Zero => {}
            Background::Color(color) => {
                let sum = |c: usize| at_uncovered.iter().skip(c).step_by(2).sum::<f64>();
                assert_eq!(gradients.get(color).unwrap().data(), [sum(0), sum(1)]);
            }
            Background::Image(image) => {
                assert_eq!(gradients.get(image).unwrap().data(), at_uncovered);
            }
        }
    }
}

#[test]
fn an_image_that_nothing_covers_is_the_background() {
    let tape = Tape::<f32>::new();
    let clip = tape.leaf(&Tensor::zeros([1, 4]));
    let fragments = rasterize(clip, &Mesh::new(vec![], 1).unwrap(), SMALL).unwrap();
    let values = tape.leaf(&Tensor::zeros([0, 1]));
    let color = tape.leaf(&Tensor::full([1], 0.5));
    let out = composite(values, &fragments, Background::Color(color)).unwrap();
    let out = out.image().unwrap();
    assert_eq!(out.value().data(), [0.5; 15]);
    let gradients = out.sum().backward().unwrap();
    assert_eq!(gradients.get(color).unwrap().data(), [15.0]);
}
