//! The weights of a Gaussian window and their derivatives with respect to sigma.
//!
//! With `g_k = exp(-k^2 / (2 sigma^2))`, `|k| <= r`:
//!
//! | kernel | `w_k` | `dw_k/dsigma` |
//! |---|---|---|
//! | unnormalized | `g_k / (sqrt(2 pi) sigma)` | `w_k (k^2 / sigma^2 - 1) / sigma` |
//! | sampled | `g_k / sum g` | `w_k (k^2 - m_2) / sigma^3`, `m_2 = sum w_k k^2` |
//! | discrete | `exp(-t) I_k(t)`, `t = sigma^2` | `sigma (w_(k-1) - 2 w_k + w_(k+1))` |
//!
//! A disc is no product of two windows, and has weights of its own (`disc`).
//!
//! The sampled and the discrete weights sum to 1, and their derivatives to 0 (`discrete`).
//!
//! # Windows wider than a line
//! A line of n pixels with a mirror border repeats with period 2n, and beyond a clamp border all
//! pixels are the same. So taps that see the same pixel are summed, and no window reaches farther
//! than n. For a mirror, `u_k = w_k + w_(2n - k) + w_(2n + k) + ...`, and `u_n` is half of that
//! sum, since it stands at either end. For a clamp, `u_n = sum_(k >= n) w_k`.
//!
//! Where a tolerance asks for more than 16384 taps, the window is endless and misses nothing
//! (`endless`).

pub(crate) mod disc;
mod discrete;
mod endless;
#[cfg(test)]
mod tests;

use std::fmt;
use std::str::FromStr;

use bokashi_core::Scalar;

use crate::border::Border;
use crate::error::RenderError;

/// Which weights a window has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Kernel {
    /// Unnormalized: the density of the normal distribution at the pixels' centres, as the paper
    /// prints it. The weights' sum is a gain, which rises above 1 where sigma falls below 0.6. It
    /// is not defined at sigma 0.
    Unnormalized,
    /// The same weights, divided by their sum. A constant image stays as it is, and sigma 0 is the
    /// identity. Below sigma 0.2 the gradient of sigma is close to 0.
    #[default]
    Sampled,
    /// The discrete Gaussian: an impulse after diffusion from pixel to pixel. Its variance is
    /// exactly sigma squared, its sum is 1, and two blurs in a row are one blur of the summed
    /// variance. Sigma 0 is the identity, and small sigmas have a gradient. With
    /// [`Radius::Tolerance`] a wide blur takes no longer than a narrow one.
    Discrete,
    /// A disc of the radius 2 sigma, as a lens blurs what is out of focus: each pixel has the share of the disc that
    /// it covers. Its variance is exactly sigma squared per axis, and its sum is 1. Sigma 0 is the identity, small
    /// sigmas have a gradient, and sigma is at most 1024. With a [`Radius::Tolerance`] of 0.15 a wide disc takes no
    /// longer than a narrow one.
    Disc,
}

/// The words of [`Kernel`] in files and on command lines.
const WORDS: [(&str, Kernel); 4] = [
    ("unnormalized", Kernel::Unnormalized),
    ("sampled", Kernel::Sampled),
    ("discrete", Kernel::Discrete),
    ("disc", Kernel::Disc),
];

impl fmt::Display for Kernel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(WORDS[*self as usize].0)
    }
}

impl FromStr for Kernel {
    type Err = RenderError;

    fn from_str(word: &str) -> Result<Self, RenderError> {
        let known = WORDS.iter().find(|(known, _)| *known == word);
        known
            .map(|&(_, kernel)| kernel)
            .ok_or_else(|| RenderError::Kernel { given: word.to_owned() })
    }
}

/// How far a window reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Radius {
    /// This many pixels to either side, at most 16384, whatever sigma is. A disc has an end, and a sigma is refused
    /// at which it does not lie within, or reaches beyond 512 pixels: it is exact, and never cut off.
    Fixed(usize),
    /// As far as needed to miss at most this share of an endless window's weight, per axis. Where
    /// that is beyond 16384 pixels, at a sigma of some thousand, the window is endless and misses
    /// nothing. The error of a wide blur with discrete weights may lie anywhere, not only far out.
    ///
    /// Of a disc at most this share of the weight lies elsewhere than it should: the disc is blurred at half the
    /// size from a radius on that the tolerance allows, at a quarter from twice that radius on, and so on. It is
    /// 1.2 pixels over the tolerance, but at least 8 pixels, for a tolerance of 0.15, and at most 512 pixels,
    /// where 2.4e-3 of the weight lie elsewhere.
    Tolerance(f64),
}

