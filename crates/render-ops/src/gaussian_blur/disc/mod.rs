//! Blur with a disc, whose radius can be learnt.
//!
//! # Forward
//! A disc of the radius `r = 2 sigma` has the variance sigma^2 per axis, as the Gaussians have. Each pixel has the
//! share of a disc that it covers (`taps/disc`), of the radius at which these weights have exactly this variance.
//! So `b = K c`, where K is summed along columns (`spans`). At sigma 0 it is the identity, and for small sigma
//! it is a step of diffusion, `b = c + sigma^2 (sum of the four neighbours - 4 c) / 2`.
//!
//! # Backward
//! `c_bar = K^T b_bar`, and `sigma_bar = <b_bar, dK/dsigma c>`.
//!
//! # Half the size
//! Where a tolerance allows it, wide discs are blurred at half the size, or at a quarter, and so on:
//! `b = D .. D K' H .. H c` (`halving`). H and D add 1 to the variance per axis, so the disc K' of the smaller image
//! has `(sigma^2 - 1) / 4`, and the variance of the whole is still sigma^2. Its slope is
//! `sigma_bar = <H^T .. b_bar, dK'/dsigma H .. c>`, with D^T in the place of `H^T`.
//!
//! What this changes: the rim is as soft as the smaller pixels are large, and the weights differ a little from
//! pixel to pixel. Constants stay constants. But the map is not self-adjoint any more, and keeps the sum of all
//! pixels under a mirror border only where both extents can be halved as often.
//!
//! # Cost
//! 1024 x 1024 pixels, four channels, `f32`, one thread, a tolerance of 0.15, in milliseconds; beside it a sampled
//! Gaussian of the same variance, to 1e-6. The whole is the blur with both gradients.
//!
//! | r | 1.5 | 3 | 6 | 7.9 | 12 | 24 |
//! |---|---|---|---|---|---|---|
//! | disc, blur | 8.7 | 14 | 19 | 24 | 7.0 | 4.0 |
//! | Gaussian, blur | 3.2 | 4.8 | 7.8 | 8.5 | 12 | 22 |
//! | disc, whole | 16 | 27 | 38 | 49 | 15 | 9.4 |
//! | Gaussian, whole | 9.5 | 13 | 21 | 24 | 33 | 58 |
//!
//! So a disc takes two to three times as long as a Gaussian up to a radius of 8, and 0.2 to 0.6 of its time from
//! there on. At its own size throughout it takes 51 and 107 ms for r = 24. By hand for these sums: a composition of
//! operations would convolve with every pixel of the disc.
//!
//! # Where it is not smooth
//! There is a jump at the sigma from which on the image is halved once more. With a fixed radius there is none.
//! `taps/disc` names the kinks of the slope.

mod halving;
mod spans;

use bokashi_core::Scalar;

use self::halving::{Axis, Halving};
use self::spans::{Spans, Strip};
use crate::border::Border;
use crate::error::RenderError;
use crate::scratch::Workbench;
use crate::taps::disc::DiscTaps;
use crate::taps::{Blur, Radius};

/// The largest sigma: discs as wide as an image of 4096 pixels.
const LARGEST_SIGMA: f64 = 1024.0;

/// Halved at the radius r, a disc has this over r of its weight elsewhere: 0.85 where it is halved once, 1.06 and
/// 1.14 where it has been halved once or twice before.
const MISPLACED: f64 = 1.2;

/// The radii from which on a disc is blurred at half the size, at the most generous tolerance and at the
/// strictest. Halved from 4 on, the errors of pictures through a lens were four times as large.
const HALVED_FROM: [f64; 2] = [8.0, 512.0];

/// A blur with a disc, and memory.
#[derive(Debug, Default)]
pub(super) struct Disc<T: Scalar> {
    taps: DiscTaps<T>,
    border: Border,
    channels: usize,
    /// The rows and the columns of the image at each size that is halved, from the largest on.
    axes: Vec<[Axis; 2]>,
    /// The shape of the smallest image.
    shape: [usize; 3],
    /// `dK/dsigma` of the smallest image; empty unless sigma's gradient could be asked for.
    slope: Vec<T>,
    /// Memory: images by size, the smallest one after the blur, images with what a clamp puts outside, pieces
    /// of work.
    images: Vec<Vec<T>>,
    blurred: Vec<T>,
    padded: [Vec<T>; 2],
    strips: Workbench<Strip<T>>,
    rows: Workbench<[Vec<T>; 2]>,
}

