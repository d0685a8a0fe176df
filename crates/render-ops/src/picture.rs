//! Pictures: the pixels of an image that can differ from its background.
//!
//! Most of an image is often background, and most losses are sums over pixels. A picture holds the
//! values of the pixels that something covers or touches, and the background of all others. So what
//! is computed on a picture costs nothing elsewhere; [`Picture::image`] makes the dense image.
//!
//! [`composite`](crate::composite()) makes a [`Composite`], [`antialias`](crate::antialias()) makes a
//! [`Picture`] of it: the types allow antialiasing once. Neither lets its background be exchanged,
//! since pixels at silhouettes have mixed with it.

use std::ops::Deref;
use std::sync::Arc;

use bokashi_core::{Scalar, Shape, Var};

use crate::background::{Backdrop, Background, Kind};
use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::runs::Run;
use crate::size::Size;

/// A sparse image: the values of the pixels that can differ from a background, and the background.
///
/// # Shapes
/// The values are `[P, C]`. P counts the pixels whose centre is covered, and the *rim*: beside
/// silhouettes, once they are antialiased, the uncovered pixels; with exact coverage the pixels that
/// a discontinuity crosses.
#[derive(Debug, Clone)]
pub struct Picture<'t, T: Scalar> {
    pub(crate) values: Var<'t, T>,
    pub(crate) backdrop: Backdrop<'t, T>,
    /// The clip positions that were rasterized.
    pub(crate) clip: Var<'t, T>,
    pub(crate) coverage: Arc<Coverage>,
    /// The pixels of the rim, in order, where there are any.
    pub(crate) rim: Option<Arc<Vec<u32>>>,
}

/// A [`Picture`] that was not antialiased. It can be used as it is: its silhouettes are then aliased,
/// or exact where the fragments have exact coverage.
#[derive(Debug, Clone)]
pub struct Composite<'t, T: Scalar>(pub(crate) Picture<'t, T>);

impl<'t, T: Scalar> Deref for Composite<'t, T> {
    type Target = Picture<'t, T>;

    fn deref(&self) -> &Picture<'t, T> {
        &self.0
    }
}

impl<'t, T: Scalar> From<Composite<'t, T>> for Picture<'t, T> {
    fn from(composite: Composite<'t, T>) -> Self {
        composite.0
    }
}

impl<'t, T: Scalar> Composite<'t, T> {
    /// [`Picture::map`]; the result can still be antialiased.
    ///
    /// # Errors
    /// As [`Picture::map`].
    pub fn map(
        &self,
        function: impl FnMut(Var<'t, T>) -> Result<Var<'t, T>, RenderError>,
    ) -> Result<Self, RenderError> {
        self.0.map(function).map(Self)
    }
}

impl<'t, T: Scalar> Picture<'t, T> {
    /// The values of the picture's pixels, `[P, C]`, differentiable.
    pub fn values(&self) -> Var<'t, T> {
        self.values
    }

