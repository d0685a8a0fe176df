//! The weights of a Gaussian window and their derivatives with respect to sigma.
//!
//! With `g_k = exp(-k^2 / (2 sigma^2))`, `|k| <= r`:
//!
//! | kernel | `w_k` | `dw_k/dsigma` |
//! |---|---|---|
//! | seed | `g_k / (sqrt(2 pi) sigma)` | `w_k (k^2 / sigma^2 - 1) / sigma` |
//! | sampled | `g_k / sum g` | `w_k (k^2 - m_2) / sigma^3`, `m_2 = sum w_k k^2` |
//!
//! The sampled weights sum to 1, their derivatives to 0.

use bokashi_core::Scalar;

use super::{Blur, Kernel, Radius};
use crate::error::RenderError;

/// A tap below this share of the largest is cut off: it is below the rounding of any sum that it
/// enters, and in `f32` numbers this small cost many times the time of others.
const NEGLIGIBLE: f64 = 1e-18;

/// The largest window radius, in pixels: beyond it the padded image would be the larger part.
const LARGEST_RADIUS: usize = 1 << 14;

/// Half of a symmetric window: index 0 is the centre.
#[derive(Debug, Default, Clone)]
pub(super) struct Taps<T> {
    pub(super) weights: Vec<T>,
    /// The derivatives of the weights with respect to sigma.
    pub(super) slopes: Vec<T>,
    /// The sum of all derivatives: exactly 0 where the weights are normalized.
    pub(super) slope_sum: T,
}

impl<T: Scalar> Taps<T> {
    /// Fills in the taps for standard deviation `sigma`, in pixels.
    ///
    /// # Errors
    /// [`RenderError::BadSigma`] unless sigma is finite and positive, and, for the seed kernel,
    /// large enough for the weights and their derivatives to be finite;
    /// [`RenderError::BadRadius`] for a tolerance outside (0, 1) or a radius above 16384.
    pub(super) fn fill(&mut self, sigma: T, blur: &Blur) -> Result<(), RenderError> {
        let bad_sigma = |rule| RenderError::BadSigma { rule, sigma: sigma.to_f64() };
        if !(sigma > T::ZERO && sigma.is_finite()) {
            return Err(bad_sigma(match blur.kernel {
                Kernel::Seed => "a finite and positive sigma for the seed kernel",
                Kernel::Sampled => "a finite sigma of at least 0",
            }));
        }
        let sigma = sigma.widen();
        let shape = |k: usize| {
            let t = T::Wide::from_f64(k as f64) / sigma;
            (-(t * t) * T::Wide::from_f64(0.5)).exp()
        };
        let radius = match blur.radius {
            Radius::Fixed(radius) => radius,
            Radius::Tolerance(tolerance) => smallest_radius(sigma.to_f64(), tolerance)?,
        };
        if radius > LARGEST_RADIUS {
            return Err(RenderError::BadRadius {
                rule: "a window radius of at most 16384 pixels",
                value: radius as f64,
            });
        }
        let is_negligible = |k: usize| shape(k).to_f64() < NEGLIGIBLE;
        let radius = (1..=radius).find(|&k| is_negligible(k)).map_or(radius, |k| k - 1);

        let count = |k: usize| T::Wide::from_f64(if k == 0 { 1.0 } else { 2.0 });
        let square = |k: usize| T::Wide::from_f64((k * k) as f64);
        let total: T::Wide = match blur.kernel {
            Kernel::Sampled => (0..=radius).map(|k| count(k) * shape(k)).sum(),
            Kernel::Seed => T::Wide::from_f64(f64::sqrt(2.0 * std::f64::consts::PI)) * sigma,
        };
        let weight = |k: usize| shape(k) / total;
        self.weights.clear();
        self.weights.extend((0..=radius).map(|k| T::narrow(weight(k))));

        self.slopes.clear();
        match blur.kernel {
            Kernel::Sampled => {
                let m2: T::Wide = (0..=radius).map(|k| count(k) * square(k) * weight(k)).sum();
                // Where only the centre is left, nothing moves with sigma: not 0 / sigma^3.
                let slope = |k: usize| match m2 == T::Wide::ZERO {
                    true => T::Wide::ZERO,
                    false => weight(k) * (square(k) - m2) / (sigma * sigma * sigma),
                };
                self.slopes.extend((0..=radius).map(|k| T::narrow(slope(k))));
                self.slope_sum = T::ZERO;
            }
            Kernel::Seed => {
                let slope = |k: usize| {
                    let t = T::Wide::from_f64(k as f64) / sigma;
                    weight(k) * (t * t - T::Wide::ONE) / sigma
                };
                self.slopes.extend((0..=radius).map(|k| T::narrow(slope(k))));
                self.slope_sum = T::narrow((0..=radius).map(|k| count(k) * slope(k)).sum());
            }
        }
        if !(self.weights[0].is_finite() && self.slopes[0].is_finite()) {
            return Err(bad_sigma("a sigma at which the seed kernel does not overflow"));
        }
        Ok(())
    }

