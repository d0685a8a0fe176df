//! Absolute errors of depths, perhaps up to a scale and a shift.
//!
//! # Forward
//! Over the n pixels that count, `L = mean |e_i|`, with `e_i = s d_i + t - r_i`. The alignment (s, t) is
//! (1, 0), or the one that makes `sum e_i^2` smallest. With a scale alone `s = sum d r / sum d^2`. With a
//! shift as well, depths are taken from their means: `s = sum d' r' / sum d'^2`, `t = mean r - s mean d`.
//! Where all d are equal to within rounding no scale is known; it is then 0, and t is the mean of r.
//!
//! # Backward
//! The alignment moves with the depths. With `g_i = sign(e_i) L_bar / n`, less its mean where there is a
//! shift, `q = sum g d' / sum d'^2` and depths from their means likewise:
//! `d_bar_i = s g_i + q (r'_i - 2 s d'_i)`, `r_bar_i = -g_i + q d'_i`.
//!
//! # Where it is not smooth
//! Where `e_i = 0`, with slope 0 there; where a pixel begins to count; where no scale is known: s has no
//! gradient there.
//!
//! # Source
//! The alignment: Ranftl, Lasinger, Hafner, Schindler and Koltun, *Towards robust monocular depth
//! estimation*, IEEE Transactions on Pattern Analysis and Machine Intelligence 44(3), 2022, section 5.

use bokashi_core::{
    Accumulators, Inputs, Keep, Kept, Mask, Op, Outputs, Scalar, TensorError, Var, sum,
};

use crate::sign::sign;

/// How depths are aligned with their reference before they are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum DepthAlignment {
    /// No alignment: both are distances in one unit.
    #[default]
    None,
    /// By a factor, as between reconstructions of unknown scale.
    Scale,
    /// By a factor and an offset, as for depths that a network estimates from one image.
    ScaleAndShift,
}

/// Input 0: depths; input 1: the reference.
struct DepthError {
    mask: Option<Mask>,
    alignment: DepthAlignment,
}

/// What a backward pass reads.
#[derive(Debug, Default)]
struct Fitted<S> {
    /// s.
    scale: S,
    /// The means of d and r, or 0 without a shift.
    means: [S; 2],
    /// `sum d'^2`; 0 where the scale has no gradient.
    square: S,
    /// n.
    count: usize,
}

impl DepthError {
    /// Whether pixel k counts: both have a depth there.
    #[inline(always)]
    fn counts<T: Scalar>(&self, d: &[T], r: &[T], k: usize) -> bool {
        let is_shown = self.mask.as_ref().is_none_or(|mask| mask.data()[k]);
        // A NaN among the depths is passed on.
        let is_behind = d[k] <= T::ZERO;
        let is_beyond = d[k] > T::ZERO && !d[k].is_finite();
        is_shown && !is_behind && !is_beyond && r[k] > T::ZERO && r[k].is_finite()
    }
}

