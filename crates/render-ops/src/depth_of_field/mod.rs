//! Depth of field: each pixel is blurred by how far its depth lies out of focus.
//!
//! It does not know what hides what. Against an integral over the lens its pictures are off by 1.8 to 9 % of full
//! intensity, and with an iris by 2 to 9 %. Its gradients by aperture and focus have 0.3 to 0.8 of their size, so fits
//! through it are biased. [`lens_picture`](crate::lens_picture()) is off by 0.1 to 1.3 %, and takes hidden layers for
//! it.
//!
//! # Forward
//! At depth `z_i` in front of the eye, a lens focused at `f` blurs with the standard deviation
//! `sigma_i = K |1 - f / z_i|`, in pixels, up to a cap. `K` is the aperture: sigma is 0 in focus,
//! and K at infinity. A thin lens of focal length `l`, diameter A and pixel pitch p has a circle of
//! confusion of diameter `A l |z - f| / (z (f - l) p)`. A disc of diameter d has the variance
//! `(d / 4)^2` per axis, so `K = A l / (4 (f - l) p)`.
//!
//! Each pixel gathers: `b_i = c_i + sum_j w_j(sigma_i) (c_j - c_i)` over the window of `taps`
//! around it, with sampled weights, mirrored at the border. Where all depths are equal, that is
//! [`gaussian_blur`](crate::gaussian_blur()).
//!
//! # Backward
//! `c_bar_j += w_j b_bar_i`, `c_bar_i += b_bar_i - sum_j w_j b_bar_i`;
//! `sigma_bar_i = sum_j dw_j/dsigma b_bar_i . (c_j - c_i)`, and with `s` the sign of `1 - f / z`:
//! `dsigma/dz = K s f / z^2`, `dsigma/dK = |1 - f / z|`, `dsigma/df = -K s / z`; all three are 0
//! where sigma is capped. The forward pass keeps `db/dsigma` where a gradient could ask for it.
//!
//! # Three ways
//! `ladder` mixes a few blurs of the whole image, in between of which each pixel's sigma lies: for
//! tolerances from 1e-5 up. Its cost hardly depends on how many pixels are out of focus, and grows with
//! the largest sigma. `windows` gives each pixel a window of its own, for smaller tolerances and for
//! fixed radii: it costs `(2 r + 1)^2` taps per pixel.
//!
//! `mixtures` blurs through an iris, a disc or blades: the circle of a pixel has the radius `2 sigma`, and its weights
//! have the variance of the Gaussian. It is a mixture of two fixed blurs of
//! [`lens_picture`](crate::lens_picture()). Beyond the border nothing is known, so the weights that lie in the image
//! count for more. At 1024 x 1024 pixels, three channels, `f32`, two threads of a busy machine, it takes so many
//! milliseconds beside a ladder within 1e-3, and the step back with all gradients:
//!
//! | a floor, aperture | ladder | disc | six blades |
//! |---|---|---|---|
//! | 1.5 | 64, 63 | 72, 101 | 51, 108 |
//! | 6 | 76, 104 | 121, 252 | 128, 260 |
//! | 24 | 162, 310 | 140, 359 | 136, 313 |
//!
//! # Where it is not smooth
//! Where sigma reaches its cap. In focus sigma has a kink, but the weights don't: all their derivatives
//! vanish there. Below sigma 0.2 the gradients through sigma are close to 0. The ladder has continuous
//! first derivatives; second derivatives jump where a sigma passes a blur's. Through an iris slopes step there.
//! With windows a radius that
//! follows from a tolerance steps (see [`gaussian_blur`](crate::gaussian_blur())).
//!
//! A gather does not know what hides what. A blurred foreground does not spread over a sharp
//! background, and a blurred background takes colour from a sharp foreground.
//!
//! # Source
//! Potmesil and Chakravarty, *Synthetic image generation with a lens and aperture camera model*,
//! ACM TOG 1(2), 1982: the circle of confusion, and blurring after the image is made.

mod ladder;
mod mixtures;
mod windows;

use bokashi_core::parallel::{for_each_two_pieces_mut, write_each};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var};

use self::ladder::Ladder;
use self::mixtures::Mixtures;
use crate::defocus::{Iris, broken_rule};
use crate::depth_image::DepthImage;
use crate::error::RenderError;
use crate::row_map::sum_rows;
use crate::taps::{Radius, check_radius};

