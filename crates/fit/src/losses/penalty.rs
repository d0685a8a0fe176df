//! Means of a penalty of the difference between an image and a reference.
//!
//! # Forward
//! `L = sum_p w_p sum_c f(x_pc - r_pc) / (C sum_p w_p)`, summed in [`Scalar::Wide`]; without weights,
//! the mean of all entries. Where `w_p` is 0 nothing is read of p: neither NaN nor infinity comes
//! through. Where all weights are 0, L is 0 and has no gradient.
//!
//! # Backward
//! `x_bar = w f'(x - r) L_bar / (C sum w)`, `r_bar` is its negative, and
//! `w_bar_p = sum_c (f_pc - L) L_bar / (C sum w)`.
//!
//! # Where it is not smooth
//! The absolute error where `x = r`: its slope there is taken as 0, the middle of the subgradients.
//! The gradient of the relative error holds the denominator fixed, so it is not the derivative of L.
//!
//! # Source
//! Huber, *Robust estimation of a location parameter*, Annals of Mathematical Statistics 35(1), 1964.
//! Charbonnier et al., *Two deterministic half-quadratic regularization algorithms for computed imaging*, ICIP
//! 1994; it is computed as `d^2 / (sqrt(d^2 + s^2) + s)`, so that small differences keep their digits.
//! Relative: Lehtinen et al., *Noise2Noise: learning image restoration without clean data*, ICML 2018,
//! section 3.3; their denominator is `(x + 0.01)^2`.

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use bokashi_core::{
    Accumulator, Accumulators, Inputs, Keep, Kept, Mask, Op, Outputs, Scalar, Shape, TensorError,
    Var, sum,
};

use crate::sign::sign;

/// What a difference `d = x - r` between an image's entry x and its reference r costs.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Penalty {
    /// `d^2`.
    Squared,
    /// `|d|`, the L1 error: outliers count no more than their size.
    Absolute,
    /// `d^2 / 2` up to `|d| = delta`, and from there on the line `delta (|d| - delta / 2)`.
    Huber {
        /// Where the line begins, above 0.
        delta: f64,
    },
    /// `sqrt(d^2 + scale^2) - scale`: as `|d|`, with its kink at 0 rounded. Differences well below the scale count
    /// by their square.
    Charbonnier {
        /// What is a small difference, above 0.
        scale: f64,
    },
    /// `d^2 / (x^2 + epsilon)`: for radiance of high range, where bright pixels would outweigh all
    /// others. The gradient takes the denominator as a constant: otherwise too bright an image could
    /// be made better by more brightness. So the expectation over noise in the reference is right.
    Relative {
        /// What keeps dark pixels from weighing too much, above 0; usually 0.01.
        epsilon: f64,
    },
}

/// A penalty in numbers: its value and its slope by the difference.
pub(crate) trait Rule<S>: Copy + Send + Sync + 'static {
    /// The name of its mean.
    const NAME: &'static str;

    /// f of the entry x and the difference d.
    fn value(self, x: S, d: S) -> S;

    /// f'.
    fn slope(self, x: S, d: S) -> S;
}

#[derive(Clone, Copy)]
pub(crate) struct Squared;
#[derive(Clone, Copy)]
pub(crate) struct Absolute;
/// With its delta.
#[derive(Clone, Copy)]
pub(crate) struct Huber<S>(pub(crate) S);
/// With its scale.
#[derive(Clone, Copy)]
pub(crate) struct Charbonnier<S>(pub(crate) S);
/// With the root of its epsilon.
#[derive(Clone, Copy)]
struct Relative<S>(S);

impl<S: Scalar> Rule<S> for Squared {
    const NAME: &'static str = "mean_squared_error";

    #[inline(always)]
    fn value(self, _x: S, d: S) -> S {
        d * d
    }

    #[inline(always)]
    fn slope(self, _x: S, d: S) -> S {
        d + d
    }
}

impl<S: Scalar> Rule<S> for Absolute {
    const NAME: &'static str = "mean_absolute_error";

    #[inline(always)]
    fn value(self, _x: S, d: S) -> S {
        d.abs()
    }