impl<T: Scalar> Op<T> for DepthError {
    type Saved = Fitted<T::Wide>;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "depth_error"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        let shape = inputs.shape(0);
        let of_mask = self.mask.as_ref().map(Mask::shape);
        for (other, rule) in [
            (Some(inputs.shape(1)), "depths and a reference of one shape"),
            (of_mask, "depths and a mask of one shape"),
        ] {
            if let Some(other) = other.filter(|other| *other != shape) {
                let shapes = Box::new([shape.clone(), other.clone()]);
                let (operation, rule) = ("depth_error", rule.into());
                return Err(TensorError::Mismatch { operation, rule, shapes });
            }
        }
        let (d, r) = (inputs.data(0), inputs.data(1));
        let zero = T::Wide::ZERO;
        let over = |term: &(dyn Fn(T::Wide, T::Wide) -> T::Wide + Sync)| {
            sum::<T>(d.len(), |k| {
                if self.counts(d, r, k) { term(d[k].widen(), r[k].widen()) } else { zero }
            })
        };
        let count = (0..d.len()).filter(|&k| self.counts(d, r, k)).count();
        let n = T::Wide::from_f64(count.max(1) as f64);
        let mut fitted = Fitted { scale: T::Wide::ONE, means: [zero; 2], square: zero, count };
        if self.alignment == DepthAlignment::ScaleAndShift {
            fitted.means = [over(&|d, _| d) / n, over(&|_, r| r) / n];
        }
        if self.alignment != DepthAlignment::None {
            let [of_d, of_r] = fitted.means;
            let square = over(&|d, _| (d - of_d) * (d - of_d));
            let whole = over(&|d, _| d * d);
            // Each d is known to its rounding, which is all that is left of equal ones.
            let rounding = 8.0 * f64::EPSILON * f64::EPSILON;
            if square <= T::Wide::from_f64(rounding) * whole {
                fitted.scale = zero;
            } else {
                fitted.scale = over(&|d, r| (d - of_d) * (r - of_r)) / square;
                fitted.square = square;
            }
        }
        let Fitted { scale, means: [of_d, of_r], .. } = fitted;
        let total = over(&|d, r| (scale * (d - of_d) - (r - of_r)).abs());
        outputs.push([])[0] = T::narrow(total / n);
        *saved = fitted;
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0).input(1)
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Self::Saved,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let (d, r) = (kept.input(0), kept.input(1));
        let Fitted { scale, means: [of_d, of_r], square, count, .. } = *saved;
        let (zero, two) = (T::Wide::ZERO, T::Wide::from_f64(2.0));
        let n = T::Wide::from_f64(count.max(1) as f64);
        let share = kept.only_upstream()[0].widen() / n;
        let centred = |k: usize| (d[k].widen() - of_d, r[k].widen() - of_r);
        let slope = |k: usize| {
            let (d, r) = centred(k);
            share * sign(scale * d - r)
        };
        let over = |term: &(dyn Fn(usize) -> T::Wide + Sync)| {
            sum::<T>(d.len(), |k| if self.counts(d, r, k) { term(k) } else { zero })
        };
        let has_shift = self.alignment == DepthAlignment::ScaleAndShift;
        let mean = if has_shift { over(&slope) / n } else { zero };
        let q = if square > zero { over(&|k| slope(k) * centred(k).0) / square } else { zero };
        let indices = |k: usize| self.counts(d, r, k);
        if let Some(d_bar) = gradients.get(0) {
            d_bar.add_each(|k| {
                if !indices(k) {
                    return T::ZERO;
                }
                let (d, r) = centred(k);
                T::narrow(scale * (slope(k) - mean) + q * (r - two * scale * d))
            });
        }
        if let Some(r_bar) = gradients.get(1) {
            r_bar.add_each(|k| {
                if !indices(k) {
                    return T::ZERO;
                }
                T::narrow(q * centred(k).0 - (slope(k) - mean))
            });
        }
    }
}

