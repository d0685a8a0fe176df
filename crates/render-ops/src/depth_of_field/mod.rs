//! Depth of field: each pixel is blurred by how far its depth lies out of focus.
//!
//! # Forward
//! At depth `z_i` in front of the eye, a lens focused at `f` blurs with the standard deviation
//! `sigma_i = K |1 - f / z_i|`, in pixels, up to a cap. `K` is the aperture: sigma is 0 in focus,
//! and K at infinity. A thin lens of focal length `l`, diameter A and pixel pitch p has a circle of
//! confusion of diameter `A l |z - f| / (z (f - l) p)`. A disc of diameter d has the variance
//! `(d / 4)^2` per axis, so `K = A l / (4 (f - l) p)`.
//!
//! Each pixel gathers: `b_i = c_i + sum_j w_j(sigma_i) (c_j - c_i)` over the window of `taps`
//! around it, with sampled weights, mirrored at the border. In this form a constant image comes out
//! exactly, and so does every pixel in focus. Where all depths are equal, the result is that of
//! [`gaussian_blur`](crate::gaussian_blur()) of the same radius.
//!
//! # Backward
//! `c_bar_j += w_j b_bar_i`, `c_bar_i += b_bar_i - sum_j w_j b_bar_i`;
//! `sigma_bar_i = sum_j dw_j/dsigma b_bar_i . (c_j - c_i)`, and with `s` the sign of `1 - f / z`:
//! `dsigma/dz = K s f / z^2`, `dsigma/dK = |1 - f / z|`, `dsigma/df = -K s / z`; all three are 0
//! where sigma is capped.
//!
//! # Where it is not smooth
//! Where sigma reaches its cap, and where a radius that follows from a tolerance steps (see
//! [`gaussian_blur`](crate::gaussian_blur())). In focus sigma has a kink, but the weights don't: all
//! their derivatives vanish there. Below sigma 0.2 the gradients through sigma are close to 0.
//!
//! A gather does not know what hides what. A blurred foreground does not spread over a sharp
//! background, and a blurred background takes colour from a sharp foreground.
//!
//! # Source
//! Potmesil and Chakravarty, *Synthetic image generation with a lens and aperture camera model*,
//! ACM TOG 1(2), 1982: the circle of confusion, and blurring after the image is made.

#[cfg(test)]
mod tests;

use bokashi_core::parallel::for_each_piece_mut;
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var};

use crate::border::Border;
use crate::depth_image::DepthImage;
use crate::error::RenderError;
use crate::taps::{Blur, Kernel, Radius, Taps, check_radius};

/// Pixels in one piece of work.
const PIXELS_PER_PIECE: usize = 1 << 8;

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
    /// How far each pixel's window reaches.
    pub radius: Radius,
    /// The cap on a pixel's standard deviation, in pixels: without it, sigma would be infinite at
    /// depth 0.
    pub largest_sigma: f64,
}

