//! What is seen where nothing covers a pixel.

use bokashi_core::{Scalar, Shape, Var};

use crate::error::RenderError;
use crate::size::Size;

/// What is seen where nothing covers a pixel.
#[derive(Debug, Clone, Copy, Default)]
pub enum Background<'t, T: Scalar> {
    /// Zeros.
    #[default]
    Zero,
    /// One colour, `[C]`.
    Color(Var<'t, T>),
    /// An image, `[H, W, C]`.
    Image(Var<'t, T>),
}

impl<'t, T: Scalar> Background<'t, T> {
    pub(crate) fn behind(&self) -> Behind {
        match self {
            Self::Zero => Behind::Zero,
            Self::Color(_) => Behind::Color,
            Self::Image(_) => Behind::Image,
        }
    }

    /// The variable, where there is one.
    pub(crate) fn variable(&self) -> Option<Var<'t, T>> {
        match *self {
            Self::Zero => None,
            Self::Color(variable) | Self::Image(variable) => Some(variable),
        }
    }
}

/// The kind of a background, whose numbers are an input of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Behind {
    Zero,
    Color,
    Image,
}

impl Behind {
    /// # Errors
    /// [`RenderError::Shape`] unless a background of that shape has `channels` channels and, if it
    /// is an image, the size `size`.
    pub(crate) fn check(
        self,
        operation: &'static str,
        shape: &Shape,
        size: Size,
        channels: usize,
    ) -> Result<(), RenderError> {
        let image = [size.height, size.width, channels];
        let expected = match self {
            Self::Zero => return Ok(()),
            Self::Color => &image[2..],
            Self::Image => &image,
        };
        if **shape == *expected {
            return Ok(());
        }
        let what = if self == Self::Color { "colour" } else { "image" };
        let rule = format!("a background {what} of shape {expected:?}");
        Err(RenderError::Shape { operation, rule, shape: shape.clone() })
    }

    /// Fills neighbouring pixels, the first one `pixel`, with what of `background` lies there.
    pub(crate) fn fill<T: Scalar>(
        self,
        values: &mut [T],
        background: &[T],
        channels: usize,
        pixel: usize,
    ) {
        match self {
            Self::Zero => values.fill(T::ZERO),
            Self::Color => values.chunks_exact_mut(channels).for_each(|value| {
                value.copy_from_slice(background);
            }),
            Self::Image => {
                values.copy_from_slice(&background[pixel * channels..][..values.len()]);
            }
        }
    }

    /// Entry c of what of `background` lies at `pixel`.
    pub(crate) fn at<T: Scalar>(
        self,
        background: &[T],
        channels: usize,
        pixel: usize,
        c: usize,
    ) -> T {
        if self == Self::Zero { T::ZERO } else { background[self.entry(channels, pixel) + c] }
    }

    /// Where in the background's numbers those of `pixel` start.
    pub(crate) fn entry(self, channels: usize, pixel: usize) -> usize {
        if self == Self::Image { pixel * channels } else { 0 }
    }
}