/// The lens of [`depth_of_field`], as variables.
#[derive(Debug, Clone, Copy)]
pub struct Lens<'t, T: Scalar> {
    /// The standard deviation, in pixels, of the blur at infinity. A single number.
    pub aperture: Var<'t, T>,
    /// The distance at which the image is sharp, in units of the scene. A single number.
    pub focus: Var<'t, T>,
}

/// How exactly a lens blurs, and how much at most.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensOptions {
    /// How exact each pixel's window is, or how far it reaches. An iris has an end, and does not look at it.
    pub radius: Radius,
    /// The cap on a pixel's standard deviation, in pixels: without it, sigma would be infinite at
    /// depth 0.
    pub largest_sigma: f64,
    /// The form of the opening, if a blur is to show it: a circle of confusion then has the radius of two standard
    /// deviations. By default there is none, and blurs are Gaussian.
    pub iris: Option<Iris>,
}

impl Default for LensOptions {
    /// Windows with at most 1e-3 of the weight elsewhere, and at most 32 pixels of blur.
    fn default() -> Self {
        Self { radius: Radius::Tolerance(1e-3), largest_sigma: 32.0, iris: None }
    }
}

/// What [`depth_of_field`] gives.
#[derive(Debug, Clone, Copy)]
pub struct Focused<'t, T: Scalar> {
    /// The image `[H, W, C]`.
    pub image: Var<'t, T>,
    /// How many pixels were so far out of focus that their blur was capped.
    pub capped: usize,
}

/// `image: [H, W, C]` as a lens sees it: the farther a pixel's distance lies from the focus, the more the
/// pixel is blurred. For a picture with one depth and nothing known behind it: off by 1.8 to 9 % of full intensity
/// against an integral over the lens, [`lens_picture`](crate::lens_picture()) by 0.1 to 1.3 %.
///
/// Within the default tolerance of 1e-3 it costs 28 blurs at a largest sigma of 6 pixels, and 6 more each
/// time that sigma doubles; within 1e-2 half as many. That takes some 4 times as long as one
/// [`gaussian_blur`](crate::gaussian_blur()) of that sigma within 1e-2, and 5 times with all gradients.
/// A tolerance is the share of a pixel's weight that may lie elsewhere than the formula says. Below 1e-5, and
/// with a fixed radius r, it costs (2 r + 1)^2 taps per entry instead, and its step back to the image runs on
/// one thread: for tests and small images.
///
/// `depth` is an image of distances, `[H, W]`, from 0 to infinity, as [`eye_depth`](crate::eye_depth())
/// makes it. The image, the distances and both numbers of the lens can have a gradient.
///
/// Through [`LensOptions::iris`] each pixel lies between two blurs as [`lens_picture`](crate::lens_picture()) has
/// them, and blades cost no more than a disc: one to two and a half times as much as a Gaussian within 1e-3.
///
/// An aperture of 0 is the identity: the image itself is returned, and nothing is recorded.
///
/// # Errors
/// - [`RenderError::Shape`] unless the image is `[H, W, C]` with at least one entry, the distances
///   `[H, W]`, and aperture and focus single numbers.
/// - [`RenderError::Depth`] for a distance that is negative or NaN.
/// - [`RenderError::BadLens`] for an aperture or a largest sigma that is negative or not finite, or a
///   focus that is not finite and positive; with an iris for a largest sigma above 512, fewer than 3 or more than 16
///   blades, or a rotation that is not finite.
/// - [`RenderError::BadRadius`] as for [`gaussian_blur`](crate::gaussian_blur()).
#[inline(never)]
pub fn depth_of_field<'t, T: Scalar>(
    image: Var<'t, T>,
    depth: DepthImage<'t, T>,
    lens: Lens<'t, T>,
    options: &LensOptions,
) -> Result<Focused<'t, T>, RenderError> {
    let op = DepthOfField { options: *options };
    let inputs = [image, depth.distances(), lens.aperture, lens.focus];
    if inputs.iter().any(|input| !std::ptr::eq(input.tape(), image.tape())) {
        return Err(TensorError::ForeignVariable { operation: NAME }.into());
    }
    op.check(&inputs.map(Var::value))?;
    let (outputs, capped) = image.tape().record_with(op, &inputs, |saved| saved.capped)?;
    Ok(Focused { image: outputs[0], capped })
}

const NAME: &str = "depth_of_field";

/// The largest sigma with an iris: its circles have a radius of up to 1024 pixels.
const LARGEST_SIGMA: f64 = 512.0;

