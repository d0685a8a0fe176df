//! One update of Adam or AMSGrad.
//!
//! # Adam
//! `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`,
//! `x -= a m / (1 - b1^t) / (sqrt(v / (1 - b2^t)) + epsilon)` in the t-th update, `t = 1, 2, ...`:
//! steps of about `a` whatever the scale of the gradient. At a constant rate it is unstable once it
//! has converged: `v` shrinks with the gradient, and a small gradient then makes a large step. A
//! rate that decays, or a larger epsilon, removes that.
//!
//! # AMSGrad
//! `u = max(u, v / (1 - b2^t))` and `x -= a m / (1 - b1^t) / (sqrt(u) + epsilon)`: the maximum of
//! the *corrected* averages. The paper corrects nothing, so its first steps have the length
//! `a (1 - b1) / sqrt(1 - b2)`, about 3 a, and grow from there. Other implementations correct the
//! maximum of the raw averages. Their denominators fall while `1 - b2^t` grows, which the paper
//! rules out. Here the maximum is taken last, so denominators never fall, and the first step is
//! `a`, as in Adam. In turn the first gradients keep their full weight for good.
//!
//! # Uniform parameters
//! Every entry is divided by the same number, the largest of their `sqrt(v / (1 - b2^t))`, or of their
//! `sqrt(u)`: the maximum norm, as UniformAdam has it.
//!
//! # Counts
//! `t` is a `u64`. The powers are taken in `f64`: they are right to rounding for any count, and 0
//! where they underflow.
//!
//! # Source
//! Kingma and Ba, *Adam: a method for stochastic optimization*, ICLR 2015, algorithm 1. Reddi, Kale and Kumar, *On the
//! convergence of Adam and beyond*, ICLR 2018, algorithm 2. Uniform: Nicolet, Jacobson and Jakob, *Large steps in
//! inverse rendering of geometry*, ACM Transactions on Graphics 40(6), 2021, section 3.5.

use bokashi_core::Scalar;

use super::entries::{first_not_finite, value_of, vanishes};
use crate::parameter::Parameter;

/// The constants of one update, in the numbers of the fit.
pub(super) struct Adam<T> {
    keeps_the_greatest: bool,
    /// The learning rate over `1 - b1^t`.
    rate: T,
    /// The inverse of `1 - b2^t`.
    unbias: T,
    /// `b1` and `1 - b1`.
    first: [T; 2],
    /// `b2` and `1 - b2`.
    second: [T; 2],
    epsilon: T,
}

/// The moments of one entry: `m`, `v`, and for AMSGrad `u`.
type Moments<T> = [T; 3];

impl<T: Scalar> Adam<T> {
    /// The `t`-th update.
    pub(super) fn new(
        [beta1, beta2, epsilon]: [f64; 3],
        keeps_the_greatest: bool,
        t: u64,
        rate: f64,
    ) -> Self {
        let decayed = |beta: f64| beta.powf(t as f64);
        Self {
            keeps_the_greatest,
            rate: T::from_f64(rate / (1.0 - decayed(beta1))),
            unbias: T::from_f64(1.0 / (1.0 - decayed(beta2))),
            first: [beta1, 1.0 - beta1].map(T::from_f64),
            second: [beta2, 1.0 - beta2].map(T::from_f64),
            epsilon: T::from_f64(epsilon),
        }
    }

    /// The moments and the entry after an update along `g`. `least` is a lower bound of the squared denominator.
    #[inline(always)]
    fn entry<const GREATEST: bool>(
        &self,
        x: T,
        [m, v, u]: Moments<T>,
        g: T,
        least: T,
    ) -> (T, Moments<T>) {
        let m = self.first[0] * m + self.first[1] * g;
        let v = self.second[0] * v + self.second[1] * (g * g);
        let unbiased = v * self.unbias;
        let u = if GREATEST { u.maximum_or_nan(unbiased) } else { unbiased };
        let square = u.maximum_or_nan(least);
        (x + -self.rate * m / (square.sqrt() + self.epsilon), [m, v, u])
    }

