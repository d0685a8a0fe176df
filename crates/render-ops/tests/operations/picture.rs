use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Fragments, Mesh, PixelLoss, RasterOptions, Sampling, Size, antialias, composite,
    rasterize,
};

const SIZE: Size = Size { width: 24, height: 17 };

/// Two faces, one in front of the other, both with silhouettes.
fn fragments<T: Scalar>(tape: &Tape<T>, sampling: Sampling) -> Fragments<'_, T> {
    let clip = [
        [-0.9, -0.8, 0.2, 1.0],
        [0.7, -0.6, 0.3, 1.1],
        [-0.1, 0.9, 0.1, 0.9],
        [0.9, 0.7, 0.0, 1.2],
        [-0.3, 0.1, -0.2, 1.0],
        [0.2, -0.7, 0.1, 1.0],
    ];
    let clip = tape.leaf(&Tensor::from_flat_fn([6, 4], |k| T::from_f64(clip[k / 4][k % 4])));
    let mesh = Mesh::new(vec![[0, 1, 2], [3, 4, 5]], 6).unwrap();
    rasterize(clip, &mesh, RasterOptions::new(SIZE).sampling(sampling).creases(&[])).unwrap()
}

fn leaf<'t, T: Scalar, const N: usize>(tape: &'t Tape<T>, axes: [usize; N]) -> Var<'t, T> {
    tape.leaf(&Tensor::from_flat_fn(axes, |k| T::from_f64((k * 37 % 101) as f64 / 101.0)))
}

fn backgrounds<T: Scalar>(tape: &Tape<T>) -> [Background<'_, T>; 3] {
    let color = leaf(tape, [2]);
    let image = leaf(tape, [SIZE.height, SIZE.width, 2]);
    [Background::Zero, Background::Color(color), Background::Image(image)]
}

fn variable<'t>(background: Background<'t, f64>) -> Option<Var<'t, f64>> {
    match background {
        Background::Zero => None,
        Background::Color(variable) | Background::Image(variable) => Some(variable),
    }
}

fn assert_all_close(found: &Tensor<f64>, expected: &Tensor<f64>) {
    assert_eq!(found.shape(), expected.shape());
    for (&found, &expected) in found.data().iter().zip(expected.data()) {
        approx::assert_relative_eq!(found, expected, epsilon = 1e-12, max_relative = 1e-13);
    }
}

#[test]
fn a_colour_is_the_background_that_an_image_of_it_is() {
    let tape = Tape::<f64>::new();
    let image_bar = Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| (k % 7) as f64 - 2.5);
    for sampling in [Sampling::Center, Sampling::Exact] {
        let fragments = fragments(&tape, sampling);
        let values = leaf(&tape, [fragments.coverage.count(), 2]);
        let color = leaf(&tape, [2]);
        let repeated = |k: usize| color.value().data()[k % 2];
        let sky = tape.leaf(&Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], repeated));
        let [by_color, by_image] =
            [Background::Color(color), Background::Image(sky)].map(|background| {
                let picture = composite(values, &fragments, background).unwrap();
                let without = picture.image().unwrap().value();
                let picture = match sampling {
                    Sampling::Center => antialias(picture).unwrap(),
                    Sampling::Exact => picture.into(),
                };
                let image = picture.image().unwrap();
                let has_blended =
                    image.value() != without || fragments.coverage.boundary().count() > 0;
                assert!(has_blended);
                image
            });
        assert_eq!(by_color.value(), by_image.value());
        let found = tape.vjp(&[(by_color, &image_bar)]).unwrap();
        let expected = tape.vjp(&[(by_image, &image_bar)]).unwrap();
        for variable in [values, fragments.clip] {
            assert_eq!(found.get_or_zeros(variable), expected.get_or_zeros(variable));
        }
        let of_sky = expected.get_or_zeros(sky);
        let sums = |c: usize| of_sky.data().iter().skip(c).step_by(2).sum();
        assert_all_close(&found.get_or_zeros(color), &Tensor::from_flat_fn([2], sums));
    }
}

#[test]
fn the_pixels_of_a_picture_are_those_of_its_values() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Sampling::Center);
    let values = leaf(&tape, [fragments.coverage.count(), 2]);
    let picture = composite(values, &fragments, Background::Zero).unwrap();
    let picture = antialias(picture).unwrap();
    let (image, values) = (picture.image().unwrap().value(), picture.values().value());
    let mut seen = vec![false; SIZE.pixels()];
    for (pixel, value) in picture.pixels().zip(values.data().chunks(2)) {
        assert_eq!(&image.data()[2 * pixel..][..2], value);
        assert!(!std::mem::replace(&mut seen[pixel], true));
    }
    assert_eq!(picture.pixels().count(), values.shape()[0]);
    let others = seen.iter().zip(image.data().chunks(2)).filter(|(seen, _)| !**seen);
    assert!(others.into_iter().all(|(_, value)| value == [0.0, 0.0]));
}

