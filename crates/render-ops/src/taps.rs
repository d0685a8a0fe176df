//! The weights of a Gaussian window and their derivatives with respect to sigma.
//!
//! With `g_k = exp(-k^2 / (2 sigma^2))`, `|k| <= r`:
//!
//! | kernel | `w_k` | `dw_k/dsigma` |
//! |---|---|---|
//! | seed | `g_k / (sqrt(2 pi) sigma)` | `w_k (k^2 / sigma^2 - 1) / sigma` |
//! | sampled | `g_k / sum g` | `w_k (k^2 - m_2) / sigma^3`, `m_2 = sum w_k k^2` |
//!
//! | discrete | `exp(-t) I_k(t)`, `t = sigma^2` | `sigma (w_(k-1) - 2 w_k + w_(k+1))` |
//!
//! The sampled weights sum to 1, their derivatives to 0. The discrete ones do without an end; cut off
//! at r they are divided by their sum as well. Their quotients `q_k = I_k / I_(k-1)` are found from far
//! out inwards, `q_k = t / (2 k + t q_(k+1))`, where nothing overflows and errors die out (Lindeberg,
//! *Scale-space for discrete signals*, IEEE PAMI 12(3), 1990).
//!
//! # Windows wider than a line
//! A line of n pixels with a mirror border repeats with period 2n, and beyond a clamp border all
//! pixels are the same. So taps that see the same pixel are summed, and no window needs to reach
//! farther than n: `u_k = w_k + w_(2n - k) + w_(2n + k) + ...` for a mirror, `u_n` half of the sum
//! for k = n, which stands at either end; `u_n = sum_(k >= n) w_k` for a clamp.
//!
//! # Endless windows
//! Where a tolerance asks for more than 16384 taps, the window misses nothing. So wide a Gaussian
//! has the sum `sqrt(2 pi) sigma` to all digits, which makes the two kernels one, and a sum over
//! its taps in steps of 2n is, by Poisson's formula, `u_k = (1 + 2 sum_m e_m cos(pi m k / n)) / 2n`
//! with `e_m = exp(-(s_m sigma)^2 / 2)`, `s_m = pi m / n`; `de_m/dsigma = -s_m^2 sigma e_m`. Of the
//! discrete kernel the same is true, with `s_m = 2 sin(pi m / 2n)`; and as its kurtosis is
//! `1 / sigma^2`, its taps are those of a Gaussian times `1 + (x^4 - 6 x^2 + 3) / (24 sigma^2)`,
//! `x = k / sigma`, with an error of about `sigma^-4`.

use std::f64::consts::PI;

use bokashi_core::Scalar;

use crate::border::Border;
use crate::error::RenderError;

/// Which weights a window has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Kernel {
    /// The density of the normal distribution at the pixels' centres, as the paper prints it. Its
    /// sum is a gain that grows above 1 as sigma falls below 0.6; it is not defined at sigma 0.
    Seed,
    /// The same, divided by its sum: constant images stay as they are, and sigma 0 is the
    /// identity. Below sigma 0.2 hardly anything moves with sigma.
    #[default]
    Sampled,
    /// The Gaussian of a world that is made of pixels: what diffusion from pixel to pixel makes of an
    /// impulse. Its variance is sigma squared exactly and its sum 1; two blurs in a row are one of the
    /// summed variance; sigma 0 is the identity, and moves as soon as sigma does. With a
    /// tolerance, a blur that is wide takes no longer than one that is not.
    Discrete,
}

/// How far a window reaches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Radius {
    /// This many pixels to either side, at most 16384, whatever sigma is.
    Fixed(usize),
    /// As far as it must for the window to miss at most this share of an endless window's weight,
    /// per axis. Where that is beyond 16384 pixels, which takes a sigma of some thousand, the window
    /// is endless, and misses nothing.
    Tolerance(f64),
}

/// What kind of blur.
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

/// A tap below this share of the largest is cut off: it is below the rounding of any sum that it
/// enters, and in `f32` numbers this small cost many times the time of others.
const NEGLIGIBLE: f64 = 1e-18;

