//! Derivatives of pictures of two orders, along silhouettes and backgrounds.

use bokashi_core::{Dual, Scalar, Tape, Tensor, Var, hvp, jvp};
use bokashi_render_ops::{
    Background, Mesh, Picture, PixelLoss, RasterOptions, RenderError, Sampling, Size, antialias,
    composite, rasterize,
};

const SIZE: Size = Size { width: 24, height: 17 };

const CORNERS: [f64; 12] = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];

/// A face of vertices at `clip` whose channels are all `value`, before a background.
fn face_before<'t, T: Scalar>(
    clip: Var<'t, T>,
    value: f64,
    channels: usize,
    background: Background<'t, T>,
    sampling: Sampling,
) -> Picture<'t, T> {
    let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
    let options = RasterOptions::new(SIZE).sampling(sampling);
    let fragments = rasterize(clip, &mesh, options.creases(&[])).unwrap();
    let shape = [fragments.coverage.count(), channels];
    let values = clip.tape().constant_full(shape, T::from_f64(value));
    let picture = composite(values, &fragments, background).unwrap();
    match sampling {
        Sampling::Center => antialias(picture).unwrap(),
        Sampling::Exact => picture.into(),
    }
}

/// The sum of the channels of the image before `sky`, or of its squared error, each apart.
fn channels_before<'t, T: Scalar>(sky: Var<'t, T>, sampling: Sampling) -> [Var<'t, T>; 2] {
    let clip = Tensor::from_flat_fn([3, 4], |k| T::from_f64(CORNERS[k]));
    let clip = sky.tape().leaf(&clip);
    let picture = face_before(clip, 0.3, 2, Background::Color(sky), sampling);
    let image = picture.image().unwrap();
    let sums = image.reshape([SIZE.pixels(), 2]).unwrap().sum_axis(0).unwrap();
    let goal = Tensor::zeros([SIZE.height, SIZE.width, 2]);
    let reference = PixelLoss::squared(&goal, &Tensor::full([2], T::from_f64(0.5))).unwrap();
    [sums, picture.loss(&reference).unwrap()]
}

#[test]
fn derivatives_along_a_grey_background_are_told_apart_by_channel_and_never_lost() {
    for sampling in [Sampling::Center, Sampling::Exact] {
        let (grey, red) = (Tensor::full([2], 0.5), Tensor::new([2], vec![1.0, 0.0]).unwrap());
        let tape = Tape::<f64>::new();
        let sky = tape.leaf(&grey);
        let [sums, error] = channels_before(sky, sampling);
        let slope = |of: Var<'_, f64>| of.backward().unwrap().get_or_zeros(sky).data()[0];
        let [of_sum, of_error] = [slope(sums.sum()), slope(error)];
        let along = |k: usize| {
            let point = [(&grey, &red)];
            let [_, slope] = jvp(&mut Tape::<Dual<f64>>::new(), &point, |x| {
                Ok::<_, RenderError>(channels_before(x[0], sampling)[k])
            })
            .unwrap();
            slope.data().to_vec()
        };
        assert!(of_sum > 10.0 && of_error > 10.0);
        let found = along(0);
        approx::assert_relative_eq!(found[0], of_sum, max_relative = 1e-12);
        assert_eq!(found[1], 0.0);
        approx::assert_relative_eq!(along(1)[0], of_error, max_relative = 1e-12);
    }
}

#[test]
fn at_a_perfect_fit_silhouettes_have_their_curvature() {
    for sampling in [Sampling::Center, Sampling::Exact] {
        let corners = Tensor::new([3, 4], CORNERS.to_vec()).unwrap();
        fn image<T: Scalar>(clip: Var<'_, T>, sampling: Sampling) -> Var<'_, T> {
            face_before(clip, 1.0, 1, Background::Zero, sampling).image().unwrap()
        }
        let tape = Tape::<f64>::new();
        let goal = image(tape.leaf(&corners), sampling).value();
        let along = Tensor::from_flat_fn([3, 4], |k| [1.0, -0.5][k % 2] * ((k / 4) as f64));
        let along = along.map(|entry: f64| 0.1 * entry);
        let products = hvp(&mut Tape::new(), &[(&corners, &along)], |x| {
            let goal = x[0].tape().constant(&goal.cast());
            Ok::<_, RenderError>((image(x[0], sampling) - goal).square().sum())
        });
        let [_, product] = &products.unwrap()[0];
        let gradient = |step: f64| {
            let tape = Tape::<f64>::new();
            let moved = corners.data().iter().zip(along.data()).map(|(x, v)| x + step * v);
            let x = tape.leaf(&Tensor::new([3, 4], moved.collect()).unwrap());
            let loss = (image(x, sampling) - tape.constant(&goal)).square().sum();
            loss.backward().unwrap().get_or_zeros(x)
        };
        let h = 1e-5;
        let (forth, back) = (gradient(h), gradient(-h));
        let quotients = forth.data().iter().zip(back.data()).map(|(f, b)| (f - b) / (2.0 * h));
        assert!(product.data().iter().any(|entry| entry.abs() > 1.0), "{product:?}");
        for (&found, expected) in product.data().iter().zip(quotients) {
            approx::assert_relative_eq!(found, expected, epsilon = 1e-4, max_relative = 1e-4);
        }
    }
}
