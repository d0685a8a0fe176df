use bokashi_core::{Mask, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Fragments, Mesh, Picture, PixelLoss, RenderError, Size, antialias, composite,
    rasterize,
};

const SIZE: Size = Size { width: 40, height: 33 };

/// A face, and values on it.
fn surface(tape: &Tape<f64>) -> (Fragments<'_, f64>, Var<'_, f64>) {
    let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
    let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let fragments = rasterize(clip, &mesh, SIZE).unwrap();
    let count = fragments.coverage.count();
    let values = Tensor::from_flat_fn([count, 2], |k| (k % 7) as f64 / 7.0);
    (fragments, tape.leaf(&values))
}

fn picture<'t>(
    values: Var<'t, f64>,
    fragments: &Fragments<'t, f64>,
    background: Background<'t, f64>,
) -> Picture<'t, f64> {
    antialias(composite(values, fragments, background).unwrap()).unwrap()
}

/// The reference's third channel is a weight.
fn weighted<'t>(seen: Var<'t, f64>, reference: Var<'t, f64>) -> Result<Var<'t, f64>, RenderError> {
    let difference = seen.try_sub(reference.slice(1, 0..2)?)?;
    Ok((difference.square() + 0.01).sqrt().try_mul(reference.slice(1, 2..3)?)?)
}

fn reference() -> Tensor<f64> {
    Tensor::from_flat_fn([SIZE.height, SIZE.width, 3], |k| (k * 13 % 29) as f64 / 29.0)
}

