//! The tone curve of sRGB, from light to the numbers of a file and back.
//!
//! # Forward
//! Encoding: `y = 12.92 x` up to `x = 0.0031308`, and `y = 1.055 x^(1 / 2.4) - 0.055` from there on.
//! Decoding: `x = y / 12.92` up to `y = 0.04045`, and `x = ((y + 0.055) / 1.055)^2.4` from there on. Below 0
//! the curve goes on as `f(-x) = -f(x)`, and above 1 by its formula.
//!
//! # Backward
//! `x_bar = f'(x) y_bar`; of the powers, `dy/dx = (y + 0.055) / (2.4 x)` and
//! `dx/dy = 2.4 x / (y + 0.055)`.
//!
//! # Where it is not smooth
//! At the seam, where the slope of the encoding falls from 12.92 to 12.70 and the value jumps by 3e-8: the
//! standard rounds its constants. The linear part has the seam.
//!
//! # Source
//! IEC 61966-2-1:1999; with the sign, as in its annex for wider ranges (scRGB).

use bokashi_core::parallel::for_each_zipped_mut;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var};

use crate::error::RenderError;

/// The numbers of a file that stand for light `x`, entry by entry: `[..]`, the curve of sRGB. 0 and 1 stay. It
/// goes on below 0, with the sign, and above 1.
///
/// # Errors
/// None today.
#[inline(never)]
pub fn srgb_encode<T: Scalar>(x: Var<'_, T>) -> Result<Var<'_, T>, RenderError> {
    Ok(x.tape().apply(Srgb { direction: Direction::Encode }, &[x])?)
}

/// The light that numbers `y` of a file stand for, entry by entry: `[..]`, the inverse of [`srgb_encode`].
///
/// # Errors
/// None today.
#[inline(never)]
pub fn srgb_decode<T: Scalar>(y: Var<'_, T>) -> Result<Var<'_, T>, RenderError> {
    Ok(y.tape().apply(Srgb { direction: Direction::Decode }, &[y])?)
}

/// Light `x: [..]` as a camera sees it whose exposure is `stops` longer: `2^stops x`. Stops broadcast
/// against the light; they may be a single number, or one for each colour.
///
/// # Errors
/// `TensorError::Broadcast` where the shapes do not broadcast; `TensorError::ForeignVariable` for
/// variables of two tapes.
pub fn exposure<'t, T: Scalar>(
    x: Var<'t, T>,
    stops: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    Ok(x.try_mul((stops * T::from_f64(std::f64::consts::LN_2)).exp())?)
}

/// Which way a curve is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Direction {
    Encode,
    Decode,
}

/// Input and output: numbers of any shape.
struct Srgb {
    direction: Direction,
}

const LINEAR: f64 = 12.92;
const SCALE: f64 = 1.055;
const OFFSET: f64 = 0.055;
const EXPONENT: f64 = 2.4;

impl Direction {
    /// Where the power begins.
    fn seam<T: Scalar>(self) -> T {
        T::from_f64(match self {
            Self::Encode => 0.0031308,
            Self::Decode => 0.04045,
        })
    }

    /// The curve above the seam.
    #[inline(always)]
    fn power<T: Scalar>(self, x: T) -> T {
        let [scale, offset, exponent] = [SCALE, OFFSET, EXPONENT].map(T::from_f64);
        match self {
            Self::Encode => scale * x.powf(T::ONE / exponent) - offset,
            Self::Decode => ((x + offset) / scale).powf(exponent),
        }
    }

    #[inline(always)]
    fn value<T: Scalar>(self, x: T) -> T {
        let size = x.abs();
        if size <= self.seam() {
            let linear = T::from_f64(LINEAR);
            return if self == Self::Encode { linear * x } else { x / linear };
        }
        // A NaN is no number of either sign.
        if x < T::ZERO { -self.power(size) } else { self.power(x) }
    }

    /// The slope at `x`, where the value is `y`.
    #[inline(always)]
    fn slope<T: Scalar>(self, x: T, y: T) -> T {
        let [linear, offset, exponent] = [LINEAR, OFFSET, EXPONENT].map(T::from_f64);
        let (x, y) = (x.abs(), y.abs());
        match (self, x <= self.seam()) {
            (Self::Encode, true) => linear,
            (Self::Decode, true) => T::ONE / linear,
            (Self::Encode, false) => (y + offset) / (exponent * x),
            (Self::Decode, false) => exponent * y / (x + offset),
        }
    }
}

impl<T: Scalar> Op<T> for Srgb {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        match self.direction {
            Direction::Encode => "srgb_encode",
            Direction::Decode => "srgb_decode",
        }
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let y = outputs.push(inputs.shape(0));
        for_each_zipped_mut(y, [inputs.data(0)], |y, [x]| *y = self.direction.value(x));
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).output(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let from = [kept.input(0), kept.output(0), kept.only_upstream()];
        x_bar.add_zipped(from, |[x, y, y_bar]| self.direction.slope(x, y) * y_bar);
    }
}