/// Inputs: image `[H, W, C]`, depth `[H, W]`, aperture `[]`, focus `[]`.
struct DepthOfField {
    options: LensOptions,
}

/// The blur of a pixel, and its derivatives with respect to depth, aperture and focus.
#[derive(Debug, Clone, Copy)]
struct Circle<S> {
    /// Its standard deviation; with an iris its radius, below 0 in front of the focus.
    extent: S,
    by_depth: S,
    by_aperture: S,
    by_focus: S,
}

/// What the backward pass reads, and memory.
#[derive(Debug, Default)]
struct Saved<T: Scalar> {
    /// The [`Circle::extent`] of each pixel.
    extents: Vec<T>,
    /// The derivative of each entry of the result with respect to its pixel's extent; empty unless a
    /// gradient could ask for it.
    slopes: Vec<T>,
    ladder: Ladder<T>,
    mixtures: Mixtures<T>,
    /// Memory: capped pixels by piece, gradients with respect to extents.
    counts: Vec<usize>,
    extent_bars: Vec<T::Wide>,
    capped: usize,
}

impl DepthOfField {
    fn check<T: Scalar>(&self, inputs: &[bokashi_core::Tensor<T>; 4]) -> Result<(), RenderError> {
        let [image, depth, aperture, focus] = inputs;
        let refused = |rule: &str, shape: &bokashi_core::Shape| {
            let (rule, shape) = (rule.to_owned(), shape.clone());
            Err(RenderError::Shape { operation: NAME, rule, shape })
        };
        let &[height, width, _] = &**image.shape() else {
            return refused("an image of shape [H, W, C] with at least one entry", image.shape());
        };
        if image.size() == 0 {
            return refused("an image of shape [H, W, C] with at least one entry", image.shape());
        }
        if **depth.shape() != [height, width] {
            return refused(&format!("a depth image of shape [{height}, {width}]"), depth.shape());
        }
        for (name, number) in [("aperture", aperture), ("focus", focus)] {
            if number.size() != 1 {
                return refused(&format!("a single number for the {name}"), number.shape());
            }
        }
        check_radius(self.options.radius)?;
        let bad = |rule, value| Err(RenderError::BadLens { rule, value });
        let (aperture, focus) = (aperture.item().to_f64(), focus.item().to_f64());
        if !(aperture >= 0.0 && aperture.is_finite()) {
            return bad("a finite aperture of at least 0", aperture);
        }
        if !(focus > 0.0 && focus.is_finite()) {
            return bad("a finite and positive focus", focus);
        }
        let largest = self.options.largest_sigma;
        if !(largest >= 0.0 && largest.is_finite()) {
            return bad("a finite largest sigma of at least 0", largest);
        }
        if let Some(iris) = self.options.iris {
            if largest > LARGEST_SIGMA {
                return bad("a largest sigma of at most 512 pixels with an iris", largest);
            }
            if let Some((rule, value)) = broken_rule(iris) {
                return bad(rule, value);
            }
        }
        let is_depth = |z: &T| *z >= T::ZERO;
        match depth.data().iter().position(|z| !is_depth(z)) {
            Some(pixel) => Err(RenderError::Depth { pixel, depth: depth.data()[pixel].to_f64() }),
            None => Ok(()),
        }
    }

    /// How much a pixel at depth `z` is blurred, and whether that is capped.
    fn circle<S: Scalar>(&self, z: S, aperture: S, focus: S) -> (Circle<S>, bool) {
        let out_of_focus = S::ONE - focus / z;
        let sigma = aperture * out_of_focus.abs();
        let largest = S::from_f64(self.options.largest_sigma);
        // A depth of -0 lies in front of the focus too.
        let factor = S::from_f64(match self.options.iris {
            None => 1.0,
            Some(_) if z < focus => -2.0,
            Some(_) => 2.0,
        });
        // Not `sigma > largest`: at depth 0 sigma may be NaN.
        let is_within = sigma <= largest;
        if !is_within {
            let zero = S::ZERO;
            let extent = factor * largest;
            return (Circle { extent, by_depth: zero, by_aperture: zero, by_focus: zero }, true);
        }
        let side = if out_of_focus < S::ZERO { -aperture } else { aperture };
        let circle = Circle {
            extent: factor * sigma,
            by_depth: factor * (side * (focus / z / z)),
            by_aperture: factor * out_of_focus.abs(),
            by_focus: factor * (-side / z),
        };
        (circle, false)
    }
}

