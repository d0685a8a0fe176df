//! Windows without an end.
//!
//! The taps of so wide a Gaussian sum to `sqrt(2 pi) sigma` in all digits, so the unnormalized and
//! the sampled kernel are the same. Poisson's formula gives the sum over its taps in steps of 2n:
//! `u_k = (1 + 2 sum_m e_m cos(pi m k / n)) / 2n` with `e_m = exp(-(s_m sigma)^2 / 2)`,
//! `s_m = pi m / n` and `de_m/dsigma = -s_m^2 sigma e_m`.
//!
//! The same holds for the discrete kernel, with `s_m = 2 sin(pi m / 2n)`. Its excess kurtosis is
//! `1 / sigma^2`. With `x = k / sigma`, its taps are therefore the Gaussian's times
//! `1 + (x^4 - 6 x^2 + 3) / (24 sigma^2)`. The error is about `sigma^-4`.

use std::f64::consts::PI;

use bokashi_core::Scalar;

use super::{Blur, Kernel, NEGLIGIBLE, Taps};
use crate::border::Border;

impl<T: Scalar> Taps<T> {
    /// Fills in the taps of an endless window along a line of `extent` pixels.
    pub(super) fn fill_endless(&mut self, sigma: T, blur: &Blur, extent: usize) {
        let number = T::Wide::from_f64;
        let (sigma, n, half) = (sigma.widen(), extent as f64, number(0.5));
        let is_discrete = blur.kernel == Kernel::Discrete;
        let border = blur.border;
        let count = |k: usize| number(if k == 0 { 1.0 } else { 2.0 });
        let tap = |k: usize| endless_tap(sigma, k, is_discrete);
        // Half of what the taps below n leave of the sum of all taps, which does not change.
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
        // A mirror and a clamp border keep all of the weight; a zero border loses what lies
        // outside.
        self.slope_sum = if border == Border::Zero { T::narrow(slope_sum) } else { T::ZERO };
    }
}

/// The weight of tap k of an endless window, and its slope by sigma.
fn endless_tap<S: Scalar>(sigma: S, k: usize, is_discrete: bool) -> [S; 2] {
    let number = S::from_f64;
    let t = number(k as f64) / sigma;
    let weight = (-number(0.5) * t * t).exp() / (number(f64::sqrt(2.0 * PI)) * sigma);
    let slope = weight * (t * t - S::ONE) / sigma;
    if !is_discrete {
        return [weight, slope];
    }
    let (square, spread) = (t * t, number(24.0) * sigma * sigma);
    let more = (square * square - number(6.0) * square + number(3.0)) / spread;
    let more_slope = (number(12.0) * square - number(4.0) * square * square) / spread - more - more;
    let one = S::ONE;
    [weight * (one + more), slope * (one + more) + weight * more_slope / sigma]
}
