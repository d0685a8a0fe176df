//! The discrete Gaussian.
//!
//! `w_k = exp(-t) I_k(t)`, where `t = sigma^2` and the `I_k` are modified Bessel functions. An
//! impulse has these values after diffusion from pixel to pixel,
//! `dw_k/dt = (w_(k-1) - 2 w_k + w_(k+1)) / 2`. The weights of an endless window sum to 1. The
//! weights of a window of radius r are divided by their sum.
//!
//! The quotients `q_k = I_k / I_(k-1)` follow from far out inwards: `q_k = t / (2 k + t q_(k+1))`.
//! In this direction nothing overflows and errors die out.
//!
//! # Source
//! Lindeberg, *Scale-space for discrete signals*, IEEE PAMI 12(3), 1990.

use bokashi_core::Scalar;

use super::{LARGEST_RADIUS, NEGLIGIBLE, Radius, Taps};

impl<T: Scalar> Taps<T> {
    /// Fills in discrete taps without regard to the image; false where the window is endless.
    pub(super) fn fill_discrete(&mut self, sigma: T::Wide, radius: Radius) -> bool {
        let number = T::Wide::from_f64;
        let count = |k: usize| number(if k == 0 { 1.0 } else { 2.0 });
        let t = sigma * sigma;
        // A narrow discrete Gaussian has the tails of a Poisson distribution, longer than sigma
        // says.
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
                // A window of the centre alone would not change with sigma.
                (1..=end).rev().find(needed).unwrap_or(1)
            }
        };
        if radius > LARGEST_RADIUS && longest > LARGEST_RADIUS {
            return false;
        }
        let radius = radius.min(longest.max(1));
        let slope = |k: usize| {
            let (before, middle, after) = (wide[k.abs_diff(1)], wide[k], wide[k + 1]);
            sigma * ((before - middle) + (after - middle))
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
}