/// Pixels in one piece of work on numbers of pixels.
const PIXELS_PER_PIECE: usize = 1 << 12;

impl<T: Scalar> Op<T> for DepthOfField {
    type Saved = Saved<T>;
    type Error = RenderError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), RenderError> {
        let (shape, image, depth) = (inputs.shape(0), inputs.data(0), inputs.data(1));
        let (aperture, focus) = (inputs.data(2)[0].widen(), inputs.data(3)[0].widen());
        let Saved { extents, slopes, ladder, mixtures, counts, capped, .. } = saved;
        *capped = 0;
        if inputs.data(2)[0] == T::ZERO {
            outputs.pass(0, "aperture is 0");
            return Ok(());
        }
        extents.resize(depth.len(), T::ZERO);
        counts.resize(depth.len().div_ceil(PIXELS_PER_PIECE), 0);
        for_each_two_pieces_mut(extents, counts, [PIXELS_PER_PIECE, 1], |piece, extents, count| {
            count[0] = 0;
            for (extent, z) in extents.iter_mut().zip(&depth[piece * PIXELS_PER_PIECE..]) {
                let (circle, is_capped) = self.circle(z.widen(), aperture, focus);
                *extent = T::narrow(circle.extent);
                count[0] += usize::from(is_capped);
            }
        });
        *capped = counts.iter().sum();

        let out = outputs.push(shape);
        let moves = (1..4).any(|i| inputs.needs(i));
        slopes.resize(if moves { image.len() } else { 0 }, T::ZERO);
        let LensOptions { radius, largest_sigma, iris } = self.options;
        match (iris, ladder::tolerance_of(radius)) {
            (Some(iris), _) => {
                let reach = (iris, 2.0 * largest_sigma);
                mixtures.blur([image, extents], shape, reach, out, slopes);
            }
            (None, Some(tolerance)) => ladder.blur(image, shape, extents, tolerance, out, slopes),
            (None, None) => windows::blur(image, shape, extents, radius, out, slopes),
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        match (1..4).any(|i| inputs.needs(i)) {
            true => Keep::NOTHING.input(1).input(2).input(3),
            false => Keep::NOTHING,
        }
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let shape = kept.input_shape(0);
        let b_bar = kept.only_upstream();
        let Saved { extents, slopes, ladder, mixtures, extent_bars, .. } = saved;
        if let Some(image_bar) = gradients.get(0) {
            let (entries, radius) = (image_bar.entries(), self.options.radius);
            match (self.options.iris, ladder::tolerance_of(radius)) {
                (Some(_), _) => mixtures.blur_adjoint(b_bar, shape, entries),
                (None, Some(_)) => ladder.blur_adjoint(b_bar, shape, entries),
                (None, None) => windows::blur_adjoint(b_bar, shape, extents, radius, entries),
            }
        }
        if !(1..4).any(|i| gradients.needs(i)) {
            return;
        }
        let channels = shape[2];
        extent_bars.resize(extents.len(), T::Wide::ZERO);
        write_each(extent_bars, PIXELS_PER_PIECE, |pixel| {
            let entries = pixel * channels..(pixel + 1) * channels;
            let pairs = slopes[entries.clone()].iter().zip(&b_bar[entries]);
            pairs.map(|(s, b)| s.widen() * b.widen()).sum()
        });
        let (depth, aperture, focus) = (kept.input(1), kept.input(2)[0], kept.input(3)[0]);
        let circle =
            |pixel: usize| self.circle(depth[pixel].widen(), aperture.widen(), focus.widen()).0;
        if let Some(depth_bar) = gradients.get(1) {
            depth_bar.add_each(|k| T::narrow(extent_bars[k] * circle(k).by_depth));
        }
        if !(2..4).any(|i| gradients.needs(i)) {
            return;
        }
        let sums = sum_rows::<T, 2>(depth.len(), PIXELS_PER_PIECE, |pixel| {
            let circle = circle(pixel);
            Some([circle.by_aperture, circle.by_focus].map(|slope| extent_bars[pixel] * slope))
        });
        for i in 0..2 {
            if let Some(bar) = gradients.get(2 + i) {
                bar.add_each(|_| T::narrow(sums[i]));
            }
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        let Saved { extents, slopes, ladder, mixtures, extent_bars, .. } = saved;
        size_of_val(&extents[..])
            + size_of_val(&slopes[..])
            + size_of_val(&extent_bars[..])
            + ladder.bytes()
            + mixtures.bytes()
    }
}
