//! Losses that are sums over the pixels of an image.
//!
//! # Forward
//! `L = sum_p f(x_p, r_p)` over all pixels p, with a reference image r. It is the sum over the pixels of a picture
//! and the sum over all others, where the background is seen. The second sum changes with the silhouettes
//! alone. It is made of sums over blocks of pixels, which are worked out once.

use std::fmt;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use bokashi_core::{Mask, Scalar, Tape, Tensor, Var, sum};

use crate::error::RenderError;
use crate::size::Size;

/// A loss `sum_p f(x_p, r_p)` over the pixels of an image, with a reference image: a squared error, or one by a
/// rule of your own, absolute, robust or weighted. Cheap to clone.
///
/// [`Picture::loss`](crate::Picture::loss) is the loss of a picture, [`Blurred::loss`](crate::Blurred::loss) that
/// of a blurred one, and [`PixelLoss::evaluate`] that of a dense image. Beside the reference image a squared error
/// keeps a number for every 16 pixels, another rule one for each.
#[derive(Clone)]
pub struct PixelLoss<T: Scalar>(Arc<Inner<T>>);

struct Inner<T: Scalar> {
    rule: Rule<T>,
    /// `[H, W, R]`. Where the mask is false, it is the background under a squared error, else zero.
    reference: Tensor<T>,
    /// `[C]`.
    background: Tensor<T>,
    /// Of squared errors: the background of [`BLOCK`] pixels.
    backgrounds: Vec<T>,
    /// `[H, W]`.
    mask: Option<Mask>,
    /// Per pixel f of the background; of squared errors none.
    behind: Vec<T>,
    /// Of squared errors made when they are asked for: a blurred picture has no background.
    blocks: OnceLock<Blocks<T::Wide>>,
}

/// What is summed over pixels: of what is seen, `[n, C]`, and of the reference, `[n, R]`, a row each.
type Function<T> =
    dyn for<'t> Fn(Var<'t, T>, Var<'t, T>) -> Result<Var<'t, T>, RenderError> + Send + Sync;

/// What is summed over pixels.
#[derive(Clone)]
pub(crate) enum Rule<T: Scalar> {
    Squared,
    Function(Arc<Function<T>>),
}

impl<T: Scalar> fmt::Debug for PixelLoss<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Inner { reference, background, mask, .. } = &*self.0;
        f.debug_struct("PixelLoss")
            .field("reference", reference.shape())
            .field("background", &background.data())
            .field("is_masked", &mask.is_some())
            .finish_non_exhaustive()
    }
}

/// Pixels for which f is worked out at once.
const PIXELS_AT_ONCE: usize = 1 << 14;

const NAME: &str = "pixel_loss";

impl<T: Scalar> PixelLoss<T> {
    /// The sum of the squared errors against `reference: [H, W, C]` of pictures before a background of one
    /// colour, `background: [C]`.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the reference is `[H, W, C]` and the background `[C]`, C > 0.
    #[inline(never)]
    pub fn squared(reference: &Tensor<T>, background: &Tensor<T>) -> Result<Self, RenderError> {
        let channels = checked_channels(NAME, reference)?;
        if **background.shape() != [channels] {
            let rule = format!("a background of shape [{channels}]");
            return Err(RenderError::shape(NAME, rule, background.shape()));
        }
        Self::with_rule(Rule::Squared, reference.clone(), background.clone(), None)
    }