impl<T: Scalar> Disc<T> {
    /// Makes ready for images of `shape` and the standard deviation `sigma` above 0, in pixels.
    ///
    /// # Errors
    /// [`RenderError::BadSigma`] unless sigma is above 0 and at most 1024, and the disc within a fixed radius.
    pub(super) fn fill(
        &mut self,
        sigma: T,
        blur: &Blur,
        shape: &[usize],
    ) -> Result<(), RenderError> {
        let given = sigma.to_f64();
        let bad_sigma = |rule| Err(RenderError::BadSigma { rule, sigma: given });
        if !(given > 0.0 && sigma.is_finite()) {
            return bad_sigma("a finite sigma of at least 0");
        }
        if given > LARGEST_SIGMA {
            return bad_sigma("a sigma of at most 1024 for a disc");
        }
        let &[height, width, channels] = shape else { unreachable!("an image has three axes") };
        let sigma = sigma.widen();
        let number = T::Wide::from_f64;
        let (mut variance, mut by_sigma) = (sigma * sigma, number(2.0) * sigma);
        let halvings = halvings(given, blur.radius);
        let quarter = number(0.25);
        for _ in 0..halvings {
            variance = (variance - T::Wide::ONE) * quarter;
            by_sigma *= quarter;
        }
        self.taps.fill(variance, by_sigma);
        if let Radius::Fixed(radius) = blur.radius
            && self.taps.reach() > radius.min(HALVED_FROM[1] as usize)
        {
            return bad_sigma("a disc that lies within the fixed radius, and within 512 pixels");
        }
        (self.border, self.channels) = (blur.border, channels);
        // Doubling sees one pixel more at each size: in all, less than two of the smallest.
        let reach = (self.taps.reach() + 2) << halvings;
        let axis = |extent| Axis::new(extent, blur.border, halvings, reach);
        let mut axes = [height, width].map(axis);
        self.axes.clear();
        for _ in 0..halvings {
            self.axes.push(axes);
            axes = axes.map(|axis| Axis::whole(axis.length / 2));
        }
        self.shape = match halvings {
            0 => [height, width, channels],
            _ => [axes[0].extent, axes[1].extent, channels],
        };
        Ok(())
    }

    /// Writes the blurred image to `out`, and keeps the slope where it is asked for.
    pub(super) fn blur(&mut self, image: &[T], out: &mut [T], with_slope: bool) {
        let size = self.shape.iter().product();
        self.slope.resize(if with_slope { size } else { 0 }, T::ZERO);
        self.make_smaller(image, |size, from, to| size.halve(from, to));
        let Self { axes, images, blurred, slope, strips, .. } = self;
        let spans = Spans::new(self.shape, self.border, &self.taps);
        if axes.is_empty() {
            return spans.apply(image, strips, out, slope);
        }
        blurred.resize(size, T::ZERO);
        spans.apply(&images[axes.len() - 1], strips, blurred, slope);
        self.make_larger(out, |size, from, to| size.double(from, to));
    }

    /// Takes the gradient of the blurred image to the smallest size.
    pub(super) fn take_gradient(&mut self, b_bar: &[T]) {
        self.make_smaller(b_bar, |size, from, to| size.double_adjoint(from, to));
    }

    /// What the gradient of sigma is the product of, after [`Disc::take_gradient`].
    pub(super) fn sigma_factors<'a>(&'a self, b_bar: &'a [T]) -> [&'a [T]; 2] {
        let smallest = match self.axes.len() {
            0 => b_bar,
            halvings => &self.images[halvings - 1],
        };
        [&self.slope, smallest]
    }

    /// Writes the gradient of the image, after [`Disc::take_gradient`].
    pub(super) fn image_gradient(&mut self, b_bar: &[T], image_bar: &mut [T]) {
        let Self { axes, images, blurred, padded, strips, .. } = self;
        let spans = Spans::new(self.shape, self.border, &self.taps);
        if axes.is_empty() {
            return spans.apply_adjoint(b_bar, strips, padded, image_bar);
        }
        blurred.resize(self.shape.iter().product(), T::ZERO);
        spans.apply_adjoint(&images[axes.len() - 1], strips, padded, blurred);
        self.make_larger(image_bar, |size, from, to| size.halve_adjoint(from, to));
    }

    /// How many entries there is memory for.
    pub(super) fn len(&self) -> usize {
        let lists = self.images.iter().chain(&self.padded).chain([&self.slope, &self.blurred]);
        let rows = self.rows.total(|rows| rows.iter().map(Vec::len).sum());
        lists.map(Vec::len).sum::<usize>() + self.strips.total(Strip::len) + rows
    }

    /// Fills in the images by size, from `image` on, each by a `step` from the one before.
    fn make_smaller(&mut self, image: &[T], step: impl Fn(&Halving<'_, T>, &[T], &mut [T])) {
        let Self { axes, images, rows, channels, .. } = self;
        images.resize_with(images.len().max(axes.len()), Vec::new);
        for (k, &axes) in axes.iter().enumerate() {
            let halving = Halving::new(axes, *channels, rows);
            let (before, after) = images.split_at_mut(k);
            after[0].resize(halving.half_size(), T::ZERO);
            step(&halving, before.last().map_or(image, Vec::as_slice), &mut after[0]);
        }
    }

    /// The other way: from the blurred image to `image`, in the memory of the images in between.
    fn make_larger(&mut self, image: &mut [T], step: impl Fn(&Halving<'_, T>, &[T], &mut [T])) {
        let Self { axes, images, blurred, rows, channels, .. } = self;
        for (k, &size) in axes.iter().enumerate().rev() {
            let halving = Halving::new(size, *channels, rows);
            let (larger, smaller) = images.split_at_mut(k);
            let half = if k + 1 == axes.len() { &*blurred } else { &smaller[0] };
            match larger.last_mut() {
                Some(to) => step(&halving, half, to),
                None => step(&halving, half, image),
            }
        }
    }
}

/// How often the image is halved.
fn halvings(sigma: f64, radius: Radius) -> usize {
    let Radius::Tolerance(tolerance) = radius else { return 0 };
    let [least, most] = HALVED_FROM;
    let from = 0.5 * (MISPLACED / tolerance).clamp(least, most);
    let smaller = |variance: &f64| Some(0.25 * (variance - 1.0));
    let variances = std::iter::successors(Some(sigma * sigma), smaller);
    variances.take_while(|variance| *variance >= from * from).count()
}