    /// Updates `parameter`. No gradient counts as a gradient of zeros. Returns the number of entries whose updates
    /// vanished.
    pub(super) fn step(&self, parameter: &mut Parameter<T>, gradient: Option<&[T]>) -> usize {
        match (gradient, self.keeps_the_greatest) {
            (Some(g), false) => self.step_by::<false>(parameter, |k| g[k]),
            (Some(g), true) => self.step_by::<true>(parameter, |k| g[k]),
            (None, false) => self.step_by::<false>(parameter, |_| T::ZERO),
            (None, true) => self.step_by::<true>(parameter, |_| T::ZERO),
        }
    }

    #[inline]
    fn step_by<const GREATEST: bool>(
        &self,
        parameter: &mut Parameter<T>,
        gradient: impl Fn(usize) -> T,
    ) -> usize {
        let size = parameter.raw.size();
        let least = self.least::<GREATEST>(parameter, &gradient);
        let Parameter { raw, first, second, greatest, .. } = parameter;
        let raw = raw.data_mut();
        let (first, second) = (&mut first[..size], &mut second[..size]);
        let greatest = &mut greatest[..if GREATEST { size } else { 0 }];
        let mut vanished = 0;
        for k in 0..size {
            let u = if GREATEST { greatest[k] } else { T::ZERO };
            let (x, [m, v, u]) =
                self.entry::<GREATEST>(raw[k], [first[k], second[k], u], gradient(k), least);
            vanished += usize::from(vanishes(raw[k], x, m, self.rate));
            (raw[k], first[k], second[k]) = (x, m, v);
            if GREATEST {
                greatest[k] = u;
            }
        }
        vanished
    }

    /// For a uniform parameter, the largest square that any of its entries would divide by; otherwise 0.
    fn least<const GREATEST: bool>(
        &self,
        parameter: &Parameter<T>,
        gradient: &impl Fn(usize) -> T,
    ) -> T {
        if !parameter.is_uniform {
            return T::ZERO;
        }
        let Parameter { second, greatest, .. } = parameter;
        (0..parameter.raw.size()).fold(T::ZERO, |largest, k| {
            let u = if GREATEST { greatest[k] } else { T::ZERO };
            let moments = [T::ZERO, second[k], u];
            let (_, [.., u]) = self.entry::<GREATEST>(T::ZERO, moments, gradient(k), T::ZERO);
            largest.maximum_or_nan(u)
        })
    }

    /// The first value, or the first average square, that [`Adam::step`] would make infinite or NaN. Moments that are
    /// not there yet become zeros.
    pub(super) fn steps_out_of_range(
        &self,
        parameter: &mut Parameter<T>,
        gradient: Option<&[T]>,
    ) -> Option<T> {
        let size = parameter.raw.size();
        parameter.first.resize(size, T::ZERO);
        parameter.second.resize(size, T::ZERO);
        if self.keeps_the_greatest {
            parameter.greatest.resize(size, T::ZERO);
        }
        match (gradient, self.keeps_the_greatest) {
            (Some(g), false) => self.out_of_range::<false>(parameter, |k| g[k]),
            (Some(g), true) => self.out_of_range::<true>(parameter, |k| g[k]),
            (None, false) => self.out_of_range::<false>(parameter, |_| T::ZERO),
            (None, true) => self.out_of_range::<true>(parameter, |_| T::ZERO),
        }
    }

    #[inline]
    fn out_of_range<const GREATEST: bool>(
        &self,
        parameter: &Parameter<T>,
        gradient: impl Fn(usize) -> T,
    ) -> Option<T> {
        let size = parameter.raw.size();
        let least = self.least::<GREATEST>(parameter, &gradient);
        let (raw, mapping) = (&parameter.raw.data()[..size], parameter.mapping);
        let (first, second) = (&parameter.first[..size], &parameter.second[..size]);
        let greatest = &parameter.greatest[..if GREATEST { size } else { 0 }];
        first_not_finite(size, |k| {
            let u = if GREATEST { greatest[k] } else { T::ZERO };
            let (x, [_, _, u]) =
                self.entry::<GREATEST>(raw[k], [first[k], second[k], u], gradient(k), least);
            // An infinite average would freeze its entry: it has to show.
            if u.is_finite() { value_of(mapping, x) } else { u }
        })
    }
}