    /// The loss by a rule of your own, against `reference: [H, W, R]` of pictures before a background of one
    /// colour, `background: [C]`.
    ///
    /// `function` maps what is seen, `[n, C]`, and the reference at the same pixels, `[n, R]`, to n
    /// rows, each of them a function of its own two rows alone. The loss is the sum of all entries. A
    /// further channel of the reference can be a weight. The function knows no variables of a step: for a loss
    /// with a learnable scale take [`Picture::values`](crate::Picture::values) and
    /// [`Picture::pixels`](crate::Picture::pixels).
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
        checked_channels(NAME, reference)?;
        if background.shape().len() != 1 {
            let rule = "a background of shape [C]";
            return Err(RenderError::shape(NAME, rule, background.shape()));
        }
        let rule = Rule::Function(Arc::new(function));
        Self::with_rule(rule, reference.clone(), background.clone(), None)
    }

    /// The same loss of the pixels at which `mask: [H, W]` is true. Of the others nothing is read: neither NaN nor
    /// infinity comes through.
    ///
    /// # Errors
    /// [`RenderError::Shape`] for a mask of another shape.
    pub fn masked(&self, mask: &Mask) -> Result<Self, RenderError> {
        let Inner { rule, reference, background, mask: before, .. } = &*self.0;
        let [height, width] = [reference.shape()[0], reference.shape()[1]];
        if **mask.shape() != [height, width] {
            let rule = format!("a mask of shape [{height}, {width}]");
            return Err(RenderError::shape(NAME, rule, mask.shape()));
        }
        let mask = before.as_ref().map_or_else(|| Ok(mask.clone()), |before| before.and(mask))?;
        let channels = reference.shape()[2];
        let unseen = |channel: usize| match rule {
            Rule::Squared => background.data()[channel],
            Rule::Function(_) => T::ZERO,
        };
        let reference = Tensor::from_flat_fn(reference.shape(), |k| {
            if mask.data()[k / channels] { reference.data()[k] } else { unseen(k % channels) }
        });
        Self::with_rule(rule.clone(), reference, background.clone(), Some(mask))
    }

    fn with_rule(
        rule: Rule<T>,
        reference: Tensor<T>,
        background: Tensor<T>,
        mask: Option<Mask>,
    ) -> Result<Self, RenderError> {
        let (backgrounds, behind) = match &rule {
            Rule::Squared => (background.data().repeat(BLOCK), Vec::new()),
            Rule::Function(f) => {
                (Vec::new(), behind(&**f, &reference, &background, mask.as_ref())?)
            }
        };
        let blocks = OnceLock::new();
        let inner = Inner { rule, reference, background, backgrounds, mask, behind, blocks };
        Ok(Self(Arc::new(inner)))
    }

    /// The reference image, `[H, W, R]`.
    pub fn reference(&self) -> &Tensor<T> {
        &self.0.reference
    }

    /// The reference image, given up; `None` where there is another clone of this loss.
    pub fn into_reference(self) -> Option<Tensor<T>> {
        Arc::into_inner(self.0).map(|inner| inner.reference)
    }

    pub(crate) fn rule(&self) -> &Rule<T> {
        &self.0.rule
    }

    /// The colour that is seen beside pictures.
    pub(crate) fn background(&self) -> &Tensor<T> {
        &self.0.background
    }

    /// Which pixels count, if not all.
    pub(crate) fn mask(&self) -> Option<&Mask> {
        self.0.mask.as_ref()
    }

    /// # Errors
    /// [`RenderError::Shape`] unless the loss is one of images of this size and as many channels.
    pub(crate) fn check(&self, size: Size, channels: usize) -> Result<(), RenderError> {
        let Size { width, height } = size;
        let Inner { reference, background, .. } = &*self.0;
        if reference.shape()[..2] != [height, width] {
            let rule = format!("a reference image of shape [{height}, {width}, R]");
            return Err(RenderError::shape(NAME, rule, reference.shape()));
        }
        if background.size() != channels {
            let rule = format!("a background of shape [{channels}]");
            return Err(RenderError::shape(NAME, rule, background.shape()));
        }
        Ok(())
    }

    /// The loss of the background over `pixels`.
    pub(crate) fn behind(&self, pixels: Range<usize>) -> T::Wide {
        let Inner { rule, reference, background, backgrounds, behind, blocks, .. } = &*self.0;
        let (reference, channels) = (reference.data(), background.size());
        let error = |block: &[T]| squared_error(backgrounds, block);
        let blocks = blocks.get_or_init(|| match rule {
            Rule::Squared => Blocks::new(reference.chunks(backgrounds.len()).map(error).collect()),
            Rule::Function(_) => {
                let of_block = |block: &[T]| sum::<T>(block.len(), |k| block[k].widen());
                Blocks::new(behind.chunks(BLOCK).map(of_block).collect())
            }
        });
        blocks.sum(pixels, |pixels| match rule {
            Rule::Squared => {
                let pixels = &reference[pixels.start * channels..pixels.end * channels];
                pixels.chunks(backgrounds.len()).map(error).sum()
            }
            Rule::Function(_) => behind[pixels].iter().map(|loss| loss.widen()).sum(),
        })
    }
}

/// f of the background at each pixel.
fn behind<T: Scalar>(
    function: &Function<T>,
    reference: &Tensor<T>,
    background: &Tensor<T>,
    mask: Option<&Mask>,
) -> Result<Vec<T>, RenderError> {
    let (references, channels) = (reference.shape()[2], background.size());
    let mut behind = Vec::with_capacity(reference.size() / references);
    let mut tape = Tape::new();
    for rows in reference.data().chunks(PIXELS_AT_ONCE * references) {
        let pixels = rows.len() / references;
        let colors = Tensor::from_flat_fn([pixels, channels], |k| background.data()[k % channels]);
        let rows = Tensor::new([pixels, references], rows.to_vec())?;
        let losses = function(tape.constant(&colors), tape.constant(&rows))?;
        let width = checked_width(losses, pixels)?;
        let of_pixel = |row: &[T]| T::narrow(row.iter().map(|entry| entry.widen()).sum());
        let losses = losses.value();
        behind.extend((0..pixels).map(|p| of_pixel(&losses.data()[p * width..][..width])));
        tape.reset();
    }
    if let Some(mask) = mask {
        let losses = behind.iter_mut().zip(mask.data());
        losses.filter(|(_, counts)| !**counts).for_each(|(loss, _)| *loss = T::ZERO);
    }
    Ok(behind)
}