/// The mean absolute error of `depths` against `reference`, distances of any one shape, over the pixels
/// where both have a depth; returns `[]`.
///
/// A pixel counts where both are above 0 and finite, and where `mask`, of the same shape, is true. So
/// backgrounds at infinity, holes marked by 0, and NaN in the reference do not count. A NaN among the depths is
/// passed on. The error is 0 where no pixel counts.
///
/// With an [alignment](DepthAlignment) a factor, and perhaps an offset, first bring the depths as close to the
/// reference as they can, in the least-squares sense.
///
/// # Errors
/// [`TensorError::Mismatch`] unless all have the same shape.
#[inline(never)]
pub fn depth_error<'t, T: Scalar>(
    depths: Var<'t, T>,
    reference: Var<'t, T>,
    mask: Option<&Mask>,
    alignment: DepthAlignment,
) -> Result<Var<'t, T>, TensorError> {
    depths.tape().apply(DepthError { mask: mask.cloned(), alignment }, &[depths, reference])
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    const ALL: [DepthAlignment; 3] =
        [DepthAlignment::None, DepthAlignment::Scale, DepthAlignment::ScaleAndShift];

    fn motley(k: usize) -> f64 {
        1.0 + (k * 37 % 101) as f64 / 101.0
    }

    #[test]
    fn only_what_both_see_counts() {
        let (none, far) = (0.0, f64::INFINITY);
        let d = [1.0, 2.0, far, none, 3.0, -1.0, 4.0, 5.0];
        let r = [1.5, none, 2.0, 2.0, far, 2.0, 3.0, f64::NAN];
        let tape = Tape::new();
        let [depths, reference] = [d, r].map(|entries| tape.leaf(&Tensor::from(entries)));
        let error = depth_error(depths, reference, None, DepthAlignment::None).unwrap();
        assert_eq!(error.item(), 0.75);
        let gradients = error.backward().unwrap();
        let expected = [-0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0];
        assert_eq!(gradients.get_or_zeros(depths).data(), expected);
        assert_eq!(gradients.get_or_zeros(reference).data(), expected.map(|g| -g));
        let mask = Mask::from_flat_fn([8], |k| k != 6);
        for alignment in ALL {
            let error = depth_error(depths, reference, Some(&mask), alignment).unwrap();
            let expected = if alignment == DepthAlignment::None { 0.5 } else { 0.0 };
            assert_eq!(error.item(), expected);
            let none = Mask::full([8], false);
            let error = depth_error(depths, reference, Some(&none), alignment).unwrap();
            let gradients = error.backward().unwrap();
            assert_eq!(error.item(), 0.0);
            assert_eq!(gradients.get_or_zeros(depths), Tensor::zeros([8]));
            // What is not a number is not hidden.
            let lost = tape.leaf(&Tensor::full([8], f64::NAN));
            assert!(depth_error(lost, depths, None, alignment).unwrap().item().is_nan());
        }
    }

    #[test]
    fn scale_and_shift_are_those_of_what_counts() {
        let tape = Tape::<f64>::new();
        let depths = tape.leaf(&Tensor::from([1.0, 2.0, 4.0, 0.0, 5.0, 7.0]));
        // 2 d + 3, but for a background, a hole, and a pixel that is masked.
        let reference = tape.constant(&Tensor::from([5.0, 7.0, 11.0, 90.0, 0.0, 80.0]));
        let mask = Mask::from_flat_fn([6], |k| k < 5);
        let error = |alignment| depth_error(depths, reference, Some(&mask), alignment).unwrap();
        assert!(error(DepthAlignment::ScaleAndShift).item() < 1e-14);
        // By hand: the scale is 63 / 21, and the errors are 2, 1 and 1.
        approx::assert_relative_eq!(
            error(DepthAlignment::Scale).item(),
            4.0 / 3.0,
            epsilon = 1e-14
        );
        approx::assert_relative_eq!(
            error(DepthAlignment::None).item(),
            16.0 / 3.0,
            epsilon = 1e-14
        );
    }

    #[test]
    fn an_aligned_error_does_not_know_scale_and_shift_and_its_gradient_neither() {
        let tape = Tape::<f64>::new();
        let reference = tape.constant(&Tensor::from_flat_fn([500], |k| motley(7 * k)));
        let d = Tensor::from_flat_fn([500], motley);
        for (alignment, shift) in
            [(DepthAlignment::Scale, 0.0), (DepthAlignment::ScaleAndShift, 0.75)]
        {
            let of = |d: Tensor<f64>| {
                let depths = tape.leaf(&d);
                let error = depth_error(depths, reference, None, alignment).unwrap();
                let gradient = error.backward().unwrap().get_or_zeros(depths);
                // The slopes along a common factor and a common offset.
                let along = gradient.data().iter().zip(d.data()).map(|(g, d)| g * d);
                (error.item(), along.sum::<f64>(), gradient.data().iter().sum::<f64>())
            };
            let (error, along, sum) = of(d.clone());
            let (moved, ..) = of(d.map(|d| 3.0 * d + shift));
            assert!(error > 0.1);
            approx::assert_relative_eq!(error, moved, max_relative = 1e-13);
            assert!(along.abs() < 1e-14);
            assert_eq!(sum.abs() < 1e-14, alignment == DepthAlignment::ScaleAndShift);
            // What differs by them alone has no error.
            let like = reference.value().map(|r| 2.0 * r + shift);
            assert!(of(like).0 < 1e-15);
        }
    }

    #[test]
    fn a_wall_has_no_scale_and_a_finite_gradient() {
        for depth in [1e-3_f32, 1.0, 7.3, 1e5] {
            let tape = Tape::new();
            let wall = tape.leaf(&Tensor::full([64], depth));
            let reference = tape.leaf(&Tensor::from_flat_fn([64], |k| motley(k) as f32));
            let alignment = DepthAlignment::ScaleAndShift;
            let error = depth_error(wall, reference, None, alignment).unwrap();
            let mean = (0..64).map(|k| f64::from(motley(k) as f32)).sum::<f64>() / 64.0;
            let spread = (0..64).map(|k| (f64::from(motley(k) as f32) - mean).abs()).sum::<f64>();
            approx::assert_relative_eq!(error.item(), (spread / 64.0) as f32, max_relative = 1e-6);
            assert_eq!(error.backward().unwrap().get_or_zeros(wall), Tensor::zeros([64]));
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let tape = Tape::<f64>::new();
        let a = tape.leaf_full([2, 3], 1.0);
        let mask = Mask::full([6], true);
        assert_eq!(
            depth_error(a, a, Some(&mask), DepthAlignment::None).unwrap_err().to_string(),
            "depth_error needs depths and a mask of one shape, got shapes [2, 3] and [6]"
        );
    }
}
