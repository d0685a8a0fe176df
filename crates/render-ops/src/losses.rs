//! The loss of a picture, of a blurred one, and of a dense image: see [`PixelLoss`].
//!
//! Squared errors have operations of their own (`squared_error`, `gaussian_blur`). Other rules are recorded with
//! what is seen at the pixels of a picture. Masked pixels are replaced by constants, before and after.

use std::sync::Arc;

use bokashi_core::{Mask, Scalar, Var, squared_error};

use crate::error::RenderError;
use crate::gaussian_blur::Blurred;
use crate::picture::Picture;
use crate::pixel_loss::{PixelLoss, Rule, checked_width};
use crate::size::Size;

impl<'t, T: Scalar> Picture<'t, T> {
    /// The loss of the whole image, picture and background; returns `[]`.
    ///
    /// Where the background is a constant colour, the same that the loss was made for, no pixel
    /// beside the picture is visited; otherwise the image is made first.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the reference has the picture's size and the background's colour
    /// its channels, and the loss's function returns a row per pixel; and what the function refuses.
    /// What it has recorded by then stays on the tape.
    #[inline(never)]
    pub fn loss(&self, loss: &PixelLoss<T>) -> Result<Var<'t, T>, RenderError> {
        loss.check(self.size(), self.channels())?;
        if !self.is_before(loss.background().data()) {
            return loss.evaluate(self.image()?);
        }
        let mask = loss.mask().map(|mask| {
            let truth: Vec<_> = self.pixels().map(|pixel| mask.data()[pixel]).collect();
            Mask::new([truth.len(), 1], truth)
        });
        let mask = mask.transpose()?;
        match loss.rule() {
            Rule::Squared => {
                let values = loss.replace_masked(self.values, mask.as_ref())?;
                Ok(self.squared_error(values, loss)?)
            }
            Rule::Function(_) => {
                let [reference, others] = self.reference_rows(loss)?;
                Ok(loss.evaluate_rows(self.values, reference, mask.as_ref())?.try_add(others)?)
            }
        }
    }
}

impl<'t, T: Scalar> Blurred<'t, T> {
    /// The loss of the blurred image; returns `[]`. Of a squared error without a mask no image takes memory but
    /// the reference, where [`Blurred::image`] does without the image before the blur. The gradients that could be
    /// asked for are then computed along with the error.
    ///
    /// # Errors
    /// As [`Blurred::image`] and [`PixelLoss::evaluate`].
    #[inline(never)]
    pub fn loss(&self, loss: &PixelLoss<T>) -> Result<Var<'t, T>, RenderError> {
        loss.check(self.picture.size(), self.picture.channels())?;
        match (loss.rule(), loss.mask()) {
            (Rule::Squared, None) if self.is_blurred_by_rows()? => {
                self.squared_error(loss.reference())
            }
            _ => loss.evaluate(self.image()?),
        }
    }
}

