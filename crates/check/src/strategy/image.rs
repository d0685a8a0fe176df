//! Images and blurs of them.

use bokashi_core::Tensor;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

/// Images `[height, width, channels]` of up to 9 by 9 pixels and 4 channels; some are a single pixel,
/// row or column. They hold noise, a constant, an impulse in a corner or anywhere, a step, a
/// chessboard, or a range from 1e-6 to 1e6.
pub fn image() -> BoxedStrategy<Tensor<f64>> {
    let extent = || prop_oneof![1 => Just(1_usize), 3 => 2..=9_usize];
    (extent(), extent(), 1..=4_usize)
        .prop_flat_map(|(height, width, channels)| image_of([height, width, channels]))
        .boxed()
}

/// Images of one shape, of the kinds of [`image`].
pub fn image_of(shape: [usize; 3]) -> BoxedStrategy<Tensor<f64>> {
    let [height, width, channels] = shape;
    let size = shape.iter().product::<usize>();
    let from = move |pixel: Box<dyn Fn(usize, usize, usize) -> f64>| {
        Tensor::from_flat_fn(shape, |k| {
            let (pixel_index, channel) = (k / channels, k % channels);
            pixel(pixel_index / width, pixel_index % width, channel)
        })
    };
    let noise = vec(-1.0..1.0, size).prop_map(move |data| Tensor::from_flat_fn(shape, |k| data[k]));
    let level = || -2.0..2.0;
    let constant = level().prop_map(move |level| Tensor::full(shape, level));
    let corner = [select(vec![0, height - 1]), select(vec![0, width - 1])];
    let anywhere = [0..height, 0..width];
    let impulse = prop_oneof![corner.prop_map(|index| index), anywhere.prop_map(|index| index),]
        .prop_map(move |[row, column]| {
            from(Box::new(move |i, j, _| if (i, j) == (row, column) { 1.0 } else { 0.0 }))
        });
    let step = (0..=width, level(), level()).prop_map(move |(column, low, high)| {
        from(Box::new(move |_, j, _| if j < column { low } else { high }))
    });
    let chessboard = level().prop_map(move |level| {
        from(Box::new(move |i, j, c| if (i + j + c) % 2 == 0 { level } else { 0.0 }))
    });
    let wide = vec((-6.0..6.0, any::<bool>()), size).prop_map(move |data| {
        Tensor::from_flat_fn(shape, |k| {
            let (power, negative) = data[k];
            let value = 10.0_f64.powf(power);
            if negative { -value } else { value }
        })
    });
    prop_oneof![4 => noise, 1 => constant, 2 => impulse, 1 => step, 1 => chessboard, 1 => wide]
        .boxed()
}

/// Standard deviations of a blur, in pixels, from 0.05 to 12. Some are so small that a sampled kernel
/// is an impulse. Some are multiples of a quarter, where windows of whole radii step. Some are larger
/// than an image of [`image`].
pub fn sigma() -> BoxedStrategy<f64> {
    prop_oneof![
        4 => 0.3..3.0,
        2 => 0.05..0.3,
        2 => (1..=16_u32).prop_map(|k| 0.25 * f64::from(k)),
        1 => 3.0..12.0,
    ]
    .boxed()
}

#[cfg(test)]
mod tests {
    use super::super::draws;
    use super::*;

    #[test]
    fn images_are_of_every_kind_and_size() {
        let images = draws(image(), 2000);
        let some = |kind: fn(&[usize], &[f64]) -> bool| {
            images.iter().filter(|image| kind(image.shape(), image.data())).count() > 3
        };
        assert!(some(|shape, _| shape[0] == 1 && shape[1] > 1));
        assert!(some(|shape, _| shape[1] == 1 && shape[0] > 1));
        assert!(some(|shape, _| shape[..2] == [1, 1]));
        assert!(some(|_, data| data.len() > 9 && data.iter().all(|x| *x == data[0])));
        assert!(some(|shape, data| {
            shape[2] == 1 && data.len() > 9 && data.iter().sum::<f64>() == 1.0 && data[0] == 1.0
        }));
        assert!(some(|_, data| data.iter().any(|x| x.abs() > 1e4)));
    }

    #[test]
    fn sigmas_hit_the_steps_of_a_radius() {
        let sigmas = draws(sigma(), 300);
        assert!(sigmas.iter().all(|sigma| (0.05..=12.0).contains(sigma)));
        assert!(sigmas.iter().filter(|&&sigma| (4.0 * sigma).fract() == 0.0).count() > 20);
        assert!(sigmas.iter().any(|sigma| *sigma < 0.1) && sigmas.iter().any(|s| *s > 9.0));
    }
}