/// The largest number of taps on one side that are added up, in pixels: farther ones belong to an
/// endless window, for which there is a formula.
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
    /// [`RenderError::BadSigma`] unless sigma is finite and positive, and, for the seed kernel,
    /// large enough for the weights and their derivatives to be finite.
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
                Kernel::Seed => "a finite and positive sigma for the seed kernel",
                Kernel::Sampled | Kernel::Discrete => "a finite sigma of at least 0",
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
        let radius = match blur.radius {
            Radius::Fixed(radius) => radius,
            Radius::Tolerance(tolerance) => match smallest_radius(sigma.to_f64(), tolerance) {
                Some(radius) => radius,
                None => return Ok(false),
            },
        };
        let is_negligible = |k: usize| shape(k).to_f64() < NEGLIGIBLE;
        let radius = (1..=radius).find(|&k| is_negligible(k)).map_or(radius, |k| k - 1);

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
                // Where only the centre is left, nothing moves with sigma: not 0 / sigma^3.
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
            return Err(bad_sigma("a sigma at which the seed kernel does not overflow"));
        }
        Ok(true)
    }

    /// Fills in discrete taps without regard to the image; false where the window is endless.
    fn fill_discrete(&mut self, sigma: T::Wide, radius: Radius) -> bool {
        let number = T::Wide::from_f64;
        let count = |k: usize| number(if k == 0 { 1.0 } else { 2.0 });
        let t = sigma * sigma;
        // The tails of a narrow one are those of a Poisson distribution, and longer than sigma says.
        let end = (9.5 * sigma.to_f64() + 20.0).ceil();
        if end > 2.0 * LARGEST_RADIUS as f64 {
            return false;
        }
        let end = end as usize;
        let wide = &mut self.wide;
        wide.clear();
        wide.resize(end + 2, T::Wide::ZERO);
        for k in (1..=end).rev() {
            wide[k] = t / (number(2.0 * k as f64) + t * wide[k + 1]);
        }
        wide[0] = T::Wide::ONE;
        let mut total = T::Wide::ONE;
        for k in 1..=end {
            let weight = wide[k - 1] * wide[k];
            wide[k] = weight;
            total += weight + weight;
        }
        wide.iter_mut().for_each(|weight| *weight = *weight / total);

        let largest = wide[0].to_f64();
        let counted = |k: &usize| wide[*k].to_f64() >= NEGLIGIBLE * largest;
        let longest = (0..=end).rev().find(counted).unwrap_or(0);
        let radius = match radius {
            Radius::Fixed(radius) => radius,
            Radius::Tolerance(tolerance) => {
                let mut missing = 0.0;
                let needed = |k: &usize| {
                    missing += 2.0 * wide[*k].to_f64();
                    missing > tolerance
                };
                // With the centre alone nothing would move with sigma.
                (1..=end).rev().find(needed).unwrap_or(1)
            }
        };
        if radius > LARGEST_RADIUS && longest > LARGEST_RADIUS {
            return false;
        }
        let radius = radius.min(longest.max(1));
        let slope = |k: usize| {
            let (before, own, after) = (wide[k.abs_diff(1)], wide[k], wide[k + 1]);
            sigma * ((before - own) + (after - own))
        };
        let sum: T::Wide = (0..=radius).map(|k| count(k) * wide[k]).sum();
        let slope_of_sum: T::Wide = (0..=radius).map(|k| count(k) * slope(k)).sum();
        self.weights.clear();
        self.weights.extend((0..=radius).map(|k| T::narrow(wide[k] / sum)));
        self.slopes.clear();
        let slopes = (0..=radius).map(|k| (slope(k) - wide[k] / sum * slope_of_sum) / sum);
        self.slopes.extend(slopes.map(T::narrow));
        self.slope_sum = T::ZERO;
        true
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
                // The centre sees both the tap at k and the one at -k.
                let count = if source(k) == 0 { 2.0 } else { 1.0 };
                let tap = taps[k];
                taps[source(k)] += T::from_f64(count) * tap;
            }
            taps.truncate(extent + 1);
        }
    }

    /// Fills in the taps of an endless window along a line of `extent` pixels.
    fn fill_endless(&mut self, sigma: T, blur: &Blur, extent: usize) {
        let number = T::Wide::from_f64;
        let (sigma, n, half) = (sigma.widen(), extent as f64, number(0.5));
        let is_discrete = blur.kernel == Kernel::Discrete;
        let border = blur.border;
        let count = |k: usize| number(if k == 0 { 1.0 } else { 2.0 });
        let tap = |k: usize| -> [T::Wide; 2] {
            let t = number(k as f64) / sigma;
            let weight = (-half * t * t).exp() / (number(f64::sqrt(2.0 * PI)) * sigma);
            let slope = weight * (t * t - T::Wide::ONE) / sigma;
            if !is_discrete {
                return [weight, slope];
            }
            let (square, spread) = (t * t, number(24.0) * sigma * sigma);
            let more = (square * square - number(6.0) * square + number(3.0)) / spread;
            let more_slope = (number(12.0) * square - number(4.0) * square * square) / spread
                - more - more;
            let one = T::Wide::ONE;
            [weight * (one + more), slope * (one + more) + weight * more_slope / sigma]
        };
        // Half of what the taps below n leave of the whole, whose slope is 0.
        let rest = || -> [T::Wide; 2] {
            let mut rest = [half, T::Wide::ZERO];
            for k in 0..extent {
                let taps = tap(k);
                (0..2).for_each(|i| rest[i] -= half * count(k) * taps[i]);
            }
            rest
        };
        let folded = |k: usize| -> [T::Wide; 2] {
            let (mut sum, mut slope) = (T::Wide::ONE, T::Wide::ZERO);
            for m in 1_usize.. {
                let step = match is_discrete {
                    true => number(2.0 * (0.5 * PI * m as f64 / n).sin()),
                    false => number(PI * m as f64 / n),
                };
                let e = (-half * (step * sigma).powi(2)).exp();
                if e.to_f64() < NEGLIGIBLE {
                    break;
                }
                // The phase is reduced first: the cosine of a large number has few digits.
                let cosine = number(2.0 * (PI * (m * k % (2 * extent)) as f64 / n).cos());
                sum += e * cosine;
                slope -= step * step * sigma * e * cosine;
            }
            let share = number(if k == extent { 0.25 } else { 0.5 } / n);
            [share * sum, share * slope]
        };
        self.weights.clear();
        self.slopes.clear();
        let mut slope_sum = T::Wide::ZERO;
        for k in 0..=extent {
            let [weight, slope] = match border {
                Border::Mirror => folded(k),
                Border::Clamp if k == extent => rest(),
                Border::Zero | Border::Clamp => tap(k),
            };
            slope_sum += count(k) * slope;
            self.weights.push(T::narrow(weight));
            self.slopes.push(T::narrow(slope));
        }
        // A mirror and a clamp keep the whole; of a zero border the rest of the window is dark.
        self.slope_sum = if border == Border::Zero { T::narrow(slope_sum) } else { T::ZERO };
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

    /// The slopes up to `reach`, where those beyond see nothing but zeros.
    pub(crate) fn window(&self, reach: usize) -> Window<'_, T> {
        let beyond: T = self.slopes[reach + 1..].iter().copied().sum();
        Window { slopes: &self.slopes[..=reach], slope_sum: self.slope_sum - (beyond + beyond) }
    }
}