/// The kind of a blur: weights, border, radius.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blur {
    /// The window's weights.
    pub kernel: Kernel,
    /// What the window sees beyond the border of the image.
    pub border: Border,
    /// How far the window reaches.
    pub radius: Radius,
}

impl Default for Blur {
    /// Sampled weights, a mirror border, and a window that misses at most 1e-6 of the weight.
    fn default() -> Self {
        let (kernel, border) = (Kernel::default(), Border::default());
        Self { kernel, border, radius: Radius::Tolerance(1e-6) }
    }
}

/// A tap below this share of the largest tap is cut off. It is below the rounding of any sum that
/// it enters, and `f32` numbers this small take many times as long as others.
const NEGLIGIBLE: f64 = 1e-18;

/// The largest number of taps on one side that are added up. Wider windows are endless, for which
/// there is a formula.
pub(crate) const LARGEST_RADIUS: usize = 1 << 14;

/// Half of a symmetric window: index 0 is the centre.
#[derive(Debug, Default, Clone)]
pub(crate) struct Taps<T: Scalar> {
    pub(crate) weights: Vec<T>,
    /// The derivatives of the weights with respect to sigma.
    pub(crate) slopes: Vec<T>,
    /// The sum of all derivatives: exactly 0 where the weights are normalized.
    pub(crate) slope_sum: T,
    /// The sum of the weights beyond each tap on its side.
    pub(crate) tails: Vec<T>,
    /// Memory: weights of an endless window.
    wide: Vec<T::Wide>,
}

impl<T: Scalar> Taps<T> {
    /// Fills in the taps for standard deviation `sigma`, in pixels, along lines of `extents` pixels:
    /// one half window for each of the two axes.
    ///
    /// # Errors
    /// [`RenderError::BadSigma`] unless sigma is finite and positive, and, for the unnormalized
    /// kernel, large enough for the weights and their derivatives to be finite.
    pub(crate) fn fill(
        taps: &mut [Self; 2],
        sigma: T,
        blur: &Blur,
        extents: [usize; 2],
    ) -> Result<(), RenderError> {
        if taps[0].fill_whole(sigma, blur)? {
            let [first, second] = taps;
            second.weights.clone_from(&first.weights);
            second.slopes.clone_from(&first.slopes);
            second.slope_sum = first.slope_sum;
            for (taps, extent) in taps.iter_mut().zip(extents) {
                taps.fold(blur.border, extent);
            }
        } else {
            for (taps, extent) in taps.iter_mut().zip(extents) {
                taps.fill_endless(sigma, blur, extent);
            }
        }
        if blur.border == Border::Clamp {
            taps.iter_mut().for_each(Self::fill_tails);
        }
        Ok(())
    }

    /// Fills in the taps without regard to the image; false where the window is endless.
    fn fill_whole(&mut self, sigma: T, blur: &Blur) -> Result<bool, RenderError> {
        let bad_sigma = |rule| RenderError::BadSigma { rule, sigma: sigma.to_f64() };
        if !(sigma > T::ZERO && sigma.is_finite()) {
            return Err(bad_sigma(match blur.kernel {
                Kernel::Unnormalized => "a finite and positive sigma for the unnormalized kernel",
                _ => "a finite sigma of at least 0",
            }));
        }
        let sigma = sigma.widen();
        if blur.kernel == Kernel::Discrete {
            return Ok(self.fill_discrete(sigma, blur.radius));
        }
        let shape = |k: usize| {
            let t = T::Wide::from_f64(k as f64) / sigma;
            (-(t * t) * T::Wide::from_f64(0.5)).exp()
        };
        let is_negligible = |k: usize| shape(k).to_f64() < NEGLIGIBLE;
        let Some(radius) = cut_radius(blur.radius, sigma.to_f64(), is_negligible) else {
            return Ok(false);
        };
        let count = |k: usize| T::Wide::from_f64(if k == 0 { 1.0 } else { 2.0 });
        let square = |k: usize| T::Wide::from_f64((k * k) as f64);
        let total: T::Wide = match blur.kernel {
            Kernel::Sampled => (0..=radius).map(|k| count(k) * shape(k)).sum(),
            _ => T::Wide::from_f64(f64::sqrt(2.0 * std::f64::consts::PI)) * sigma,
        };
        let weight = |k: usize| shape(k) / total;
        self.weights.clear();
        self.weights.extend((0..=radius).map(|k| T::narrow(weight(k))));

        self.slopes.clear();
        match blur.kernel {
            Kernel::Sampled => {
                let m2: T::Wide = (0..=radius).map(|k| count(k) * square(k) * weight(k)).sum();
                // Where only the centre is left, the slope is 0, and not 0 / sigma^3.
                let slope = |k: usize| match m2 == T::Wide::ZERO {
                    true => T::Wide::ZERO,
                    false => weight(k) * (square(k) - m2) / (sigma * sigma * sigma),
                };
                self.slopes.extend((0..=radius).map(|k| T::narrow(slope(k))));
                self.slope_sum = T::ZERO;
            }
            _ => {
                let slope = |k: usize| {
                    let t = T::Wide::from_f64(k as f64) / sigma;
                    weight(k) * (t * t - T::Wide::ONE) / sigma
                };
                self.slopes.extend((0..=radius).map(|k| T::narrow(slope(k))));
                self.slope_sum = T::narrow((0..=radius).map(|k| count(k) * slope(k)).sum());
            }
        }
        if !(self.weights[0].is_finite() && self.slopes[0].is_finite()) {
            return Err(bad_sigma("a sigma at which the unnormalized kernel does not overflow"));
        }
        Ok(true)
    }

