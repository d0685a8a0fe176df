//! Total variation of a texture.
//!
//! # Forward
//! `L = (1 / n) sum (f(x_(i+1)jc - x_ijc) + f(x_i(j+1)c - x_ijc))` over all neighbours along columns and
//! rows, n entries, with a penalty f of differences (`losses::penalty`).
//!
//! # Backward
//! Each entry gathers what its four differences have:
//! `x_bar = (f'(x - left) - f'(right - x) + f'(x - above) - f'(below - x)) L_bar / n`.
//!
//! # Where it is not smooth
//! With `f(d) = |d|` where neighbours are equal; the slope is taken as 0 there.
//!
//! # Source
//! Rudin, Osher and Fatemi, *Nonlinear total variation based noise removal algorithms*, Physica D 60,
//! 1992; here anisotropic, by axes.

use bokashi_core::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut, merge_ranges};
use bokashi_core::{Accumulators, Inputs, Keep, Kept, Op, Outputs, Scalar, TensorError, Var};

use crate::losses::{Absolute, Charbonnier, Huber, Penalty, Rule, Squared, positive};

const NAME: &str = "total_variation";

/// Input: a texture `[H, W, C]`.
struct TotalVariation<R> {
    rule: R,
}

/// Entries of a row, of a pixel, and rows of a piece of work.
struct Layout {
    row: usize,
    channels: usize,
    per_piece: usize,
}

impl Layout {
    fn new(shape: &[usize]) -> Self {
        let (row, channels) = (shape[1] * shape[2], shape[2]);
        Self { row, channels, per_piece: (ENTRIES_PER_PIECE / row.max(1)).max(1) }
    }
}

impl<T: Scalar, R: Rule<T::Wide>> Op<T> for TotalVariation<R> {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        if shape.rank() != 3 || x.is_empty() {
            let rule = "a texture [H, W, C] of at least one entry".into();
            return Err(TensorError::Shape { operation: NAME, rule, shape: shape.clone() });
        }
        let Layout { row, channels, per_piece } = Layout::new(shape);
        let between = |from: &[T], to: &[T]| -> T::Wide {
            let pairs = from.iter().zip(to);
            pairs.map(|(from, to)| self.rule.value(to.widen(), to.widen() - from.widen())).sum()
        };
        let rows = |rows: std::ops::Range<usize>| {
            rows.fold(T::Wide::ZERO, |total, i| {
                let own = &x[i * row..][..row];
                let along = between(own, &own[channels..]);
                // In the last row there is nothing below.
                total + along + between(own, &x[(i + 1) * row..])
            })
        };
        let mut total = T::Wide::ZERO;
        merge_ranges(shape[0], per_piece, rows, |part: T::Wide| total += part);
        outputs.push([])[0] = T::narrow(total / T::Wide::from_f64(x.len() as f64));
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING.input(0)
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(bar) = gradients.get(0) else { return };
        let x = kept.input(0);
        let Layout { row, channels, per_piece } = Layout::new(kept.input_shape(0));
        let factor = kept.only_upstream()[0].widen() / T::Wide::from_f64(x.len() as f64);
        let between = |from: T, to: T| self.rule.slope(to.widen(), to.widen() - from.widen());
        let (bar, fresh) = bar.entries_or_fresh();
        for_each_piece_mut(bar, per_piece * row, |piece, bar| {
            for (i, bar) in bar.chunks_mut(row).enumerate() {
                let first = (piece * per_piece + i) * row;
                for (k, bar) in bar.iter_mut().enumerate() {
                    let at = first + k;
                    let mut total = T::Wide::ZERO;
                    if k >= channels {
                        total += between(x[at - channels], x[at]);
                    }
                    if k + channels < row {
                        total += -between(x[at], x[at + channels]);
                    }
                    if at >= row {
                        total += between(x[at - row], x[at]);
                    }
                    if at + row < x.len() {
                        total += -between(x[at], x[at + row]);
                    }
                    let term = T::narrow(factor * total);
                    *bar = if fresh { term } else { *bar + term };
                }
            }
        });
    }
}

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
    let (tape, inputs) = (texture.tape(), &[texture]);
    match penalty {
        Penalty::Squared => tape.apply(TotalVariation { rule: Squared }, inputs),
        Penalty::Absolute => tape.apply(TotalVariation { rule: Absolute }, inputs),
        Penalty::Huber { delta } => {
            let rule = Huber(positive::<T>(NAME, "delta", delta)?);
            tape.apply(TotalVariation { rule }, inputs)
        }
        Penalty::Charbonnier { scale } => {
            let rule = Charbonnier(positive::<T>(NAME, "scale", scale)?);
            tape.apply(TotalVariation { rule }, inputs)
        }
        Penalty::Relative { epsilon } => {
            let rule = "a penalty of differences alone, and no relative one".into();
            Err(TensorError::Value { operation: NAME, rule, value: epsilon })
        }
    }
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