#[test]
fn a_loss_is_that_of_the_image_whatever_the_background() {
    let color = Tensor::new([2], vec![0.25, 0.75]).unwrap();
    let loss = PixelLoss::new(&reference(), &color, weighted).unwrap();
    let tape = Tape::new();
    let rows = tape.constant(&reference()).reshape([SIZE.pixels(), 3]).unwrap();
    let backgrounds = [
        Background::Color(tape.constant(&color)),
        Background::Color(tape.leaf(&color)),
        Background::Zero,
    ];
    for (at, background) in backgrounds.into_iter().enumerate() {
        let (fragments, values) = surface(&tape);
        let (seen, inputs) = (picture(values, &fragments, background), [fragments.clip, values]);
        let before = tape.take_report();
        drop(before);
        let found = seen.loss(&loss).unwrap();
        let is_sparse = tape.take_report().left_out.iter().any(|of| of.name == "pixel_loss");
        assert_eq!(is_sparse, at == 0);
        let image = seen.image().unwrap().reshape([SIZE.pixels(), 2]).unwrap();
        let expected = weighted(image, rows).unwrap().sum();
        approx::assert_relative_eq!(found.item(), expected.item(), max_relative = 1e-13);
        let [found, expected] = [found, expected].map(|loss| loss.backward().unwrap());
        for variable in inputs {
            let found = found.get_or_zeros(variable);
            let expected = expected.get_or_zeros(variable);
            for (&found, &expected) in found.data().iter().zip(expected.data()) {
                approx::assert_relative_eq!(found, expected, epsilon = 1e-12);
            }
        }
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let color = Tensor::zeros([2]);
    let message = |error: RenderError| error.to_string();
    let error = PixelLoss::new(&Tensor::zeros([4, 5]), &color, weighted).map(drop);
    assert_eq!(
        message(error.unwrap_err()),
        "pixel_loss needs an image of shape [H, W, C], C > 0, got shape [4, 5]"
    );
    let error = PixelLoss::new(&reference(), &color, |seen, _| Ok(seen.sum())).map(drop);
    assert_eq!(
        message(error.unwrap_err()),
        "pixel_loss needs a function that returns 1320 rows for as many pixels, got shape []"
    );
    let tape = Tape::new();
    let (fragments, values) = surface(&tape);
    let picture = picture(values, &fragments, Background::Zero);
    let narrow = PixelLoss::new(&Tensor::zeros([4, 5, 3]), &color, weighted).unwrap();
    assert_eq!(
        message(picture.loss(&narrow).unwrap_err()),
        "pixel_loss needs a reference image of shape [33, 40, R], got shape [4, 5, 3]"
    );
    let other = PixelLoss::new(&reference(), &Tensor::zeros([1]), |x, _| Ok(x)).unwrap();
    assert_eq!(
        message(picture.loss(&other).unwrap_err()),
        "pixel_loss needs a background of shape [2], got shape [1]"
    );
}

/// Sums of squared errors and of a rule of one's own, each with the same numbers.
fn losses(reference: &Tensor<f64>, color: &Tensor<f64>, mask: &Mask) -> [PixelLoss<f64>; 2] {
    let squared = PixelLoss::squared(reference, color).unwrap();
    let by_rule = PixelLoss::new(reference, color, |seen, r| Ok(seen.try_sub(r)?.square()));
    [squared, by_rule.unwrap()].map(|loss| loss.masked(mask).unwrap())
}

#[test]
fn of_masked_pixels_nothing_is_read() {
    let color = Tensor::new([2], vec![0.25, 0.75]).unwrap();
    let mask =
        Mask::from_fn([SIZE.height, SIZE.width], |[row, column]| (row / 3 + column / 5) % 2 == 0);
    let rows = mask.reshaped([SIZE.pixels(), 1]).unwrap();
    let goal = Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| match mask.data()[k / 2] {
        true => (k * 13 % 29) as f64 / 29.0,
        false => f64::NAN,
    });
    let tape = Tape::new();
    for background in [Background::Color(tape.constant(&color)), Background::Zero] {
        let (fragments, values) = surface(&tape);
        let (whole, inputs) = (picture(values, &fragments, background), [fragments.clip, values]);
        // What is drawn there is no number either.
        let drawn = whole.pixels().map(|pixel| mask.data()[pixel]).collect::<Vec<_>>();
        let drawn = Mask::new([drawn.len(), 1], drawn).unwrap();
        let nothing = tape.constant_full([], f64::NAN);
        // The background is one row.
        let seen = whole.map(|rows| match rows.shape()[0] {
            1 => Ok(rows),
            _ => Ok(drawn.select(rows, nothing)?),
        });
        let seen = seen.unwrap();
        let image = whole.image().unwrap().reshape([SIZE.pixels(), 2]).unwrap();
        let goal_rows = tape.constant(&goal).reshape([SIZE.pixels(), 2]).unwrap();
        let zero = tape.constant_full([], 0.0);
        let [image, goal_rows] = [image, goal_rows].map(|all| rows.select(all, zero).unwrap());
        let expected = (image - goal_rows).square().sum();
        let gradients = expected.backward().unwrap();
        for loss in losses(&goal, &color, &mask) {
            for found in [seen.loss(&loss), loss.evaluate(seen.image().unwrap())] {
                let found = found.unwrap();
                approx::assert_relative_eq!(found.item(), expected.item(), max_relative = 1e-13);
                let found = found.backward().unwrap();
                for variable in inputs {
                    let found = found.get_or_zeros(variable);
                    let expected = gradients.get_or_zeros(variable);
                    for (&found, &expected) in found.data().iter().zip(expected.data()) {
                        approx::assert_relative_eq!(found, expected, epsilon = 1e-12);
                    }
                }
            }
        }
    }
    // A mask of a mask has what both have, and all that are masked cost nothing.
    let (fragments, values) = surface(&tape);
    let whole = picture(values, &fragments, Background::Color(tape.constant(&color)));
    for loss in losses(&goal, &color, &mask) {
        let nothing = loss.masked(&!&mask).unwrap();
        assert_eq!(whole.loss(&nothing).unwrap().item(), 0.0);
        let error = loss.masked(&Mask::full([2, 2], true)).unwrap_err().to_string();
        assert_eq!(error, "pixel_loss needs a mask of shape [33, 40], got shape [2, 2]");
    }
}

#[test]
fn the_loss_of_a_blurred_picture_is_that_of_its_image() {
    let tape = Tape::new();
    let color = Tensor::new([2], vec![0.25, 0.75]).unwrap();
    let goal = Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| (k % 17) as f64 / 17.0);
    let sigma = tape.leaf_scalar(1.7);
    let (fragments, values) = surface(&tape);
    let background = Background::Color(tape.constant(&color));
    let sharp = picture(values, &fragments, background);
    let blurred = sharp.blurred(sigma, &Blur::default());
    let whole = Mask::full([SIZE.height, SIZE.width], true);
    for loss in losses(&goal, &color, &whole) {
        let expected = loss.evaluate(blurred.image().unwrap()).unwrap();
        let found = blurred.loss(&loss).unwrap();
        assert_eq!(found.value(), expected.value());
        let [found, expected] = [found, expected].map(|loss| loss.backward().unwrap());
        for variable in [values, sigma] {
            assert_eq!(found.get_or_zeros(variable), expected.get_or_zeros(variable));
        }
    }
}