    #[inline(always)]
    fn slope(self, _x: S, d: S) -> S {
        sign(d)
    }
}

impl<S: Scalar> Rule<S> for Huber<S> {
    const NAME: &'static str = "mean_huber_error";

    #[inline(always)]
    fn value(self, _x: S, d: S) -> S {
        let half = S::from_f64(0.5);
        let size = d.abs();
        if size > self.0 { self.0 * (size - half * self.0) } else { half * d * d }
    }

    #[inline(always)]
    fn slope(self, _x: S, d: S) -> S {
        if d.abs() > self.0 { sign(d) * self.0 } else { d }
    }
}

impl<S: Scalar> Rule<S> for Charbonnier<S> {
    const NAME: &'static str = "mean_charbonnier_error";

    #[inline(always)]
    fn value(self, _x: S, d: S) -> S {
        let square = d * d;
        square / ((square + self.0 * self.0).sqrt() + self.0)
    }

    #[inline(always)]
    fn slope(self, _x: S, d: S) -> S {
        d / (d * d + self.0 * self.0).sqrt()
    }
}

impl<S: Scalar> Relative<S> {
    /// `1 / sqrt(x^2 + epsilon)` in two factors, so that no square leaves the range of the numbers.
    #[inline(always)]
    fn shares(self, x: S) -> [S; 2] {
        let larger = x.abs().maximum_or_nan(self.0);
        let [a, b] = [x / larger, self.0 / larger];
        [S::ONE / larger, S::ONE / (a * a + b * b).sqrt()]
    }
}

impl<S: Scalar> Rule<S> for Relative<S> {
    const NAME: &'static str = "mean_relative_error";

    #[inline(always)]
    fn value(self, x: S, d: S) -> S {
        let [a, b] = self.shares(x);
        let ratio = d * a * b;
        ratio * ratio
    }

    #[inline(always)]
    fn slope(self, x: S, d: S) -> S {
        let [a, b] = self.shares(x);
        let ratio = d * a * b;
        (ratio + ratio) * b * a
    }
}

/// Which entries count, and how much. A weight stands for a row of entries: the axes that an image
/// has beyond those of its weights.
enum Weights {
    All,
    Mask(Mask),
    /// Input 2.
    Input,
}

/// Weights in numbers.
#[derive(Clone, Copy)]
enum Given<'a, T> {
    Mask(&'a [bool]),
    Numbers(&'a [T]),
}

impl<T: Scalar> Given<'_, T> {
    #[inline(always)]
    fn at(&self, p: usize) -> T::Wide {
        match self {
            Self::Mask(truth) => {
                if truth[p] {
                    T::Wide::ONE
                } else {
                    T::Wide::ZERO
                }
            }
            Self::Numbers(numbers) => numbers[p].widen(),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Mask(truth) => truth.len(),
            Self::Numbers(numbers) => numbers.len(),
        }
    }
}

/// The mean of a penalty of input 0 against input 1.
struct MeanError<R> {
    rule: R,
    weights: Weights,
}

/// What a forward pass leaves: the loss, and C times the sum of the weights.
type Sums<S> = [S; 2];

impl<R> MeanError<R> {
    /// The weights, with the shape they have.
    fn given<'a, T: Scalar>(
        &'a self,
        input: impl FnOnce() -> (&'a [T], Shape),
    ) -> Option<(Given<'a, T>, Shape)> {
        match &self.weights {
            Weights::All => None,
            Weights::Mask(mask) => Some((Given::Mask(mask.data()), mask.shape().clone())),
            Weights::Input => {
                let (numbers, shape) = input();
                Some((Given::Numbers(numbers), shape))
            }
        }
    }
}

