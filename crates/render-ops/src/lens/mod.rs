//! A lens that knows what hides what.
//!
//! # Forward
//! What a lens sees is an integral over its points. Each surface that a pixel shows, and those close to its
//! outlines that it hides (`disocclusion`, `hiding`), has a circle of confusion (`circles`). What does not face the
//! lens is moved by a part of it (`tilt`). By its radius each surface is shared among a few rungs, blurs of fixed radii
//! (`defocus/rungs`, `surfaces`; `spans` where pixels show nothing else). Each rung is blurred through the iris, its
//! colours and its alpha (`defocus/iris`, `defocus/blur`), and the blurred rungs are put together from front to back
//! (`front_to_back`). Each file has its formulas, and `bands` has the passes over the image.
//!
//! # Backward
//! The same passes from last to first: each file has its own step back beside its step forward.
//!
//! # Where it is not smooth
//! Where a circle passes a rung, where what is left of the lens decides what is seen, where a circle reaches its
//! cap or a shift a whole pixel, and where the visible surface changes. The value steps in the last; where a
//! translucent piece passes what lies at its pixel's centre; and, by less than a thousandth in our scenes, where what
//! is hidden comes within reach of a jump.
//!
//! # Memory
//! A band of 16 rows holds each rung that something in it lies on, over the image's width, and each blurred rung
//! that is seen in it, over the columns where the lens is not yet full. So a picture of two planes holds four
//! rungs, and a floor holds little more than two, cut at other rows. Rungs of 12 pixels and more are blurred at half
//! the size, those of 24 and more at a quarter, and so on to a sixteenth. A backward pass holds the gradients of
//! blurred rungs at their own sizes, and those of fragments by pixel. Blurred rungs and gradients are wide numbers:
//! neighbouring rungs are nearly alike, and gradients of circles are their differences.
//!
//! # Cost
//! 1024 x 1024 pixels, three channels, `f32`, two threads, three hidden layers, in milliseconds, without finding these.
//! Behind it the backward pass with all gradients.
//!
//! | aperture, pixels | 5 | 20 | 80 |
//! |---|---|---|---|
//! | a board in front of a wall in focus | 37, 55 | 39, 60 | 48, 86 |
//! | a floor from the eye through the focus | 47, 62 | 70, 83 | 83, 128 |
//! | the floor with its slopes | 68, 106 | 91, 135 | 104, 172 |
//!
//! # Limits
//! What no ray through the middle of the lens meets is not known: the far side of a ball's rim, and surfaces
//! behind those of the last layer. In focus a surface has no gradient by its distance: its circle is at its
//! minimum.
//!
//! # Source
//! Potmesil and Chakravarty, *Synthetic image generation with a lens and aperture camera model*, ACM TOG 1(2),
//! 1982, for the circle of confusion. The rungs, and how they hide each other, are our own: an integral over the
//! lens is what they are measured against.

mod bands;
mod circles;
mod disocclusion;
mod draw;
mod frame;
mod front_to_back;
mod hiding;
mod inputs;
mod pixel_bars;
mod spans;
mod surfaces;
mod tilt;

use std::sync::Arc;

use bokashi_core::{Scalar, Tape, TensorError, Var};
use smallvec::SmallVec;

use self::draw::{DrawLens, Saved};
use self::frame::Frame;
use self::inputs::NAME;
pub use self::inputs::{LensLayer, LensPicture, ThinLens, ThinLensOptions};
use crate::background::Background;
use crate::coverage::Coverage;
use crate::defocus::broken_rule;
use crate::error::RenderError;
use crate::picture::{Composite, checked_channels};
use crate::size::Size;

/// A tape keeps 64 inputs of an operation at most: 7 and a slope, and four for each layer behind.
const MOST_BEHIND: usize = 14;

