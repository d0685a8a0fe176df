//! What is seen where nothing covers a pixel.

use bokashi_core::{Scalar, Shape, Tape, TensorError, Var};

use crate::error::RenderError;
use crate::size::Size;

/// What is seen where nothing covers a pixel.
#[derive(Debug, Clone, Copy, Default)]
pub enum Background<'t, T: Scalar> {
    /// Zeros: a constant colour.
    #[default]
    Zero,
    /// One colour, `[C]`.
    Color(Var<'t, T>),
    /// An image, `[H, W, C]`.
    Image(Var<'t, T>),
}

/// A background's numbers on the tape, and what they are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Backdrop<'t, T: Scalar> {
    /// `[C]` or `[H, W, C]`.
    pub(crate) values: Var<'t, T>,
    pub(crate) kind: Kind,
}

impl<'t, T: Scalar> Background<'t, T> {
    /// The background behind a picture of `channels` channels.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless a colour is `[channels]`, an image `[H, W, channels]`;
    /// [`TensorError::ForeignVariable`] for a variable of another tape.
    pub(crate) fn behind(
        self,
        operation: &'static str,
        tape: &'t Tape<T>,
        size: Size,
        channels: usize,
    ) -> Result<Backdrop<'t, T>, RenderError> {
        let (values, kind) = match self {
            Self::Zero => (tape.constant_full([channels], T::ZERO), Kind::Color),
            Self::Color(color) => (color, Kind::Color),
            Self::Image(image) => (image, Kind::Image),
        };
        if !std::ptr::eq(values.tape(), tape) {
            return Err(TensorError::ForeignVariable { operation }.into());
        }
        kind.check(operation, &values.shape(), size, channels)?;
        Ok(Backdrop { values, kind })
    }
}

/// The kind of a background whose numbers are an input of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Color,
    Image,
}

impl Kind {
    fn check(
        self,
        operation: &'static str,
        shape: &Shape,
        size: Size,
        channels: usize,
    ) -> Result<(), RenderError> {
        let image = [size.height, size.width, channels];
        let (expected, what) = match self {
            Self::Color => (&image[2..], "colour"),
            Self::Image => (&image[..], "image"),
        };
        if **shape == *expected {
            return Ok(());
        }
        let rule = format!("a background {what} of shape {expected:?}");
        Err(RenderError::Shape { operation, rule, shape: shape.clone() })
    }

    /// Fills neighbouring pixels, the first of them `pixel`, with the background behind them.
    pub(crate) fn fill<T: Scalar>(
        self,
        values: &mut [T],
        background: &[T],
        channels: usize,
        pixel: usize,
    ) {
        // -0 equals 0 but has other bits, so a colour of both is no single number.
        let sign = |c: T| c.to_f64().is_sign_negative();
        let alike = |a: T, b: T| a.is_same(b) && sign(a) == sign(b);
        match (self, background) {
            (Self::Color, [first, rest @ ..]) if rest.iter().all(|&c| alike(c, *first)) => {
                values.fill(*first);
            }
            (Self::Color, _) => values.chunks_exact_mut(channels).for_each(|value| {
                value.copy_from_slice(background);
            }),
            (Self::Image, _) => {
                values.copy_from_slice(&background[pixel * channels..][..values.len()]);
            }
        }
    }

    /// Where in the background's numbers those of `pixel` start.
    pub(crate) fn entry(self, channels: usize, pixel: usize) -> usize {
        if self == Self::Image { pixel * channels } else { 0 }
    }
}
