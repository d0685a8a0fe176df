//! Intersection over union of soft masks.
//!
//! # Forward
//! `L = 1 - I / U`, with `I = sum a b` and `U = sum (a + b - a b)`, summed in [`Scalar::Wide`]. Where U is
//! not above 0, as for two empty masks, L is 0 and has no gradient: they agree.
//!
//! # Backward
//! `a_bar = (I (1 - b) - U b) L_bar / U^2`, and b alike.
//!
//! # Source
//! Rahman and Wang, *Optimizing intersection-over-union in deep neural networks for image segmentation*,
//! ISVC 2016; of silhouettes: Kato, Ushiku and Harada, *Neural 3D mesh renderer*, CVPR 2018.

use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var, sum};

/// Inputs: two masks of one shape.
struct SilhouetteError;

impl<T: Scalar> Op<T> for SilhouetteError {
    /// I and U.
    type Saved = [T::Wide; 2];
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "silhouette_error"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Self::Saved,
    ) -> Result<(), TensorError> {
        if inputs.shape(0) != inputs.shape(1) {
            let (operation, rule) = ("silhouette_error", "two masks of one shape".into());
            let shapes = Box::new([inputs.shape(0).clone(), inputs.shape(1).clone()]);
            return Err(TensorError::Mismatch { operation, rule, shapes });
        }
        let (a, b) = (inputs.data(0), inputs.data(1));
        let b = &b[..a.len()];
        let shared = sum::<T>(a.len(), |k| a[k].widen() * b[k].widen());
        // Without a cancellation: a + b - a b = a + (1 - a) b.
        let either = sum::<T>(a.len(), |k| {
            let a = a[k].widen();
            a + (T::Wide::ONE - a) * b[k].widen()
        });
        *saved = [shared, either];
        let loss = if either <= T::Wide::ZERO { T::Wide::ZERO } else { (either - shared) / either };
        outputs.push([])[0] = T::narrow(loss);
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
        let [shared, either] = *saved;
        let upstream = kept.only_upstream()[0].widen();
        let is_empty = either <= T::Wide::ZERO;
        let factor = if is_empty { T::Wide::ZERO } else { upstream / either };
        let ratio = if is_empty { T::Wide::ZERO } else { shared / either };
        for i in 0..2 {
            let Some(bar) = gradients.get(i) else { continue };
            bar.add_zipped([kept.input(1 - i)], |[other]| {
                let other = other.widen();
                T::narrow(factor * (ratio * (T::Wide::ONE - other) - other))
            });
        }
    }
}

/// 1 minus the intersection over union of two soft masks of any one shape, with entries from 0 to 1:
/// silhouettes, coverage; returns `[]`. It is 0 where both are equal and hard, or both are empty.
///
/// # Errors
/// [`TensorError::Mismatch`] unless both have the same shape.
#[inline(never)]
pub fn silhouette_error<'t, T: Scalar>(
    mask: Var<'t, T>,
    reference: Var<'t, T>,
) -> Result<Var<'t, T>, TensorError> {
    mask.tape().apply(SilhouetteError, &[mask, reference])
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    #[test]
    fn the_error_and_its_gradient_are_those_worked_out_by_hand() {
        let tape = Tape::<f64>::new();
        let a = tape.leaf(&Tensor::from([1.0, 0.5, 0.0, 0.25, 0.5]));
        let b = tape.leaf(&Tensor::from([1.0, 1.0, 0.5, 0.0, 0.5]));
        let loss = silhouette_error(a, b).unwrap();
        // I = 1 + 0.5 + 0.25 = 1.75; U = 1 + 1 + 0.5 + 0.25 + 0.75 = 3.5: of two halves 3/4 are covered.
        approx::assert_relative_eq!(loss.item(), 1.75 / 3.5, max_relative = 1e-15);
        let gradients = loss.backward().unwrap();
        for (variable, other) in [(a, b), (b, a)] {
            let other = other.value();
            for (k, &found) in gradients.get_or_zeros(variable).data().iter().enumerate() {
                let other = other.data()[k];
                let expected = (1.75 * (1.0 - other) - 3.5 * other) / (3.5 * 3.5);
                approx::assert_relative_eq!(found, expected, max_relative = 1e-14);
            }
        }
    }

    #[test]
    fn empty_masks_agree_and_masks_apart_do_not() {
        let tape = Tape::<f32>::new();
        let of = |a: &[f32], b: &[f32]| {
            let [a, b] =
                [a, b].map(|mask| tape.leaf(&Tensor::from_flat_fn([mask.len()], |k| mask[k])));
            let loss = silhouette_error(a, b).unwrap();
            (loss.item(), loss.backward().unwrap().get_or_zeros(a).data().to_vec())
        };
        assert_eq!(of(&[0.0; 3], &[0.0; 3]), (0.0, vec![0.0; 3]));
        assert_eq!(of(&[], &[]), (0.0, vec![]));
        assert_eq!(of(&[1.0, 0.0, 1.0], &[1.0, 0.0, 1.0]).0, 0.0);
        assert_eq!(of(&[1.0, 0.0], &[0.0, 1.0]).0, 1.0);
        // An empty mask beside one that is not: the slope says where to appear.
        assert_eq!(of(&[0.0, 0.0], &[0.0, 1.0]), (1.0, vec![0.0, -1.0]));
    }
}