impl Default for LensOptions {
    /// Windows that miss at most 1e-3 of the weight, and at most 32 pixels of blur.
    fn default() -> Self {
        Self { radius: Radius::Tolerance(1e-3), largest_sigma: 32.0 }
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
/// pixel is blurred.
///
/// It costs a window for each pixel and channel, of (2 r + 1)^2 taps with r = 3.3 sigma at the default
/// tolerance of 1e-3: some 80 taps at sigma 1, 3,000 at 8 and 45,000 at 32. A step back to the image runs
/// on one thread. So keep the aperture small, or the image.
///
/// `depth` is an image of distances, `[H, W]`, from 0 to infinity, as [`eye_depth`](crate::eye_depth())
/// makes it. The image, the distances and both numbers of the lens can have a gradient.
///
/// An aperture of 0 is the identity: the image itself is returned, and nothing is recorded.
///
/// # Errors
/// - [`RenderError::Shape`] unless the image is `[H, W, C]` with at least one entry, the distances
///   `[H, W]`, and aperture and focus single numbers.
/// - [`RenderError::Depth`] for a distance that is negative or NaN.
/// - [`RenderError::BadLens`] for an aperture or a largest sigma that is negative or not finite, or a
///   focus that is not finite and positive.
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

/// Inputs: image `[H, W, C]`, depth `[H, W]`, aperture `[]`, focus `[]`.
struct DepthOfField {
    options: LensOptions,
}

/// The blur of a pixel, and its derivatives with respect to depth, aperture and focus.
#[derive(Debug, Clone, Copy)]
struct Circle<S> {
    sigma: S,
    by_depth: S,
    by_aperture: S,
    by_focus: S,
}

/// The circles of all pixels, memory for their gradients, and how many are capped.
#[derive(Debug, Default)]
struct Saved<S> {
    circles: Vec<Circle<S>>,
    sigma_bars: Vec<S>,
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
        // Not `sigma > largest`: at depth 0 sigma may be NaN.
        let is_within = sigma <= largest;
        if !is_within {
            let zero = S::ZERO;
            let circle =
                Circle { sigma: largest, by_depth: zero, by_aperture: zero, by_focus: zero };
            return (circle, true);
        }
        let side = if out_of_focus < S::ZERO { -aperture } else { aperture };
        let circle = Circle {
            sigma,
            by_depth: side * (focus / z / z),
            by_aperture: out_of_focus.abs(),
            by_focus: -side / z,
        };
        (circle, false)
    }
}

/// The windows of pixels, one at a time.
struct Windows<T: Scalar> {
    height: usize,
    width: usize,
    blur: Blur,
    taps: [Taps<T>; 2],
}

impl<T: Scalar> Windows<T> {
    fn new(shape: &[usize], radius: Radius) -> Self {
        let blur = Blur { kernel: Kernel::Sampled, border: Border::Mirror, radius };
        let taps = [Taps::default(), Taps::default()];
        Self { height: shape[0], width: shape[1], blur, taps }
    }

    /// Calls `visit(j, w, dw/dsigma)` for each tap of the window with standard deviation `sigma`
    /// around `pixel`, j the pixel that it sees; for none where the window is a single pixel.
    fn for_each_tap(&mut self, pixel: usize, sigma: T::Wide, mut visit: impl FnMut(usize, T, T)) {
        let sigma = T::narrow(sigma);
        if sigma == T::ZERO {
            return;
        }
        let filled = Taps::fill(&mut self.taps, sigma, &self.blur, [self.width, self.height]);
        filled.expect("a finite sigma above 0 has a window");
        let [along_rows, along_columns] = &self.taps;
        let reach = |taps: &Taps<T>| taps.radius() as isize;
        let (row, column) = ((pixel / self.width) as isize, (pixel % self.width) as isize);
        let source = |at, extent| Border::Mirror.source(at, extent).expect("a mirror is endless");
        for k in -reach(along_columns)..=reach(along_columns) {
            let y = source(row + k, self.height);
            let at = k.unsigned_abs();
            let (wy, dwy) = (along_columns.weights[at], along_columns.slopes[at]);
            for l in -reach(along_rows)..=reach(along_rows) {
                let j = y * self.width + source(column + l, self.width);
                if j != pixel {
                    let at = l.unsigned_abs();
                    let (wx, dwx) = (along_rows.weights[at], along_rows.slopes[at]);
                    visit(j, wy * wx, dwy * wx + wy * dwx);
                }
            }
        }
    }
}

impl<T: Scalar> Op<T> for DepthOfField {
    type Saved = Saved<T::Wide>;
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
        let (shape, image) = (inputs.shape(0), inputs.data(0));
        let channels = shape[2];
        let (aperture, focus) = (inputs.data(2)[0].widen(), inputs.data(3)[0].widen());
        let Saved { circles, capped, .. } = saved;
        circles.clear();
        *capped = 0;
        if inputs.data(2)[0] == T::ZERO {
            outputs.pass(0, "aperture is 0");
            return Ok(());
        }
        for &z in inputs.data(1) {
            let (circle, is_capped) = self.circle(z.widen(), aperture, focus);
            circles.push(circle);
            *capped += usize::from(is_capped);
        }