/// K of losses of n rows: `[n]` or `[n, K]`.
pub(crate) fn checked_width<T: Scalar>(
    losses: Var<'_, T>,
    rows: usize,
) -> Result<usize, RenderError> {
    match *losses.shape() {
        [given] if given == rows => Ok(1),
        [given, width] if given == rows => Ok(width),
        _ => {
            let rule = format!("a function that returns {rows} rows for as many pixels");
            Err(RenderError::shape(NAME, rule, &losses.shape()))
        }
    }
}

/// C of an image `[H, W, C]`, C > 0.
fn checked_channels<T: Scalar>(
    operation: &'static str,
    image: &Tensor<T>,
) -> Result<usize, RenderError> {
    match **image.shape() {
        [_, _, channels] if channels > 0 => Ok(channels),
        _ => {
            let rule = "an image of shape [H, W, C], C > 0".to_owned();
            Err(RenderError::Shape { operation, rule, shape: image.shape().clone() })
        }
    }
}

/// The squared error of some pixels against as many of `colors`.
fn squared_error<T: Scalar>(colors: &[T], pixels: &[T]) -> T::Wide {
    /// Partial sums, so that additions overlap.
    const PARTS: usize = 8;
    let mut parts = [T::Wide::ZERO; PARTS];
    let square = |color: T, pixel: T| {
        let difference = color.widen() - pixel.widen();
        difference * difference
    };
    let (colors, pixels) = (&colors[..pixels.len()], pixels);
    if pixels.len() <= PARTS {
        // Each part would be one term: the same sum.
        return colors.iter().zip(pixels).map(|(&color, &pixel)| square(color, pixel)).sum();
    }
    let whole = colors.as_chunks::<PARTS>().0.iter().zip(pixels.as_chunks::<PARTS>().0);
    for (colors, pixels) in whole {
        for part in 0..PARTS {
            parts[part] += square(colors[part], pixels[part]);
        }
    }
    let rest = colors.as_chunks::<PARTS>().1.iter().zip(pixels.as_chunks::<PARTS>().1);
    for (part, (&color, &pixel)) in parts.iter_mut().zip(rest) {
        *part += square(color, pixel);
    }
    parts.into_iter().sum()
}

/// Pixels in a block: fewer are visited on either side of a gap, and fewer blocks, and so many times
/// as many pixels are left for blocks of blocks.
const BLOCK: usize = 16;

/// Sums over blocks of [`BLOCK`] pixels, in the order of rows, and over blocks of so many blocks.
#[derive(Debug)]
struct Blocks<S> {
    short: Vec<S>,
    long: Vec<S>,
}

impl<S: Scalar> Blocks<S> {
    /// From the sums over blocks of [`BLOCK`] pixels.
    fn new(short: Vec<S>) -> Self {
        let long = short.chunks(BLOCK).map(|block| block.iter().copied().sum()).collect();
        Self { short, long }
    }

    /// The sum over `pixels`, with `few` for pixels that make no block.
    fn sum(&self, pixels: Range<usize>, few: impl Fn(Range<usize>) -> S) -> S {
        // Blocks of one size within a range, and what is left of the range before and after.
        let inner = |range: &Range<usize>, size: usize| {
            let (first, end) = (range.start.div_ceil(size), range.end / size);
            (first < end).then_some(first..end)
        };
        let total = |blocks: &[S]| -> S { blocks.iter().copied().sum() };
        let Some(short) = inner(&pixels, BLOCK) else { return few(pixels) };
        let ends = few(pixels.start..short.start * BLOCK) + few(short.end * BLOCK..pixels.end);
        let Some(long) = inner(&short, BLOCK) else { return ends + total(&self.short[short]) };
        ends + total(&self.short[short.start..long.start * BLOCK])
            + total(&self.short[long.end * BLOCK..short.end])
            + total(&self.long[long])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_background_of_a_range_is_the_sum_over_its_pixels() {
        // Long enough for blocks of blocks.
        let pixels = 3 * BLOCK * BLOCK + 5 * BLOCK + 7;
        for channels in [1, 2, 3, 5] {
            let image = Tensor::from_flat_fn([1, pixels, channels], |k| (k % 11) as f64);
            let background = Tensor::from_flat_fn([channels], |c| (3 + 5 * c) as f64);
            let loss = PixelLoss::squared(&image, &background).unwrap();
            let square = |k: usize| (image.data()[k] - background.data()[k % channels]).powi(2);
            let ends = [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK, BLOCK * BLOCK];
            let starts = ends.iter().flat_map(|&start| [start, start + BLOCK * BLOCK]);
            for start in starts {
                for end in ends.iter().flat_map(|&end| [start + end, pixels - end]) {
                    if start <= end && end <= pixels {
                        // Whole numbers: sums are exact.
                        let expected: f64 = (channels * start..channels * end).map(square).sum();
                        assert_eq!(loss.behind(start..end), expected, "{channels}: {start}..{end}");
                    }
                }
            }
        }
    }
}