impl<T: Scalar, R: Rule<T::Wide>> Op<T> for MeanError<R> {
    type Saved = Sums<T::Wide>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        R::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let (operation, rule) = (R::NAME, self.rule);
        let (shape, r_shape) = (inputs.shape(0), inputs.shape(1));
        if shape != r_shape {
            let rule = "an image and a reference of one shape".into();
            let shapes = Box::new([shape.clone(), r_shape.clone()]);
            return Err(TensorError::Mismatch { operation, rule, shapes });
        }
        let (x, r) = (inputs.data(0), inputs.data(1));
        let r = &r[..x.len()];
        let error = |k: usize| {
            let x = x[k].widen();
            rule.value(x, x - r[k].widen())
        };
        let given = self.given(|| (inputs.data(2), inputs.shape(2).clone()));
        let [total, count] = match given {
            None if x.is_empty() => {
                let rule = "at least one entry".into();
                return Err(TensorError::Shape { operation, rule, shape: shape.clone() });
            }
            None => [sum::<T>(x.len(), error), T::Wide::from_f64(x.len() as f64)],
            Some((weights, of_weights)) => {
                if !shape.starts_with(&of_weights) {
                    let rule = "weights of the shape of the image, or of its first axes".into();
                    let shapes = Box::new([shape.clone(), of_weights]);
                    return Err(TensorError::Mismatch { operation, rule, shapes });
                }
                let rows = weights.len();
                let inner = x.len().checked_div(rows).unwrap_or_default();
                if let Given::Numbers(numbers) = weights
                    && let Some(w) = numbers.iter().find(|w| !(**w >= T::ZERO && w.is_finite()))
                {
                    let rule = "finite weights from 0 up".into();
                    return Err(TensorError::Value { operation, rule, value: w.to_f64() });
                }
                let count = sum::<T>(rows, |p| weights.at(p)) * T::Wide::from_f64(inner as f64);
                if !count.is_finite() {
                    let (rule, value) = ("weights of a finite sum".into(), count.to_f64());
                    return Err(TensorError::Value { operation, rule, value });
                }
                let row = |p: usize| {
                    let weight = weights.at(p);
                    if weight.is_same(T::Wide::ZERO) {
                        return weight;
                    }
                    weight * (p * inner..(p + 1) * inner).map(error).sum()
                };
                [sum::<T>(rows, row), count]
            }
        };
        let mean = if count > T::Wide::ZERO { total / count } else { T::Wide::ZERO };
        *saved = [mean, count];
        outputs.push([])[0] = T::narrow(mean);
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        let keep = Keep::NOTHING.input(0).input(1);
        if matches!(self.weights, Weights::Input) { keep.input(2) } else { keep }
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (x, r, rule) = (kept.input(0), kept.input(1), self.rule);
        let [mean, count] = *saved;
        let nothing = count == T::Wide::ZERO;
        let factor = if nothing { T::Wide::ZERO } else { kept.only_upstream()[0].widen() / count };
        let slope = |x: T, r: T| rule.slope(x.widen(), x.widen() - r.widen());
        let given = self.given(|| (kept.input(2), kept.input_shape(2).clone()));
        let Some((weights, _)) = given else {
            if let Some(x_bar) = gradients.get(0) {
                x_bar.add_zipped([x, r], |[x, r]| T::narrow(factor * slope(x, r)));
            }
            if let Some(r_bar) = gradients.get(1) {
                r_bar.add_zipped([x, r], |[x, r]| T::narrow(-(factor * slope(x, r))));
            }
            return;
        };
        let rows = weights.len();
        let inner = x.len().checked_div(rows).unwrap_or_default();
        for (i, factor) in [(0, factor), (1, -factor)] {
            let Some(bar) = gradients.get(i) else { continue };
            add_rows(bar, inner, |p, entries, put| {
                let weight = if nothing { T::Wide::ZERO } else { weights.at(p) };
                if weight.is_same(T::Wide::ZERO) {
                    return entries.iter_mut().for_each(|entry| put(entry, T::ZERO));
                }
                let share = factor * weight;
                for (c, entry) in entries.iter_mut().enumerate() {
                    let k = p * inner + c;
                    put(entry, T::narrow(share * slope(x[k], r[k])));
                }
            });
        }
        if matches!(self.weights, Weights::Input)
            && let Some(w_bar) = gradients.get(2)
        {
            let excess = |k: usize| rule.value(x[k].widen(), x[k].widen() - r[k].widen()) - mean;
            add_rows(w_bar, 1, |p, entry, put| {
                let total = || (p * inner..(p + 1) * inner).map(excess).sum::<T::Wide>();
                let term = if nothing { T::ZERO } else { T::narrow(factor * total()) };
                put(&mut entry[0], term);
            });
        }
    }
}

