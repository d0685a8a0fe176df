//! Reference images, and what a background costs against them.
//!
//! A sum over all pixels of an image is the sum over the pixels of a picture and the sum over all
//! others, where the background is seen. The second sum changes with the silhouettes alone. It is
//! made of sums over blocks of pixels, which are worked out once.

use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Scalar, Tensor};

use crate::error::RenderError;

/// A reference image that pictures are compared with, and the squared error of the background that
/// is seen beside them. Cheap to clone.
#[derive(Debug, Clone)]
pub struct Reference<T: Scalar>(Arc<Inner<T>>);

#[derive(Debug)]
struct Inner<T: Scalar> {
    image: Tensor<T>,
    background: Vec<T>,
    blocks: Blocks<T::Wide>,
}

impl<T: Scalar> Reference<T> {
    /// The reference `image: [H, W, C]` for pictures before a background of one colour,
    /// `background: [C]`.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the image is `[H, W, C]` and the background `[C]`, C > 0.
    #[inline(never)]
    pub fn new(image: &Tensor<T>, background: &Tensor<T>) -> Result<Self, RenderError> {
        let channels = checked_channels("reference", image)?;
        if **background.shape() != [channels] {
            let (rule, shape) = (format!("a background of shape [{channels}]"), background.shape());
            return Err(RenderError::Shape { operation: "reference", rule, shape: shape.clone() });
        }
        let background = background.data().to_vec();
        let blocks = image.data().chunks(BLOCK * channels);
        let repeated = background.repeat(BLOCK);
        let blocks = Blocks::new(blocks.map(|block| squared_error(&repeated, block)).collect());
        Ok(Self(Arc::new(Inner { image: image.clone(), background, blocks })))
    }

    /// The image, `[H, W, C]`.
    pub fn image(&self) -> &Tensor<T> {
        &self.0.image
    }

    /// The image, given up; `None` where there is another clone of this reference.
    pub fn into_image(self) -> Option<Tensor<T>> {
        Arc::into_inner(self.0).map(|inner| inner.image)
    }

    /// The colour that is seen beside pictures.
    pub(crate) fn background(&self) -> &[T] {
        &self.0.background
    }

    /// # Errors
    /// [`RenderError::Shape`] unless the image has this shape.
    pub(crate) fn check(
        &self,
        operation: &'static str,
        shape: &[usize; 3],
    ) -> Result<(), RenderError> {
        let given = self.0.image.shape();
        if **given == *shape {
            return Ok(());
        }
        let rule = format!("a reference image of shape {shape:?}");
        Err(RenderError::Shape { operation, rule, shape: given.clone() })
    }

    /// The squared error of the background over `pixels`.
    pub(crate) fn behind(&self, pixels: Range<usize>) -> T::Wide {
        let Inner { image, background, blocks } = &*self.0;
        let channels = background.len();
        blocks.sum(pixels, |pixels| {
            let pixels =
                image.data()[pixels.start * channels..pixels.end * channels].chunks(channels);
            pixels.map(|pixel| squared_error(background, pixel)).sum()
        })
    }
}

/// C of an image `[H, W, C]`, C > 0.
pub(crate) fn checked_channels<T: Scalar>(
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
pub(crate) const BLOCK: usize = 16;

/// Sums over blocks of [`BLOCK`] pixels, in the order of rows, and over blocks of so many blocks.
#[derive(Debug)]
pub(crate) struct Blocks<S> {
    short: Vec<S>,
    long: Vec<S>,
}

impl<S: Scalar> Blocks<S> {
    /// From the sums over blocks of [`BLOCK`] pixels.
    pub(crate) fn new(short: Vec<S>) -> Self {
        let long = short.chunks(BLOCK).map(|block| block.iter().copied().sum()).collect();
        Self { short, long }
    }

    /// The sum over `pixels`, with `few` for pixels that make no block.
    pub(crate) fn sum(&self, pixels: Range<usize>, few: impl Fn(Range<usize>) -> S) -> S {
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
        let image = Tensor::from_flat_fn([1, pixels, 2], |k| (k % 11) as f64);
        let reference = Reference::new(&image, &Tensor::new([2], vec![3.0, 8.0]).unwrap()).unwrap();
        let square = |k: usize| (image.data()[k] - [3.0, 8.0][k % 2]).powi(2);
        let ends = [0, 1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK, BLOCK * BLOCK];
        let starts = ends.iter().flat_map(|&start| [start, start + BLOCK * BLOCK]);
        for start in starts {
            for end in ends.iter().flat_map(|&end| [start + end, pixels - end]) {
                if start <= end && end <= pixels {
                    // Whole numbers: sums are exact.
                    let expected: f64 = (2 * start..2 * end).map(square).sum();
                    assert_eq!(reference.behind(start..end), expected, "{start}..{end}");
                }
            }
        }
    }

    #[test]
    fn wrong_shapes_are_refused() {
        let image = Tensor::<f64>::zeros([4, 5, 3]);
        let error = Reference::new(&Tensor::zeros([4, 5]), &Tensor::<f64>::zeros([3]))
            .unwrap_err()
            .to_string();
        assert_eq!(error, "reference needs an image of shape [H, W, C], C > 0, got shape [4, 5]");
        let error = Reference::new(&image, &Tensor::zeros([1])).unwrap_err().to_string();
        assert_eq!(error, "reference needs a background of shape [3], got shape [1]");
    }
}