/// The picture that a lens sees of surfaces one behind another, before a background that is `far` away.
///
/// `visible` are the fragments of any sampling; with exact coverage, outlines have their gradients. `behind` are
/// the layers at pixel centres that [`depth_layers`](crate::depth_layers()) found of the same mesh, the nearest
/// first. The first of these covers every pixel centre that the visible layer does, and says what hides what: its
/// colours are seen in boundary pixels alone, beside the pieces that cover them. The others are seen beside the
/// outlines of what hides them. Two hidden layers are enough: leave the mesh's back faces out
/// ([`Cull`](crate::Cull)), else its far side counts as one. Without a layer `behind`, nothing but the background
/// is seen behind what is visible.
///
/// Colours, alphas, distances, weights of pieces, the background and both numbers of the lens can have a
/// gradient. For a picture that comes with one depth, and nothing behind it,
/// [`depth_of_field`](crate::depth_of_field()) costs less.
///
/// The background lies at the distance `far`, above 0 or infinite, which has no gradient. An image behind it is as
/// large as the picture with its margin.
///
/// With an aperture of 0, and alphas of the visible and the first hidden layer that are 1 and not learnt, it is
/// [`composite`](crate::composite()), and layers behind are not looked at.
///
/// # Errors
/// - [`RenderError::Shape`] unless the colours of each layer are `[N, C]`, C > 0, its alphas and distances `[N]`,
///   its slopes `[N, 2]`,
///   the background has as many channels, aperture and focus are single numbers; and for fragments that are
///   not whole.
/// - [`RenderError::ExactLayers`] for a layer of exact coverage behind, [`RenderError::LayerSize`] for layers of
///   several sizes, [`RenderError::LayerPixel`] where a layer behind covers a pixel that the one before does not.
/// - `TensorError::Value` for a distance that is negative or NaN, an aperture that is negative or not finite, a
///   focus that is not finite and positive, a largest radius that is not between 0 and 1024, a margin that leaves
///   nothing of the picture, an iris of fewer than 3 or more than 16 blades or of a rotation that is not finite, a
///   background that is not at a distance above 0, more than 14 layers behind.
/// - `TensorError::ForeignVariable` for variables of several tapes.
#[inline(never)]
pub fn lens_picture<'t, T: Scalar>(
    visible: LensLayer<'_, 't, T>,
    behind: &[LensLayer<'_, 't, T>],
    background: Background<'t, T>,
    far: f64,
    lens: ThinLens<'t, T>,
    options: &ThinLensOptions,
) -> Result<LensPicture<'t, T>, RenderError> {
    let tape = visible.premultiplied.tape();
    if behind.len() > MOST_BEHIND {
        let rule = format!("at most {MOST_BEHIND} layers behind");
        return Err(RenderError::value(NAME, rule, behind.len() as f64));
    }
    let own = visible.fragments.checked_coverage(NAME, tape)?;
    let size = own.size();
    let channels = checked_channels(NAME, visible.premultiplied, own.count())?;
    check_numbers(tape, lens, far, options)?;
    let least = size.width.min(size.height);
    if 2 * options.margin >= least {
        let rule = format!("a margin of less than half of {least} pixels");
        return Err(RenderError::value(NAME, rule, options.margin as f64));
    }
    visible.check(own.count(), channels)?;
    let backdrop = background.behind(NAME, tape, size, channels)?;
    let mut inputs: List<'t, T> = SmallVec::new();
    inputs.extend([backdrop.values, lens.aperture, lens.focus]);
    inputs.extend([visible.premultiplied, visible.alpha, visible.distance]);
    inputs.extend(visible.fragments.weight);
    let hidden = list_hidden(behind, size, channels, &mut inputs)?;
    let slopes = std::iter::once(&visible).chain(behind).map(|layer| {
        inputs.extend(layer.slope);
        layer.slope.map(|_| inputs.len() - 1)
    });
    let slopes = slopes.collect();
    let hides = std::iter::once(&visible).chain(behind.first());
    if lens.aperture.item() == T::ZERO && hides.clone().all(LensLayer::is_opaque) {
        let values = visible.premultiplied;
        let image = Composite::from_values(values, visible.fragments, background)?.image()?;
        let margin = options.margin;
        let image = image.slice(0, margin..size.height - margin)?;
        let image = image.slice(1, margin..size.width - margin)?;
        return Ok(LensPicture { image, capped: 0, piece: 0 });
    }
    let has_weights = visible.fragments.weight.is_some();
    let frame = Frame { size, margin: options.margin };
    let (kind, options) = (backdrop.kind, *options);
    let op = DrawLens { visible: own, hidden, slopes, kind, has_weights, far, frame, options };
    let look = |saved: &Saved<T>| [saved.capped as u64, saved.piece];
    let (outputs, [capped, piece]) = tape.record_with(op, &inputs, look)?;
    Ok(LensPicture { image: outputs[0], capped: capped as usize, piece })
}

/// Inputs: few layers need no memory.
type List<'t, T> = SmallVec<[Var<'t, T>; 24]>;

/// Adds the inputs of all layers behind but their slopes; returns what they cover.
///
/// # Errors
/// As [`lens_picture`].
fn list_hidden<'t, T: Scalar>(
    behind: &[LensLayer<'_, 't, T>],
    size: Size,
    channels: usize,
    inputs: &mut List<'t, T>,
) -> Result<SmallVec<[Arc<Coverage>; 4]>, RenderError> {
    let mut hidden = SmallVec::new();
    for layer in behind {
        let coverage = layer.fragments.checked_coverage(NAME, layer.premultiplied.tape())?;
        if coverage.is_exact() {
            return Err(RenderError::ExactLayers { operation: NAME });
        }
        if coverage.size() != size {
            return Err(RenderError::LayerSize { expected: size, given: coverage.size() });
        }
        layer.check(coverage.count(), channels)?;
        inputs.extend([layer.premultiplied, layer.alpha, layer.distance]);
        hidden.push(coverage);
    }
    Ok(hidden)
}

/// # Errors
/// As [`lens_picture`].
fn check_numbers<T: Scalar>(
    tape: &Tape<T>,
    lens: ThinLens<'_, T>,
    far: f64,
    options: &ThinLensOptions,
) -> Result<(), RenderError> {
    for (number, what) in [(lens.aperture, "aperture"), (lens.focus, "focus")] {
        if !std::ptr::eq(number.tape(), tape) {
            return Err(TensorError::ForeignVariable { operation: NAME }.into());
        }
        if number.shape().size() != 1 {
            let rule = format!("a single number for the {what}");
            return Err(RenderError::shape(NAME, rule, &number.shape()));
        }
    }
    let [aperture, focus] = [lens.aperture, lens.focus].map(|number| number.item().to_f64());
    let largest = options.largest_radius;
    let rules = [
        (aperture >= 0.0 && aperture.is_finite(), aperture, "a finite aperture of at least 0"),
        (focus > 0.0 && focus.is_finite(), focus, "a finite and positive focus"),
        (far > 0.0, far, "a background at a distance above 0"),
        ((0.0..=1024.0).contains(&largest), largest, "a largest radius from 0 to 1024 pixels"),
    ];
    let broken = rules.into_iter().find(|(holds, ..)| !holds);
    match broken.map(|(_, value, rule)| (rule, value)).or_else(|| broken_rule(options.iris)) {
        Some((rule, value)) => Err(RenderError::value(NAME, rule, value)),
        None => Ok(()),
    }
}