    /// The pixel of each row of the values, `row * width + column`.
    pub fn pixels(&self) -> impl Iterator<Item = usize> + Clone + '_ {
        let centers = self.coverage.centers.runs.iter().flat_map(Run::pixels);
        centers.chain(self.rim().iter().map(|&pixel| pixel as usize))
    }

    /// The background, as it is after every [`Picture::map`].
    pub fn background(&self) -> Background<'t, T> {
        match self.backdrop.kind {
            Kind::Color => Background::Color(self.backdrop.values),
            Kind::Image => Background::Image(self.backdrop.values),
        }
    }

    /// The size of the image.
    pub fn size(&self) -> Size {
        self.coverage.size()
    }

    /// The number of channels, C.
    pub fn channels(&self) -> usize {
        self.values.shape()[1]
    }

    /// The picture of `function` of each pixel: a tone curve, a change of channels, a weight per
    /// channel.
    ///
    /// `function` maps rows of pixels, `[n, C]`, to as many rows, `[n, K]`, each row on its own. It is
    /// called with the picture's values, and once more with the background: one row where that is a
    /// colour, a row for each pixel of the image where it is an image.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless both calls return rows of K > 0 channels, as many as they were
    /// given; and what `function` refuses. What `function` has recorded by then stays on the tape.
    pub fn map(
        &self,
        mut function: impl FnMut(Var<'t, T>) -> Result<Var<'t, T>, RenderError>,
    ) -> Result<Self, RenderError> {
        let values = function(self.values)?;
        let rows = self.values.shape()[0];
        let channels = checked_channels("map", values, rows)?;
        let size = self.coverage.size();
        let Backdrop { values: background, kind } = self.backdrop;
        let (rows, shape) = match kind {
            Kind::Color => (1, Shape::from([channels])),
            Kind::Image => (size.pixels(), Shape::from([size.height, size.width, channels])),
        };
        let background = function(background.reshape([rows, self.channels()])?)?;
        match *background.shape() {
            [given, k] if given == rows && k == channels => {}
            _ => {
                let rule = format!("the background's values of shape [{rows}, {channels}]");
                return Err(RenderError::Shape {
                    operation: "map",
                    rule,
                    shape: background.shape(),
                });
            }
        }
        let backdrop = Backdrop { values: background.reshape(shape)?, kind };
        Ok(Self { values, backdrop, ..self.clone() })
    }

    /// The pixels of the rim, in order.
    pub(crate) fn rim(&self) -> &[u32] {
        self.rim.as_deref().map_or(&[], Vec::as_slice)
    }

    /// Whether the background is a colour that no gradient is asked of, with these entries.
    pub(crate) fn is_before(&self, color: &[T]) -> bool {
        let Backdrop { values, kind } = self.backdrop;
        if kind == Kind::Image || values.needs_gradient() {
            return false;
        }
        let values = values.value();
        values.data().iter().zip(color).all(|(value, other)| value.is_same(*other))
    }
}