impl<T: Scalar> PixelLoss<T> {
    /// The loss of a dense image, `[H, W, C]`; returns `[]`.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the image has the size of the reference and the channels that the loss was
    /// made for, and the loss's function returns a row per pixel; and what the function refuses.
    #[inline(never)]
    pub fn evaluate<'t>(&self, image: Var<'t, T>) -> Result<Var<'t, T>, RenderError> {
        let &[height, width, channels] = &*image.shape() else {
            let rule = "an image of shape [H, W, C]";
            return Err(RenderError::shape("pixel_loss", rule, &image.shape()));
        };
        self.check(Size { width, height }, channels)?;
        let reference = image.tape().constant(self.reference());
        match self.rule() {
            Rule::Squared => {
                let mask = self.mask().map(|mask| mask.reshaped([height, width, 1])).transpose()?;
                Ok(squared_error(self.replace_masked(image, mask.as_ref())?, reference)?)
            }
            Rule::Function(_) => {
                let pixels = height * width;
                let mask = self.mask().map(|mask| mask.reshaped([pixels, 1])).transpose()?;
                let reference = reference.reshape([pixels, self.reference().shape()[2]])?;
                self.evaluate_rows(image.reshape([pixels, channels])?, reference, mask.as_ref())
            }
        }
    }

    /// What is seen, with the background's colour where the mask is false.
    fn replace_masked<'t>(
        &self,
        seen: Var<'t, T>,
        mask: Option<&Mask>,
    ) -> Result<Var<'t, T>, RenderError> {
        let Some(mask) = mask else { return Ok(seen) };
        Ok(mask.select(seen, seen.tape().constant(self.background()))?)
    }

    /// The sum of the function of what is seen, `[n, C]`, and the reference, `[n, R]`, over the rows that count.
    fn evaluate_rows<'t>(
        &self,
        seen: Var<'t, T>,
        reference: Var<'t, T>,
        mask: Option<&Mask>,
    ) -> Result<Var<'t, T>, RenderError> {
        let Rule::Function(function) = self.rule() else { unreachable!("others have operations") };
        let function = Arc::clone(function);
        let losses = function(self.replace_masked(seen, mask)?, reference)?;
        let (rows, width) = (seen.shape()[0], checked_width(losses, seen.shape()[0])?);
        let Some(mask) = mask else { return Ok(losses.sum()) };
        let zero = losses.tape().constant_full([], T::ZERO);
        Ok(mask.select(losses.reshape([rows, width])?, zero)?.sum())
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Mask, Tape, Tensor};

    use super::*;
    use crate::antialias::antialias;
    use crate::background::Background;
    use crate::composite::composite;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;
    use crate::taps::Blur;

    const SIZE: Size = Size { width: 40, height: 33 };

    fn picture<'t>(
        tape: &'t Tape<f64>,
        background: Background<'t, f64>,
    ) -> (Var<'t, f64>, Picture<'t, f64>) {
        let clip = [-0.8, -0.9, 0.0, 1.0, 0.9, -0.7, 0.0, 1.0, 0.1, 0.8, 0.0, 1.0];
        let clip = tape.leaf(&Tensor::new([3, 4], clip.to_vec()).unwrap());
        let mesh = Mesh::new(vec![[0, 1, 2]], 3).unwrap();
        let fragments = rasterize(clip, &mesh, SIZE).unwrap();
        let values =
            Tensor::from_flat_fn([fragments.coverage.count(), 2], |k| (k % 7) as f64 / 7.0);
        let values = tape.leaf(&values);
        (values, antialias(composite(values, &fragments, background).unwrap()).unwrap())
    }

    /// The reference's third channel is a weight.
    fn weighted<'t>(
        seen: Var<'t, f64>,
        reference: Var<'t, f64>,
    ) -> Result<Var<'t, f64>, RenderError> {
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
            let (values, picture) = picture(&tape, background);
            let before = tape.take_report();
            drop(before);
            let found = picture.loss(&loss).unwrap();
            let is_sparse = tape.take_report().left_out.iter().any(|of| of.name == "pixel_loss");
            assert_eq!(is_sparse, at == 0);
            let image = picture.image().unwrap().reshape([SIZE.pixels(), 2]).unwrap();
            let expected = weighted(image, rows).unwrap().sum();
            approx::assert_relative_eq!(found.item(), expected.item(), max_relative = 1e-13);
            let [found, expected] = [found, expected].map(|loss| loss.backward().unwrap());
            for variable in [values, picture.clip] {
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
        let (_, picture) = picture(&tape, Background::Zero);
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
        let mask = Mask::from_fn([SIZE.height, SIZE.width], |[row, column]| {
            (row / 3 + column / 5) % 2 == 0
        });
        let rows = mask.reshaped([SIZE.pixels(), 1]).unwrap();
        let goal =
            Tensor::from_flat_fn([SIZE.height, SIZE.width, 2], |k| match mask.data()[k / 2] {
                true => (k * 13 % 29) as f64 / 29.0,
                false => f64::NAN,
            });
        let tape = Tape::new();
        for background in [Background::Color(tape.constant(&color)), Background::Zero] {
            let (values, whole) = picture(&tape, background);
            // What is drawn there is no number either.
            let drawn = whole.pixels().map(|pixel| mask.data()[pixel]).collect::<Vec<_>>();
            let drawn = Mask::new([drawn.len(), 1], drawn).unwrap();
            let broken = drawn.select(whole.values(), tape.constant_full([], f64::NAN)).unwrap();
            let seen = Picture { values: broken, ..whole.clone() };
            let image = whole.image().unwrap().reshape([SIZE.pixels(), 2]).unwrap();
            let goal_rows = tape.constant(&goal).reshape([SIZE.pixels(), 2]).unwrap();
            let zero = tape.constant_full([], 0.0);
            let [image, goal_rows] = [image, goal_rows].map(|all| rows.select(all, zero).unwrap());
            let expected = (image - goal_rows).square().sum();
            let gradients = expected.backward().unwrap();
            for loss in losses(&goal, &color, &mask) {
                for found in [seen.loss(&loss), loss.evaluate(seen.image().unwrap())] {
                    let found = found.unwrap();
                    approx::assert_relative_eq!(
                        found.item(),
                        expected.item(),
                        max_relative = 1e-13
                    );
                    let found = found.backward().unwrap();
                    for variable in [values, whole.clip] {
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
        let (_, whole) = picture(&tape, Background::Color(tape.constant(&color)));
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
        let (values, sharp) = picture(&tape, Background::Color(tape.constant(&color)));
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
}