    pub(super) fn radius(&self) -> usize {
        self.weights.len() - 1
    }

    /// The slopes up to `reach`, where those beyond see nothing but zeros.
    pub(super) fn window(&self, reach: usize) -> Window<'_, T> {
        let beyond: T = self.slopes[reach + 1..].iter().copied().sum();
        Window { slopes: &self.slopes[..=reach], slope_sum: self.slope_sum - (beyond + beyond) }
    }
}

/// Half of the slopes of a symmetric window that reaches over all the pixels that count.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window<'a, T> {
    pub(super) slopes: &'a [T],
    pub(super) slope_sum: T,
}

/// Checks what is wrong with a radius whatever sigma is.
pub(super) fn check_radius(radius: Radius) -> Result<(), RenderError> {
    match radius {
        Radius::Tolerance(tolerance) if !(tolerance > 0.0 && tolerance < 1.0) => {
            let rule = "a tolerance between 0 and 1";
            Err(RenderError::BadRadius { rule, value: tolerance })
        }
        _ => Ok(()),
    }
}

/// The smallest radius whose window misses at most the share `tolerance` of an endless window's
/// weight, per axis.
fn smallest_radius(sigma: f64, tolerance: f64) -> Result<usize, RenderError> {
    let shape = |k: usize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
    // Beyond 9.2 sigma taps are negligible.
    let end = (9.2 * sigma).ceil();
    if end > 2.0 * LARGEST_RADIUS as f64 {
        return Err(RenderError::BadRadius {
            rule: "a window radius of at most 16384 pixels, from a tolerance sigma of at most 3561",
            value: sigma,
        });
    }
    let end = end as usize;
    let total: f64 = 1.0 + 2.0 * (1..=end).map(shape).sum::<f64>();
    let mut missing = 0.0;
    for k in (1..=end).rev() {
        missing += 2.0 * shape(k);
        if missing > tolerance * total {
            return Ok(k);
        }
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;
    use crate::gaussian_blur::Border;

    fn taps(sigma: f64, kernel: Kernel, radius: Radius) -> Taps<f64> {
        let mut taps = Taps::default();
        taps.fill(sigma, &Blur { kernel, border: Border::Zero, radius }).unwrap();
        taps
    }

    fn whole_sum(half: &[f64]) -> f64 {
        half[0] + 2.0 * half[1..].iter().sum::<f64>()
    }

    #[test]
    fn sampled_weights_sum_to_one_and_their_slopes_to_zero() {
        for sigma in [1e-150, 1e-3, 0.1, 0.3, 1.0, 4.0, 30.0] {
            let taps = taps(sigma, Kernel::Sampled, Radius::Tolerance(1e-6));
            assert_relative_eq!(whole_sum(&taps.weights), 1.0, max_relative = 1e-14);
            assert!(taps.slopes.iter().all(|slope| slope.is_finite()));
            assert!(whole_sum(&taps.slopes).abs() < 1e-14);
        }
    }

    #[test]
    fn the_seed_kernels_gain_is_that_of_the_formula_as_printed() {
        // The square of the one-dimensional sum, from numbers worked out for equation (2).
        for (sigma, gain, places) in [(0.1, 15.9, 0.05), (0.3, 1.80, 0.005), (0.5, 1.029, 0.0005)] {
            let sum = whole_sum(&taps(sigma, Kernel::Seed, Radius::Fixed(8)).weights);
            assert_relative_eq!(sum * sum, gain, epsilon = places);
        }
    }

    #[test]
    fn slopes_are_the_difference_quotients_of_the_weights() {
        for kernel in [Kernel::Seed, Kernel::Sampled] {
            for sigma in [0.3, 1.0, 2.8] {
                let h = 1e-6 * sigma;
                let [low, mid, high] = [sigma - h, sigma, sigma + h]
                    .map(|sigma| taps(sigma, kernel, Radius::Fixed(9)));
                // The number of taps that are not negligible may differ by one.
                let pairs = low.weights.iter().zip(&high.weights).zip(&mid.slopes);
                for ((low, high), slope) in pairs {
                    let quotient = (high - low) / (2.0 * h);
                    assert_relative_eq!(quotient, *slope, max_relative = 1e-6, epsilon = 1e-9);
                }
            }
        }
    }

    #[test]
    fn a_tolerance_bounds_the_weight_that_the_window_misses() {
        for tolerance in [1e-2, 1e-4, 1e-8] {
            for sigma in [0.2, 1.0, 3.7] {
                let radius = smallest_radius(sigma, tolerance).unwrap();
                let shape = |k: usize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
                let weight = |r: usize| 1.0 + 2.0 * (1..=r).map(shape).sum::<f64>();
                let missing = |r: usize| 1.0 - weight(r) / weight(60);
                assert!(missing(radius) <= tolerance);
                assert!(radius == 0 || missing(radius - 1) > tolerance);
            }
        }
    }

    #[test]
    fn negligible_taps_are_cut_off() {
        assert_eq!(taps(1.0, Kernel::Sampled, Radius::Fixed(40)).radius(), 9);
    }
}
