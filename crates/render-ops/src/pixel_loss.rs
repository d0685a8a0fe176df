//! Losses that are sums over pixels, of a user's own function.
//!
//! # Forward
//! `L = sum_p f(x_p, r_p)` over all pixels p of the image, with a reference image r. At the pixels of
//! a picture f is recorded with what is seen there. All other pixels see a constant background. The
//! sum over them is made of sums over blocks that are worked out once (`reference`).
//!
//! # Backward
//! The operations of f, at the pixels of the picture.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{
    Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, Tape, Tensor, TensorError, Var, sum,
};

use crate::coverage::Coverage;
use crate::error::RenderError;
use crate::picture::Picture;
use crate::reference::{BLOCK, Blocks, checked_channels};

/// What is summed over pixels: of what is seen, `[n, C]`, and of the reference, `[n, R]`, a row each.
type Function<T> =
    dyn for<'t> Fn(Var<'t, T>, Var<'t, T>) -> Result<Var<'t, T>, RenderError> + Send + Sync;

/// A loss `sum_p f(x_p, r_p)` over the pixels of an image, with a reference image: an absolute
/// error, a robust or a weighted one. Cheap to clone.
///
/// It keeps one number per pixel, beside the reference image. Its function knows no variables of a
/// step: for a loss with a learnable scale take [`Picture::values`] and [`Picture::pixels`].
#[derive(Clone)]
pub struct PixelLoss<T: Scalar>(Arc<Inner<T>>);

struct Inner<T: Scalar> {
    function: Box<Function<T>>,
    reference: Tensor<T>,
    background: Tensor<T>,
    /// Per pixel: f of the background.
    behind: Vec<T>,
    blocks: Blocks<T::Wide>,
}

impl<T: Scalar> fmt::Debug for PixelLoss<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner { reference, background, .. } = &*self.0;
        let (reference, background) = (reference.shape(), background.data());
        f.debug_struct("PixelLoss")
            .field("reference", reference)
            .field("background", &background)
            .finish_non_exhaustive()
    }
}

/// Pixels for which f is worked out at once.
const PIXELS_AT_ONCE: usize = 1 << 14;

impl<T: Scalar> PixelLoss<T> {
    /// The loss against `reference: [H, W, R]` of pictures before a background of one colour,
    /// `background: [C]`.
    ///
    /// `function` maps what is seen, `[n, C]`, and the reference at the same pixels, `[n, R]`, to n
    /// rows, each of them a function of its own two rows alone. The loss is the sum of all entries. A
    /// further channel of the reference can be a weight.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the reference is `[H, W, R]`, the background `[C]`, and what
    /// `function` returns has n rows; and what `function` refuses.
    pub fn new(
        reference: &Tensor<T>,
        background: &Tensor<T>,
        function: impl for<'t> Fn(Var<'t, T>, Var<'t, T>) -> Result<Var<'t, T>, RenderError>
        + Send
        + Sync
        + 'static,
    ) -> Result<Self, RenderError> {
        let references = checked_channels("pixel_loss", reference)?;
        let &[channels] = &**background.shape() else {
            let (rule, shape) = ("a background of shape [C]".to_owned(), background.shape());
            return Err(RenderError::Shape { operation: "pixel_loss", rule, shape: shape.clone() });
        };
        let mut behind = Vec::with_capacity(reference.size() / references);
        let mut tape = Tape::new();
        for rows in reference.data().chunks(PIXELS_AT_ONCE * references) {
            let pixels = rows.len() / references;
            let seen =
                Tensor::from_flat_fn([pixels, channels], |k| background.data()[k % channels]);
            let rows = Tensor::new([pixels, references], rows.to_vec())?;
            let losses = function(tape.constant(&seen), tape.constant(&rows))?;
            let width = checked_width(losses, pixels)?;
            let of_pixel = |row: &[T]| T::narrow(row.iter().map(|entry| entry.widen()).sum());
            let losses = losses.value();
            behind.extend((0..pixels).map(|p| of_pixel(&losses.data()[p * width..][..width])));
            tape.reset();
        }
        let of_block = |block: &[T]| sum::<T>(block.len(), |k| block[k].widen());
        let blocks = Blocks::new(behind.chunks(BLOCK).map(of_block).collect());
        Ok(Self(Arc::new(Inner {
            function: Box::new(function),
            reference: reference.clone(),
            background: background.clone(),
            behind,
            blocks,
        })))
    }
}

