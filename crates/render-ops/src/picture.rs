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
/// The values are `[P, C]`. P counts the pixels that show one fragment at their centre, and the *blended
/// pixels* after them. These are the uncovered pixels beside silhouettes, once they are antialiased; with
/// exact coverage the pixels that a discontinuity crosses.
#[derive(Debug, Clone)]
pub struct Picture<'t, T: Scalar> {
    pub(crate) values: Var<'t, T>,
    pub(crate) backdrop: Backdrop<'t, T>,
    /// The clip positions that were rasterized.
    pub(crate) clip: Var<'t, T>,
    pub(crate) coverage: Arc<Coverage>,
    /// The blended pixels, in order, where there are any.
    pub(crate) blended: Option<Arc<Vec<u32>>>,
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
        centers.chain(self.blended().iter().map(|&pixel| pixel as usize))
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

    /// The blended pixels, in order.
    pub(crate) fn blended(&self) -> &[u32] {
        self.blended.as_deref().map_or(&[], Vec::as_slice)
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

/// Runs `work` with a number of channels, which the compiler knows where it is the usual one.
#[inline(always)]
pub(crate) fn with_channels(channels: usize, mut work: impl FnMut(usize)) {
    if channels == 3 { work(3) } else { work(channels) }
}