#[test]
fn the_squared_error_is_that_of_the_image_whatever_the_background() {
    let tape = Tape::<f64>::new();
    let goal = Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| (k * 13 % 29) as f64 / 29.0);
    let constant = Tensor::new([2], vec![0.25, 0.75]).unwrap();
    let zero = Tensor::zeros([2]);
    let constant_color = Background::Color(tape.constant(&constant));
    let learnt = Background::Color(tape.leaf(&constant));
    for sampling in [Sampling::Center, Sampling::Exact] {
        let fragments = fragments(&tape, sampling);
        let values = leaf(&tape, [fragments.coverage.count(), 2]);
        for (background, color) in backgrounds(&tape)
            .map(|background| (background, &zero))
            .into_iter()
            .chain(
                [constant_color, learnt, Background::Zero]
                    .map(|background| (background, &constant)),
            )
            .chain([(constant_color, &zero)])
        {
            let reference = PixelLoss::squared(&goal, color).unwrap();
            let picture = composite(values, &fragments, background).unwrap();
            let picture = match sampling {
                Sampling::Center => antialias(picture).unwrap(),
                Sampling::Exact => picture.into(),
            };
            let found = picture.loss(&reference).unwrap();
            let difference = picture.image().unwrap() - tape.constant(&goal);
            let expected = difference.square().sum();
            approx::assert_relative_eq!(found.item(), expected.item(), max_relative = 1e-13);
            let [found, expected] = [found, expected].map(|loss| loss.backward().unwrap());
            let variables = [Some(values), Some(fragments.clip), variable(background)];
            for variable in variables.into_iter().flatten() {
                let expected = expected.get_or_zeros(variable);
                assert_all_close(&found.get_or_zeros(variable), &expected);
            }
        }
    }
}

#[test]
fn a_function_of_a_picture_is_one_of_its_image() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Sampling::Center);
    let values = leaf(&tape, [fragments.coverage.count(), 2]);
    // Three channels from two.
    let mix = leaf(&tape, [2, 3]);
    for background in backgrounds(&tape) {
        let picture = composite(values, &fragments, background).unwrap();
        let picture = antialias(picture).unwrap();
        let mapped = picture.map(|seen| Ok(seen.exp().matmul(mix)?)).unwrap();
        assert_eq!(mapped.channels(), 3);
        let rows = picture.image().unwrap().reshape([SIZE.pixels(), 2]).unwrap();
        let expected = rows.exp().matmul(mix).unwrap();
        let image = mapped.image().unwrap();
        assert_eq!(image.value().data(), expected.value().data());
        let losses = [image, expected].map(|image| image.square().sum().backward().unwrap());
        let variables = [Some(values), Some(fragments.clip), Some(mix), variable(background)];
        for variable in variables.into_iter().flatten() {
            let [found, expected] = losses.each_ref().map(|l| l.get_or_zeros(variable));
            assert_all_close(&found, &expected);
        }
    }
}

#[test]
fn a_function_before_antialiasing_is_one_of_what_is_blended() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Sampling::Center);
    let values = leaf(&tape, [fragments.coverage.count(), 2]);
    let sky = Background::Color(leaf(&tape, [2]));
    let whole = composite(values, &fragments, sky).unwrap();
    let before = whole.map(|seen| Ok(seen * 2.0)).unwrap();
    let after = antialias(whole).unwrap().map(|seen| Ok(seen * 2.0)).unwrap();
    let [before, after] =
        [antialias(before).unwrap(), after].map(|picture| picture.image().unwrap().value());
    assert_eq!(before, after);
}

#[test]
fn a_function_that_does_not_fit_is_refused() {
    let tape = Tape::<f64>::new();
    let fragments = fragments(&tape, Sampling::Center);
    let values = leaf(&tape, [fragments.coverage.count(), 2]);
    let picture = composite(values, &fragments, Background::Zero).unwrap();
    let count = fragments.coverage.count();
    let error = picture.map(|seen| Ok(seen.sum())).unwrap_err().to_string();
    assert_eq!(error, format!("map needs values of shape [{count}, C], C > 0, got shape []"));
    let narrow = picture.map(|seen| match seen.shape()[0] {
        1 => Ok(seen.slice(1, 0..1)?),
        _ => Ok(seen),
    });
    let error = narrow.unwrap_err().to_string();
    let rule = "map needs the background's values of shape [1, 2]";
    assert_eq!(error, format!("{rule}, got shape [1, 1]"));
}

#[test]
fn without_silhouettes_antialiasing_leaves_the_picture_itself() {
    let tape = Tape::<f32>::new();
    // A face that covers all pixels: no silhouette is in sight.
    let clip = [[-1.0, -1.0, 0.0, 1.0], [3.0, -1.0, 0.0, 1.0], [-1.0, 3.0, 0.0, 1.0]];
    let clip = tape.leaf(&Tensor::from_flat_fn([3, 4], |k| clip[k / 4][k % 4]));
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let fragments = rasterize(clip, &mesh, SIZE).unwrap();
    let values = leaf(&tape, [SIZE.pixels(), 1]);
    let whole = composite(values, &fragments, Background::Zero).unwrap();
    let same = antialias(whole.clone()).unwrap();
    assert_eq!(same.values().value(), values.value());
    let report = tape.take_report();
    assert!(report.left_out.iter().any(|entry| entry.name == "antialias"));
    assert_eq!(same.image().unwrap().value(), whole.image().unwrap().value());
}