        let out = outputs.push(shape);
        for_each_piece_mut(out, PIXELS_PER_PIECE * channels, |piece, out| {
            let mut windows = Windows::<T>::new(shape, self.options.radius);
            let mut sums = vec![T::Wide::ZERO; channels];
            for (k, out) in out.chunks_exact_mut(channels).enumerate() {
                let pixel = piece * PIXELS_PER_PIECE + k;
                let own = &image[pixel * channels..][..channels];
                sums.fill(T::Wide::ZERO);
                windows.for_each_tap(pixel, circles[pixel].sigma, |j, w, _| {
                    let other = &image[j * channels..][..channels];
                    for c in 0..channels {
                        sums[c] += w.widen() * (other[c].widen() - own[c].widen());
                    }
                });
                for c in 0..channels {
                    out[c] = T::narrow(own[c].widen() + sums[c]);
                }
            }
        });
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let moves = (1..4).any(|i| inputs.needs(i));
        if moves { Keep::NOTHING.input(0) } else { Keep::NOTHING }
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let shape = kept.input_shape(0);
        let channels = shape[2];
        let b_bar = kept.only_upstream();
        let Saved { circles, sigma_bars, .. } = saved;
        if let Some(image_bar) = gradients.get(0) {
            // One thread: many windows add to a pixel, and the order must be the same.
            image_bar.add(b_bar);
            let entries = image_bar.entries();
            let mut windows = Windows::<T>::new(shape, self.options.radius);
            for (pixel, circle) in circles.iter().enumerate() {
                let b_bar = &b_bar[pixel * channels..][..channels];
                windows.for_each_tap(pixel, circle.sigma, |j, w, _| {
                    for c in 0..channels {
                        let share = w * b_bar[c];
                        entries[j * channels + c] += share;
                        entries[pixel * channels + c] -= share;
                    }
                });
            }
        }
        if !(1..4).any(|i| gradients.needs(i)) {
            return;
        }
        let image = kept.input(0);
        sigma_bars.clear();
        sigma_bars.resize(circles.len(), T::Wide::ZERO);
        for_each_piece_mut(sigma_bars, PIXELS_PER_PIECE, |piece, sigma_bars| {
            let mut windows = Windows::<T>::new(shape, self.options.radius);
            for (k, sigma_bar) in sigma_bars.iter_mut().enumerate() {
                let pixel = piece * PIXELS_PER_PIECE + k;
                let own = &image[pixel * channels..][..channels];
                let b_bar = &b_bar[pixel * channels..][..channels];
                windows.for_each_tap(pixel, circles[pixel].sigma, |j, _, slope| {
                    let other = &image[j * channels..][..channels];
                    for c in 0..channels {
                        let step = other[c].widen() - own[c].widen();
                        *sigma_bar += slope.widen() * b_bar[c].widen() * step;
                    }
                });
            }
        });
        if let Some(depth_bar) = gradients.get(1) {
            depth_bar.add_each(|k| T::narrow(sigma_bars[k] * circles[k].by_depth));
        }
        let sum = |partial: fn(&Circle<T::Wide>) -> T::Wide| -> T {
            let pairs = sigma_bars.iter().zip(circles.iter());
            T::narrow(pairs.map(|(&bar, circle)| bar * partial(circle)).sum())
        };
        if let Some(aperture_bar) = gradients.get(2) {
            aperture_bar.add_each(|_| sum(|circle| circle.by_aperture));
        }
        if let Some(focus_bar) = gradients.get(3) {
            focus_bar.add_each(|_| sum(|circle| circle.by_focus));
        }
    }

    fn saved_bytes(&self, saved: &Self::Saved) -> usize {
        size_of_val(&saved.circles[..]) + size_of_val(&saved.sigma_bars[..])
    }
}