/// C of values `[rows, C]`, C > 0.
pub(crate) fn checked_channels<T: Scalar>(
    operation: &'static str,
    values: Var<'_, T>,
    rows: usize,
) -> Result<usize, RenderError> {
    match *values.shape() {
        [given, channels] if given == rows && channels > 0 => Ok(channels),
        _ => {
            let rule = format!("values of shape [{rows}, C], C > 0");
            Err(RenderError::Shape { operation, rule, shape: values.shape() })
        }
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor, hvp, jvp};

    use super::*;
    use crate::antialias::antialias;
    use crate::composite::composite;
    use crate::fragments::Fragments;
    use crate::mesh::Mesh;
    use crate::pixel_loss::PixelLoss;
    use crate::raster_options::{RasterOptions, Sampling};
    use crate::rasterize::rasterize;

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
        let image_bar =
            Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| (k % 7) as f64 - 2.5);
        for sampling in [Sampling::Center, Sampling::Exact, Sampling::Outline] {
            let fragments = fragments(&tape, sampling);
            let values = leaf(&tape, [fragments.coverage.count(), 2]);
            let color = leaf(&tape, [2]);
            let repeated = |k: usize| color.value().data()[k % 2];
            let sky = tape.leaf(&Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], repeated));
            let [by_color, by_image] =
                [Background::Color(color), Background::Image(sky)].map(|background| {
                    let picture = composite(values, &fragments, background).unwrap();
                    let picture = match sampling {
                        Sampling::Center => antialias(picture).unwrap(),
                        Sampling::Exact | Sampling::Outline => picture.into(),
                    };
                    assert!(!picture.rim().is_empty());
                    picture.image().unwrap()
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
        let goal =
            Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| (k * 13 % 29) as f64 / 29.0);
        let constant = Tensor::new([2], vec![0.25, 0.75]).unwrap();
        let zero = Tensor::zeros([2]);
        let constant_color = Background::Color(tape.constant(&constant));
        let learnt = Background::Color(tape.leaf(&constant));
        for sampling in [Sampling::Center, Sampling::Exact, Sampling::Outline] {
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
                    Sampling::Exact | Sampling::Outline => picture.into(),
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

    /// The sum of the channels of the image before `sky`, or of its squared error, each apart.
    fn channels_before<'t, T: Scalar>(sky: Var<'t, T>, sampling: Sampling) -> [Var<'t, T>; 2] {
        let tape = sky.tape();
        let fragments = fragments(tape, sampling);
        let values = tape.constant_full([fragments.coverage.count(), 2], T::from_f64(0.3));
        let picture = composite(values, &fragments, Background::Color(sky)).unwrap();
        let picture = match sampling {
            Sampling::Center => antialias(picture).unwrap(),
            Sampling::Exact | Sampling::Outline => picture.into(),
        };
        let image = picture.image().unwrap();
        let sums = image.reshape([SIZE.pixels(), 2]).unwrap().sum_axis(0).unwrap();
        let goal = Tensor::zeros([SIZE.height, SIZE.width, 2]);
        let reference = PixelLoss::squared(&goal, &Tensor::full([2], T::from_f64(0.5))).unwrap();
        [sums, picture.loss(&reference).unwrap()]
    }

    #[test]
    fn derivatives_along_a_grey_background_are_told_apart_by_channel_and_never_lost() {
        for sampling in [Sampling::Center, Sampling::Exact, Sampling::Outline] {
            let (grey, red) = (Tensor::full([2], 0.5), Tensor::new([2], vec![1.0, 0.0]).unwrap());
            let tape = Tape::<f64>::new();
            let sky = tape.leaf(&grey);
            let [sums, error] = channels_before(sky, sampling);
            let slope = |of: Var<'_, f64>| of.backward().unwrap().get_or_zeros(sky).data()[0];
            let [of_sum, of_error] = [slope(sums.sum()), slope(error)];
            let along = |k: usize| {
                let point = [(&grey, &red)];
                let [_, slope] = jvp(&mut Tape::new(), &point, |x| {
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
        for sampling in [Sampling::Center, Sampling::Exact, Sampling::Outline] {
            let corners = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
            let corners = Tensor::new([3, 4], corners.to_vec()).unwrap();
            let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
            let options = RasterOptions::new(SIZE).sampling(sampling);
            fn image<'t, T: Scalar>(
                clip: Var<'t, T>,
                mesh: &Mesh,
                options: RasterOptions,
            ) -> Var<'t, T> {
                let fragments = rasterize(clip, mesh, options.creases(&[])).unwrap();
                let white = [fragments.coverage.count(), 1];
                let white = clip.tape().constant_full(white, T::ONE);
                let picture = composite(white, &fragments, Background::Zero).unwrap();
                let picture = match options.sampling {
                    Sampling::Center => antialias(picture).unwrap(),
                    Sampling::Exact | Sampling::Outline => picture.into(),
                };
                picture.image().unwrap()
            }
            let tape = Tape::<f64>::new();
            let goal = image(tape.leaf(&corners), &mesh, options).value();
            let along = Tensor::from_flat_fn([3, 4], |k| [1.0, -0.5][k % 2] * ((k / 4) as f64));
            let along = along.map(|entry: f64| 0.1 * entry);
            let products = hvp(&mut Tape::new(), &[(&corners, &along)], |x| {
                let goal = x[0].tape().constant(&goal.cast());
                Ok::<_, RenderError>((image(x[0], &mesh, options) - goal).square().sum())
            });
            let [_, product] = &products.unwrap()[0];
            let gradient = |step: f64| {
                let tape = Tape::<f64>::new();
                let moved = corners.data().iter().zip(along.data()).map(|(x, v)| x + step * v);
                let x = tape.leaf(&Tensor::new([3, 4], moved.collect()).unwrap());
                let loss = (image(x, &mesh, options) - tape.constant(&goal)).square().sum();
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
}
