//! Total variation of a texture, composed of tensor operations.
//!
//! # Formula
//! `L = (1 / n) sum (f(x_(i+1)jc - x_ijc) + f(x_i(j+1)c - x_ijc))` over all neighbours along columns and
//! rows, n entries, with a penalty f of differences (`losses::penalty`).
//!
//! # Cost
//! In `f32` it takes 0.5 of the instructions of a backward pass by hand.
//!
//! # Where it is not smooth
//! With `f(d) = |d|` where neighbours are equal; the slope is taken as 0 there.
//!
//! # Source
//! Rudin, Osher and Fatemi, *Nonlinear total variation based noise removal algorithms*, Physica D 60,
//! 1992; here anisotropic, by axes.

use bokashi_core::{Scalar, TensorError, Var};

use crate::losses::{Penalty, sum_over_count};

const NAME: &str = "total_variation";

/// The total variation of a texture `[H, W, C]` by rows and columns: the sum of the penalties of the differences
/// of neighbours, over the number of entries; returns `[]`. [`Penalty::Absolute`] is the usual one;
/// [`Penalty::Charbonnier`] rounds its kink.
///
/// # Errors
/// [`TensorError::Shape`] unless the texture is `[H, W, C]` with at least one entry;
/// [`TensorError::Value`] for a delta or scale that is not finite and above 0, and for
/// [`Penalty::Relative`]: of two neighbours none is the reference.
#[inline(never)]
pub fn total_variation<T: Scalar>(
    texture: Var<'_, T>,
    penalty: Penalty,
) -> Result<Var<'_, T>, TensorError> {
    if let Penalty::Relative { epsilon } = penalty {
        let rule = "a penalty of differences alone, and no relative one".into();
        return Err(TensorError::Value { operation: NAME, rule, value: epsilon });
    }
    penalty.check::<T>(NAME)?;
    let shape = texture.shape();
    if shape.rank() != 3 || shape.size() == 0 {
        let rule = "a texture [H, W, C] of at least one entry".into();
        return Err(TensorError::Shape { operation: NAME, rule, shape });
    }
    let along = |axis: usize| {
        let extent = shape[axis];
        let next = texture.slice(axis, 1..extent)?;
        let difference = next.try_sub(texture.slice(axis, 0..extent - 1)?)?;
        sum_over_count(penalty.apply(next, difference)?, shape.size())
    };
    along(0)?.try_add(along(1)?)
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    #[test]
    fn the_variation_and_its_gradient_are_those_worked_out_by_hand() {
        let tape = Tape::<f64>::new();
        // Two channels: the first one varies, the second one is flat.
        let entries = [1.0, 9.0, 4.0, 9.0, 2.0, 9.0, 2.0, 9.0];
        let x = tape.leaf(&Tensor::new([2, 2, 2], entries.to_vec()).unwrap());
        let error = total_variation(x, Penalty::Absolute).unwrap();
        // |4 - 1| + |2 - 2| along rows, |2 - 1| + |2 - 4| along columns.
        assert_eq!(error.item(), 6.0 / 8.0);
        let gradient = error.backward().unwrap().get_or_zeros(x);
        assert_eq!(gradient.data(), [-2.0, 0.0, 2.0, 0.0, 1.0, 0.0, -1.0, 0.0].map(|g| g / 8.0));
        let of = |penalty| total_variation(x, penalty).unwrap().item();
        let f = |d: f64| (d * d + 16.0).sqrt() - 4.0;
        let expected = (f(3.0) + f(1.0) + f(2.0)) / 8.0;
        let smooth = of(Penalty::Charbonnier { scale: 4.0 });
        approx::assert_relative_eq!(smooth, expected, max_relative = 1e-14);
        assert_eq!(of(Penalty::Squared), (9.0 + 1.0 + 4.0) / 8.0);
        // The line begins at 2: 2 (3 - 1), and half of the squares of 1 and 2.
        assert_eq!(of(Penalty::Huber { delta: 2.0 }), (4.0 + 0.5 + 2.0) / 8.0);
    }

    #[test]
    fn a_flat_texture_has_none_and_steps_far_apart_add_up() {
        let tape = Tape::<f32>::new();
        for shape in [[1, 1, 1], [1, 7, 2], [9, 1, 3], [300, 200, 3]] {
            for penalty in [Penalty::Absolute, Penalty::Charbonnier { scale: 1e-3 }] {
                let flat = tape.leaf(&Tensor::full(shape, 0.7));
                let error = total_variation(flat, penalty).unwrap();
                assert_eq!(error.item(), 0.0);
                let gradient = error.backward().unwrap().get_or_zeros(flat);
                assert!(gradient.data().iter().all(|g| *g == 0.0));
            }
        }
        // A step along a column of 300 rows, in several pieces of work.
        let step = Tensor::from_fn([300, 200, 1], |[i, ..]| if i < 100 { 0.0 } else { 1.0_f32 });
        let error = total_variation(tape.leaf(&step), Penalty::Absolute).unwrap();
        assert_eq!(error.item(), (200.0 / 60_000.0) as f32);
    }
}