/// K of losses of n rows: `[n]` or `[n, K]`.
fn checked_width<T: Scalar>(losses: Var<'_, T>, rows: usize) -> Result<usize, RenderError> {
    match *losses.shape() {
        [given] if given == rows => Ok(1),
        [given, width] if given == rows => Ok(width),
        _ => {
            let rule = format!("a function that returns {rows} rows for as many pixels");
            Err(RenderError::Shape { operation: "pixel_loss", rule, shape: losses.shape() })
        }
    }
}

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
    pub fn loss(&self, loss: &PixelLoss<T>) -> Result<Var<'t, T>, RenderError> {
        let Inner { function, reference, background, .. } = &*loss.0;
        let (size, channels) = (self.coverage.size(), self.channels());
        let refused = |rule: String, shape: &bokashi_core::Shape| {
            Err(RenderError::Shape { operation: "pixel_loss", rule, shape: shape.clone() })
        };
        if reference.shape()[..2] != [size.height, size.width] {
            let rule = format!("a reference image of shape [{}, {}, R]", size.height, size.width);
            return refused(rule, reference.shape());
        }
        if background.size() != channels {
            let rule = format!("a background of shape [{channels}]");
            return refused(rule, background.shape());
        }
        let tape = self.values.tape();
        let references = reference.shape()[2];
        if !self.is_before(background.data()) {
            let rows = size.pixels();
            let image = self.image()?.reshape([rows, channels])?;
            let reference = tape.constant(reference).reshape([rows, references])?;
            let losses = function(image, reference)?;
            checked_width(losses, rows)?;
            return Ok(losses.sum());
        }
        let at = AtPicture {
            coverage: Arc::clone(&self.coverage),
            rim: self.rim.clone(),
            loss: loss.clone(),
        };
        let outputs = tape.record(at, &[])?;
        tape.leave_out("pixel_loss", "pixels of the background: summed with the reference");
        let losses = function(self.values, outputs[0])?;
        checked_width(losses, self.values.shape()[0])?;
        Ok(losses.sum().try_add(outputs[1])?)
    }
}

/// No inputs. Outputs: the reference at the pixels of a picture, `[P, R]`, and the loss of all other
/// pixels, `[]`.
struct AtPicture<T: Scalar> {
    coverage: Arc<Coverage>,
    rim: Option<Arc<Vec<u32>>>,
    loss: PixelLoss<T>,
}

impl<T: Scalar> Op<T> for AtPicture<T> {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "pixel_loss"
    }

    fn forward(
        &self,
        _inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let Inner { reference, behind, blocks, .. } = &*self.loss.0;
        let (coverage, channels) = (&*self.coverage, reference.shape()[2]);
        let rim = self.rim.as_deref().map_or(&[][..], Vec::as_slice);
        let entries = |pixels: Range<usize>| pixels.start * channels..pixels.end * channels;
        let rows = outputs.push([coverage.centers() + rim.len(), channels]);
        let (own, of_rim) = rows.split_at_mut(coverage.centers() * channels);
        for run in &coverage.centers.runs {
            let from = &reference.data()[entries(run.pixels())];
            own[entries(run.fragments())].copy_from_slice(from);
        }
        for (row, &pixel) in of_rim.chunks_exact_mut(channels).zip(rim) {
            row.copy_from_slice(&reference.data()[pixel as usize * channels..][..channels]);
        }
        let mut total = T::Wide::ZERO;
        let few = |pixels: Range<usize>| behind[pixels].iter().map(|loss| loss.widen()).sum();
        coverage.for_each_gap(rim, |gap| total += blocks.sum(gap, few));
        outputs.push([])[0] = T::narrow(total);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(&self, _: &Kept<'_, T>, _: &mut (), _: &mut Accumulators<'_, T>) {
        // It has no input.
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::antialias::antialias;
    use crate::background::Background;
    use crate::composite::composite;
    use crate::mesh::Mesh;
    use crate::rasterize::rasterize;
    use crate::size::Size;

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
}