/// Calls `work(p, row p, put)` for each row of `inner` entries; `put(entry, term)` adds a term.
fn add_rows<T: Scalar>(
    sum: &mut Accumulator<T>,
    inner: usize,
    work: impl Fn(usize, &mut [T], fn(&mut T, T)) + Send + Sync,
) {
    let (sum, fresh) = sum.entries_or_fresh();
    let put: fn(&mut T, T) = if fresh { |sum, term| *sum = term } else { |sum, term| *sum += term };
    let inner = inner.max(1);
    let rows = (ENTRIES_PER_PIECE / inner).max(1);
    for_each_piece_mut(sum, rows * inner, |piece, entries| {
        for (k, row) in entries.chunks_mut(inner).enumerate() {
            work(piece * rows + k, row, put);
        }
    });
}

/// `number` in the precision of the fit, where it is finite and above 0 there.
pub(crate) fn positive<T: Scalar>(
    operation: &'static str,
    name: &'static str,
    number: f64,
) -> Result<T::Wide, TensorError> {
    let own = T::from_f64(number);
    if own > T::ZERO && own.is_finite() {
        return Ok(T::Wide::from_f64(number));
    }
    let rule = format!("a finite {name} above 0 in the precision of the fit").into();
    Err(TensorError::Value { operation, rule, value: number })
}

fn record<'t, T: Scalar>(
    inputs: &[Var<'t, T>],
    weights: Weights,
    penalty: Penalty,
) -> Result<Var<'t, T>, TensorError> {
    let tape = inputs[0].tape();
    match penalty {
        Penalty::Squared => tape.apply(MeanError { rule: Squared, weights }, inputs),
        Penalty::Absolute => tape.apply(MeanError { rule: Absolute, weights }, inputs),
        Penalty::Huber { delta } => {
            let rule = Huber(positive::<T>("mean_huber_error", "delta", delta)?);
            tape.apply(MeanError { rule, weights }, inputs)
        }
        Penalty::Charbonnier { scale } => {
            let rule = Charbonnier(positive::<T>("mean_charbonnier_error", "scale", scale)?);
            tape.apply(MeanError { rule, weights }, inputs)
        }
        Penalty::Relative { epsilon } => {
            let rule = Relative(positive::<T>("mean_relative_error", "epsilon", epsilon)?.sqrt());
            tape.apply(MeanError { rule, weights }, inputs)
        }
    }
}

/// The mean of the penalty over all entries of `image` against `reference`, of any one shape; returns
/// `[]`.
///
/// # Errors
/// [`TensorError::Mismatch`] unless both have the same shape; [`TensorError::Shape`] for images without
/// an entry; [`TensorError::Value`] for a delta, scale or epsilon that is not finite and above 0.
pub fn mean_error<'t, T: Scalar>(
    image: Var<'t, T>,
    reference: Var<'t, T>,
    penalty: Penalty,
) -> Result<Var<'t, T>, TensorError> {
    record(&[image, reference], Weights::All, penalty)
}

/// The mean of the penalty, weighted; returns `[]`. The weights have the shape of the image or of its
/// first axes: `[H, W]` weighs the pixels of `[H, W, C]`. They have a gradient, too.
///
/// Where a weight is 0, nothing is read of the image: NaN and infinity stay out. 0 without a gradient
/// where all weights are 0.
///
/// # Errors
/// [`TensorError::Mismatch`] for shapes that do not fit; [`TensorError::Value`] for a weight that is
/// negative or not finite, for weights whose sum overflows, and for a delta, scale or epsilon that is not
/// finite and above 0.
pub fn weighted_error<'t, T: Scalar>(
    image: Var<'t, T>,
    reference: Var<'t, T>,
    weights: Var<'t, T>,
    penalty: Penalty,
) -> Result<Var<'t, T>, TensorError> {
    record(&[image, reference, weights], Weights::Input, penalty)
}

