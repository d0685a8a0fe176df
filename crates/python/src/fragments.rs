//! Fragments on a tape, and the picture that they end in.

use std::sync::Arc;

use bokashi_core::{OutputVars, Scalar, Tape, Var};
use bokashi_render_ops::{self as ops, Background, PixelLoss, Size};
use smallvec::smallvec;

use crate::array::Array;
use crate::error::Refusal;
use crate::step::Given;

/// Arrays of fragments: barycentrics, clip positions, and with exact coverage weights.
pub type Arrays<'a, 'py> = [Option<&'a Array<'py>>; 3];

/// The fragments of the arrays from input `first` on.
pub fn from_arrays<'t, T: Scalar>(
    given: &Given<'t, T>,
    first: usize,
    coverage: &Arc<ops::Coverage>,
) -> ops::Fragments<'t, T> {
    let [Some(barycentrics), Some(clip), weight] = given[first..first + 3] else {
        unreachable!("they are required")
    };
    ops::Fragments { barycentrics, clip, weight, coverage: Arc::clone(coverage) }
}

/// What is seen where there are no fragments.
pub fn background<'t, T: Scalar>(given: Option<Var<'t, T>>) -> Background<'t, T> {
    match given {
        None => Background::Zero,
        Some(values) if values.shape().rank() == 1 => Background::Color(values),
        Some(values) => Background::Image(values),
    }
}

/// What stands before a background: the image, or with a reference the sum of the squared errors.
pub fn finish<'t, T: Scalar>(
    operation: &'static str,
    picture: &ops::Picture<'t, T>,
    reference: Option<Var<'t, T>>,
) -> Result<OutputVars<'t, T>, Refusal> {
    let Some(reference) = reference else { return Ok(smallvec![picture.image()?]) };
    let (Size { height, width }, channels) = (picture.size(), picture.channels());
    if *reference.shape() != [height, width, channels] {
        let rule = format!("a reference of shape [{height}, {width}, {channels}]");
        return Err(ops::RenderError::Shape { operation, rule, shape: reference.shape() }.into());
    }
    let zero = bokashi_core::Tensor::zeros([picture.channels()]);
    let behind = match picture.background() {
        Background::Color(color) => color.value(),
        _ => zero,
    };
    Ok(smallvec![picture.loss(&PixelLoss::squared(&reference.value(), &behind)?)?])
}

/// Fragments of which only the pixels are asked: their barycentrics, and where nobody has them their clip positions,
/// are zeros.
pub fn from_pixels<'t, T: Scalar>(
    tape: &'t Tape<T>,
    coverage: &Arc<ops::Coverage>,
    clip: Option<Var<'t, T>>,
    weight: Option<Var<'t, T>>,
) -> ops::Fragments<'t, T> {
    let vertices = coverage.mesh().vertex_count();
    ops::Fragments {
        barycentrics: tape.constant_full([coverage.count(), 2], T::ZERO),
        clip: clip.unwrap_or_else(|| tape.constant_full([vertices, 4], T::ZERO)),
        weight,
        coverage: Arc::clone(coverage),
    }
}
