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