    /// Sums taps that see the same pixel of a line of `extent` pixels.
    fn fold(&mut self, border: Border, extent: usize) {
        if self.radius() <= extent || border == Border::Zero {
            return;
        }
        let source = |k: usize| match border {
            Border::Mirror => (k % (2 * extent)).min(2 * extent - k % (2 * extent)),
            _ => k.min(extent),
        };
        for taps in [&mut self.weights, &mut self.slopes] {
            for k in extent + 1..taps.len() {
                // The centre sees both the tap at k and the tap at -k.
                let count = if source(k) == 0 { 2.0 } else { 1.0 };
                let tap = taps[k];
                taps[source(k)] += T::from_f64(count) * tap;
            }
            taps.truncate(extent + 1);
        }
    }

    fn fill_tails(&mut self) {
        self.tails.clear();
        self.tails.resize(self.weights.len(), T::ZERO);
        for k in (1..self.weights.len()).rev() {
            self.tails[k - 1] = self.tails[k] + self.weights[k];
        }
    }

    pub(crate) fn radius(&self) -> usize {
        self.weights.len() - 1
    }

    /// The slopes up to `reach`; farther slopes see nothing but zeros.
    pub(crate) fn window(&self, reach: usize) -> Window<'_, T> {
        let beyond: T = self.slopes[reach + 1..].iter().copied().sum();
        Window { slopes: &self.slopes[..=reach], slope_sum: self.slope_sum - (beyond + beyond) }
    }
}

/// Half of the slopes of a symmetric window over all the pixels that count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Window<'a, T> {
    pub(crate) slopes: &'a [T],
    pub(crate) slope_sum: T,
}

/// Checks a radius, whatever sigma is.
pub(crate) fn check_radius(radius: Radius) -> Result<(), RenderError> {
    match radius {
        Radius::Tolerance(tolerance) if !(tolerance > 0.0 && tolerance < 1.0) => {
            let rule = "a tolerance between 0 and 1";
            Err(RenderError::BadRadius { rule, value: tolerance })
        }
        Radius::Fixed(radius) if radius > LARGEST_RADIUS => {
            let rule = "a window radius of at most 16384 pixels";
            Err(RenderError::BadRadius { rule, value: radius as f64 })
        }
        _ => Ok(()),
    }
}

/// The radius that a blur asks for, or less where taps from there on are negligible. `None` where the window is
/// endless.
fn cut_radius(radius: Radius, sigma: f64, is_negligible: impl Fn(usize) -> bool) -> Option<usize> {
    let radius = match radius {
        Radius::Fixed(radius) => radius,
        Radius::Tolerance(tolerance) => smallest_radius(sigma, tolerance)?,
    };
    Some((1..=radius).find(|&k| is_negligible(k)).map_or(radius, |k| k - 1))
}

/// The smallest radius whose window misses at most the share `tolerance` of an endless window's
/// weight, per axis. `None` where it is larger than 16384, or where sigma is so large that none is
/// looked for.
fn smallest_radius(sigma: f64, tolerance: f64) -> Option<usize> {
    let shape = |k: usize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
    // Beyond 9.2 sigma taps are negligible.
    let end = (9.2 * sigma).ceil();
    if end > 2.0 * LARGEST_RADIUS as f64 {
        return None;
    }
    let end = end as usize;
    let total: f64 = 1.0 + 2.0 * (1..=end).map(shape).sum::<f64>();
    let mut missing = 0.0;
    for k in (1..=end).rev() {
        missing += 2.0 * shape(k);
        if missing > tolerance * total {
            return (k <= LARGEST_RADIUS).then_some(k);
        }
    }
    Some(0)
}
