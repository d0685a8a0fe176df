//! Pictures that are empty, cover all, or have a single pixel.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{
    Background, PixelLoss, Size, antialias, composite, interpolate, rasterize,
};

use crate::clip_scene::ClipScene;
use crate::extreme::{Extreme, Outcome, Verdict, extremes};
use crate::measures::{difference, motley, numbers, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    66 "pictures of any size", "the image's picture and error", against_the_image;
};

fn against_the_image<T: Scalar>() -> Outcome {
    let (mut wrong, mut error) = (0, 0.0_f64);
    let mut counts = Vec::new();
    for [width, height] in [[1, 1], [1, 40], [23, 1], [24, 17], [300, 120]] {
        let size = Size { width, height };
        // Beside the image, all over it, and over some of it.
        for [shift, reach] in [[9.0, 1.0], [0.0, 9.0], [0.0, 0.7]] {
            let corners = [[-1.0, -1.0], [1.3, -0.8], [-0.2, 1.0]];
            let clip = corners.map(|[x, y]| [reach * x + shift, reach * y, 0.1, 1.0]);
            let scene = ClipScene::new(&clip, &[[0, 1, 2]], size);
            let tape = Tape::<T>::new();
            let positions = scene.leaf(&tape);
            let colors = tape.leaf(&Tensor::from_flat_fn([3, 2], |k| T::from_f64(motley(k))));
            let goal = Tensor::from_flat_fn([height, width, 2], |k| T::from_f64(motley(3 * k + 1)));
            let behind = Tensor::from_flat_fn([2], |k| T::from_f64(motley(k + 7)));
            let reference = PixelLoss::squared(&goal, &behind)?;
            let sky = Tensor::from_flat_fn([height, width, 2], |k| behind.data()[k % 2]);

            let fragments = rasterize(positions, &scene.mesh()?, size)?;
            let surface = interpolate(colors, &fragments)?;
            let before = |background| antialias(composite(surface, &fragments, background)?);
            let sparse = before(Background::Color(tape.constant(&behind)))?;
            let dense = before(Background::Image(tape.constant(&sky)))?.image()?;
            wrong += usize::from(sparse.image()?.value() != dense.value());
            counts.push(fragments.coverage.count());

            let found = sparse.loss(&reference)?;
            let expected = (dense - tape.constant(&goal)).square().sum();
            let [loss, exact] = [found, expected].map(|loss| loss.item().to_f64());
            error = error.maximum_or_nan((loss / exact - 1.0).abs());
            let [found, expected] = [found.backward()?, expected.backward()?];
            for leaf in [positions, colors] {
                let expected = numbers(&expected.get_or_zeros(leaf));
                let scale = expected.iter().fold(1.0_f64, |most, bar| most.max(bar.abs()));
                let off = difference(&numbers(&found.get_or_zeros(leaf)), &expected);
                error = error.maximum_or_nan(off / scale);
            }
        }
    }
    let [some, all] = [counts.contains(&0), counts.contains(&36_000)];
    Ok(Verdict::within("the same picture, error and gradients", error, 64.0 * rounding::<T>())
        .and(wrong == 0, format!("{wrong} pictures are others"))
        .and(some && all, "no picture is empty, or none covers all"))
}