/// The mean of the penalty over what the mask shows; returns `[]`. The mask has the shape of the image
/// or of its first axes: `[H, W]` for the pixels of `[H, W, C]`.
///
/// Nothing is read of what it does not show: NaN and infinity stay out. 0 without a gradient where it
/// shows nothing.
///
/// # Errors
/// [`TensorError::Mismatch`] for shapes that do not fit; [`TensorError::Value`] for a delta, scale or
/// epsilon that is not finite and above 0.
pub fn masked_error<'t, T: Scalar>(
    image: Var<'t, T>,
    reference: Var<'t, T>,
    mask: &Mask,
    penalty: Penalty,
) -> Result<Var<'t, T>, TensorError> {
    record(&[image, reference], Weights::Mask(mask.clone()), penalty)
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    const ALL: [Penalty; 5] = [
        Penalty::Squared,
        Penalty::Absolute,
        Penalty::Huber { delta: 0.5 },
        Penalty::Charbonnier { scale: 6.0 },
        Penalty::Relative { epsilon: 0.25 },
    ];

    /// By the formulas of [`Penalty`].
    fn expected(penalty: Penalty, x: f64, r: f64) -> [f64; 2] {
        let d = x - r;
        match penalty {
            Penalty::Squared => [d * d, 2.0 * d],
            Penalty::Absolute => [d.abs(), if d == 0.0 { 0.0 } else { d.signum() }],
            Penalty::Huber { delta } if d.abs() <= delta => [0.5 * d * d, d],
            Penalty::Huber { delta } => [delta * (d.abs() - 0.5 * delta), delta * d.signum()],
            Penalty::Charbonnier { scale } => [d.hypot(scale) - scale, d / d.hypot(scale)],
            Penalty::Relative { epsilon } => {
                [d * d / (x * x + epsilon), 2.0 * d / (x * x + epsilon)]
            }
        }
    }

    fn images() -> [Tensor<f64>; 2] {
        let x = Tensor::from_flat_fn([3, 2, 2], |k| (k * 7 % 12) as f64 / 4.0 - 1.0);
        let r = Tensor::from_flat_fn([3, 2, 2], |k| if k == 5 { x.data()[5] } else { 0.125 });
        [x, r]
    }

    #[test]
    fn values_and_gradients_are_those_of_the_formulas() {
        let [x, r] = images();
        let weights = Tensor::from_flat_fn([3, 2], |k| k as f64 / 2.0);
        for penalty in ALL {
            let tape = Tape::new();
            let [image, reference, weighs] = [&x, &r, &weights].map(|tensor| tape.leaf(tensor));
            let plain = mean_error(image, reference, penalty).unwrap();
            let weighted = weighted_error(image, reference, weighs, penalty).unwrap();
            let of = |k: usize| expected(penalty, x.data()[k], r.data()[k]);
            let mean = (0..12).map(|k| of(k)[0]).sum::<f64>() / 12.0;
            approx::assert_relative_eq!(plain.item(), mean, max_relative = 1e-14);
            // The weights are 0, 1/2, 1, ... : 7.5 in all, for two entries each.
            let weight = |k: usize| weights.data()[k / 2];
            let mean = (0..12).map(|k| weight(k) * of(k)[0]).sum::<f64>() / 15.0;
            approx::assert_relative_eq!(weighted.item(), mean, max_relative = 1e-14);
            let [plain, weighted] = [plain, weighted].map(|loss| loss.backward().unwrap());
            for k in 0..12 {
                let at = |variable| plain.get_or_zeros(variable).data()[k];
                approx::assert_relative_eq!(at(image), of(k)[1] / 12.0, epsilon = 1e-15);
                assert_eq!(at(reference), -at(image));
                let at = |variable| weighted.get_or_zeros(variable).data()[k];
                approx::assert_relative_eq!(
                    at(image),
                    weight(k) * of(k)[1] / 15.0,
                    epsilon = 1e-15
                );
                assert_eq!(at(reference), -at(image));
            }
            for p in 0..6 {
                let total = of(2 * p)[0] + of(2 * p + 1)[0] - 2.0 * mean;
                let found = weighted.get_or_zeros(weighs).data()[p];
                approx::assert_relative_eq!(found, total / 15.0, epsilon = 1e-15);
            }
        }
    }

    #[test]
    fn a_mask_is_weights_of_0_and_1_and_the_whole_mask_is_none() {
        let [x, r] = images();
        let mask = Mask::from_flat_fn([3, 2], |p| p % 3 > 0);
        let weights = Tensor::from_flat_fn([3, 2], |p| f64::from(p % 3 > 0));
        for penalty in ALL {
            let tape = Tape::new();
            let [image, reference] = [&x, &r].map(|tensor| tape.leaf(tensor));
            let losses = [
                masked_error(image, reference, &mask, penalty).unwrap(),
                weighted_error(image, reference, tape.leaf(&weights), penalty).unwrap(),
                masked_error(image, reference, &Mask::full([3, 2, 2], true), penalty).unwrap(),
                mean_error(image, reference, penalty).unwrap(),
            ];
            let found = losses.map(|loss| {
                let gradients = loss.backward().unwrap();
                (loss.item(), gradients.get(image).cloned(), gradients.get(reference).cloned())
            });
            assert_eq!(found[0], found[1]);
            approx::assert_relative_eq!(found[2].0, found[3].0, max_relative = 1e-15);
            assert_eq!(found[2].1, found[3].1);
        }
    }

    #[test]
    fn what_is_masked_is_not_read_and_nothing_shown_is_0() {
        let bad = [f64::NAN, f64::INFINITY];
        let x = Tensor::from_flat_fn([4], |k| if k < 2 { bad[k] } else { k as f64 });
        for penalty in ALL {
            let tape = Tape::new();
            let (image, reference) = (tape.leaf(&x), tape.leaf_full([4], 0.5));
            let shown = Mask::from_flat_fn([4], |k| k == 3);
            let loss = masked_error(image, reference, &shown, penalty).unwrap();
            assert_eq!(loss.item(), expected(penalty, 3.0, 0.5)[0]);
            let slope = expected(penalty, 3.0, 0.5)[1];
            let gradients = loss.backward().unwrap();
            assert_eq!(gradients.get(image), Some(&Tensor::from([0.0, 0.0, 0.0, slope])));
            for weights in [[0.0; 4], [-0.0; 4]].map(|weights| tape.leaf(&Tensor::from(weights))) {
                let nothing = weighted_error(image, reference, weights, penalty).unwrap();
                let gradients = nothing.backward().unwrap();
                assert_eq!(nothing.item(), 0.0);
                for variable in [image, reference, weights] {
                    assert!(gradients.get_or_zeros(variable).data().iter().all(|g| *g == 0.0));
                }
            }
        }
        let tape = Tape::<f32>::new();
        let none = tape.leaf(&Tensor::zeros([0, 3]));
        let nothing = masked_error(none, none, &Mask::full([0], true), Penalty::Squared).unwrap();
        assert_eq!(nothing.item(), 0.0);
    }

    #[test]
    fn a_relative_error_has_a_result_wherever_its_ratio_has() {
        for scale in [1e-200, 1e-160, 1.0, 1e160, 1e300] {
            let tape = Tape::<f64>::new();
            let (x, r) = (tape.leaf_scalar(3.0 * scale), tape.constant_scalar(scale));
            let penalty = Penalty::Relative { epsilon: 0.01 };
            let loss = mean_error(x, r, penalty).unwrap();
            let slope = loss.backward().unwrap().get(x).unwrap().item();
            // d / sqrt(x^2 + 0.01) for d = 2 scale.
            let root = f64::hypot(3.0 * scale, 0.1);
            let ratio = 2.0 * scale / root;
            approx::assert_relative_eq!(loss.item(), ratio * ratio, max_relative = 1e-14);
            approx::assert_relative_eq!(slope, 2.0 * ratio / root, max_relative = 1e-14);
        }
    }
}