/// Half of the slopes of a symmetric window that reaches over all the pixels that count.
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

/// The smallest radius whose window misses at most the share `tolerance` of an endless window's
/// weight, per axis; `None` where it is larger than 16384, or sigma so large that no shorter
/// window is looked for.
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

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    fn taps(sigma: f64, kernel: Kernel, radius: Radius) -> Taps<f64> {
        let mut taps = [Taps::default(), Taps::default()];
        let blur = Blur { kernel, border: Border::Zero, radius };
        Taps::fill(&mut taps, sigma, &blur, [1, 1]).unwrap();
        let [taps, _] = taps;
        taps
    }

    /// The half windows of a line of `extent` pixels, folded and, above sigma 3561, endless.
    fn folded(sigma: f64, border: Border, extent: usize, radius: Radius) -> Taps<f64> {
        let mut taps = [Taps::default(), Taps::default()];
        let blur = Blur { kernel: Kernel::Sampled, border, radius };
        Taps::fill(&mut taps, sigma, &blur, [3, extent]).unwrap();
        let [_, taps] = taps;
        taps
    }

    #[test]
    fn folding_keeps_the_sums_and_reaches_no_farther_than_the_line_is_long() {
        for border in [Border::Mirror, Border::Clamp] {
            for (extent, sigma) in [(1, 0.8), (1, 40.0), (4, 2.0), (7, 100.0), (7, 1e5), (2, 1e300)]
            {
                let taps = folded(sigma, border, extent, Radius::Tolerance(1e-9));
                assert!(taps.radius() <= extent);
                assert_relative_eq!(whole_sum(&taps.weights), 1.0, max_relative = 1e-13);
                assert!(whole_sum(&taps.slopes).abs() <= 1e-13);
                assert!(taps.weights.iter().all(|&weight| weight >= 0.0));
            }
        }
    }

    #[test]
    fn the_endless_window_is_the_sum_over_all_taps_that_count() {
        for border in [Border::Zero, Border::Mirror, Border::Clamp] {
            for extent in [1, 2, 9, 50, 700] {
                for sigma in [4.0, 50.0, 400.0] {
                    let mut endless = Taps::default();
                    endless.fill_endless(sigma, &Blur { border, ..Blur::default() }, extent);
                    let all = Radius::Fixed((9.2 * sigma) as usize);
                    let long = folded(sigma, border, extent, all);
                    for k in 0..=extent.min(long.radius()) {
                        assert_relative_eq!(endless.weights[k], long.weights[k], epsilon = 1e-15);
                        assert_relative_eq!(endless.slopes[k], long.slopes[k], epsilon = 1e-15);
                    }
                    assert!(
                        endless.weights[long.radius().min(extent) + 1..].iter().all(|&w| w < 1e-15)
                    );
                }
            }
        }
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
