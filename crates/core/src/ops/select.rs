//! A choice between two arrays, entry by entry: `z_k = x_k` where a mask is true, `y_k` elsewhere;
//! `x_bar_k += z_bar_k` where it is true, `y_bar_k += z_bar_k` elsewhere. All three broadcast.
//!
//! The side that is not taken gets exactly 0: nothing is multiplied, so that no NaN or infinity of one
//! side reaches the other. An operation further down multiplies that 0 by its slope, though. Where the
//! slope is infinite or NaN, its argument is to be chosen as well ([`Mask`] has an example).

use crate::axis::for_each_line_mut;
use crate::copies::add_over_copies;
use crate::error::TensorError;
use crate::gradient::{Accumulator, Accumulators};
use crate::mask::Mask;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;
use crate::walk::{Walk, axes};

struct Select {
    mask: Mask,
}

impl Select {
    const NAME: &'static str = "select";

    /// The common shape of the mask and both sides.
    fn full(&self, sides: [&Shape; 2]) -> Result<Shape, TensorError> {
        let common = |left: &Shape, right: &Shape| {
            let shapes = || Box::new([left.clone(), right.clone()]);
            let operation = Self::NAME;
            left.broadcast(right)
                .ok_or_else(|| TensorError::Broadcast { operation, shapes: shapes() })
        };
        common(&common(self.mask.shape(), sides[0])?, sides[1])
    }

    /// Adds `z_bar` where the mask is `side` to the gradient of the side of shape `side_shape`.
    fn add<T: Scalar>(
        &self,
        side_bar: &mut Accumulator<T>,
        side_shape: &Shape,
        (z_bar, full): (&[T], &Shape),
        side: bool,
    ) {
        let truth = self.mask.data();
        let all = axes([full, side_shape, self.mask.shape()]);
        if side_shape != full {
            let all = all.map(|(extent, [k, i, m])| (extent, [i, k, m]));
            return add_over_copies(side_bar.entries(), all, |[_, k, m]| {
                if truth[m] == side { z_bar[k].widen() } else { T::Wide::ZERO }
            });
        }
        let (side_bar, fresh) = side_bar.entries_or_fresh();
        let walk = Walk::new(all.map(|(extent, [k, _, m])| (extent, [k, m])));
        let add = |side_bar: &mut T, truth: bool, z_bar: T| {
            let term = if truth == side { z_bar } else { T::ZERO };
            *side_bar = if fresh { term } else { *side_bar + term };
        };
        if let &[(columns, [1, 0]), (_, [_, 1])] = walk.axes() {
            for_each_line_mut(side_bar, columns, [z_bar], |row, side_bar, [z_bar]| {
                let truth = truth[row];
                side_bar
                    .iter_mut()
                    .zip(z_bar)
                    .for_each(|(side_bar, &z_bar)| add(side_bar, truth, z_bar));
            });
            return;
        }
        let [_, step] = walk.steps();
        walk.rows_mut(side_bar, |side_bar, [k, m]| {
            let side_bar = side_bar.iter_mut().zip(&z_bar[k..]);
            if step == 1 {
                side_bar.zip(&truth[m..]).for_each(|((bar, &z_bar), &t)| add(bar, t, z_bar));
            } else {
                let side_bar = side_bar.enumerate();
                side_bar.for_each(|(k, (bar, &z_bar))| add(bar, truth[m + k * step], z_bar));
            }
        });
    }
}

impl<T: Scalar> Op<T> for Select {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (left, right) = (inputs.shape(0), inputs.shape(1));
        let full = self.full([left, right])?;
        let truth = self.mask.data();
        for (input, shape, side, reason) in
            [(0, left, true, "every entry is true"), (1, right, false, "no entry is true")]
        {
            if *shape == full && truth.iter().all(|&truth| truth == side) {
                outputs.pass(input, reason);
                return Ok(());
            }
        }
        let (x, y) = (inputs.data(0), inputs.data(1));
        let all = axes([&full, self.mask.shape(), left, right]);
        let walk = Walk::new(all.map(|(extent, [_, m, i, j])| (extent, [m, i, j])));
        let z = outputs.try_push(Self::NAME, &full)?;
        if let &[(columns, [0, 1, 1]), (_, [1, right_row, left_row])] = walk.axes()
            && (left_row, right_row) == (columns, columns)
        {
            // A truth value beside each row.
            for_each_line_mut(z, columns, [x, y], |row, z, [x, y]| {
                let is_left = truth[row];
                for (k, z) in z.iter_mut().enumerate() {
                    *z = if is_left { x[k] } else { y[k] };
                }
            });
            return Ok(());
        }
        choose_rows(&walk, z, truth, [x, y]);
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let z_bar = (kept.only_upstream(), kept.output_shape(0));
        for (input, side) in [(0, true), (1, false)] {
            if let Some(own_bar) = gradients.get(input) {
                self.add(own_bar, kept.input_shape(input), z_bar, side);
            }
        }
    }
}

impl Mask {
    /// `yes` where the mask is true, `no` elsewhere; all three broadcast. The side that is not taken
    /// gets exactly no gradient, also where the other side is infinite or NaN.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub fn select<'t, T: Scalar>(
        &self,
        yes: Var<'t, T>,
        no: Var<'t, T>,
    ) -> Result<Var<'t, T>, TensorError> {
        yes.tape().apply(Select { mask: self.clone() }, &[yes, no])
    }
}

/// The rows of `z` in the order of `walk`, over positions in the mask, in x and in y.
fn choose_rows<T: Scalar>(walk: &Walk<3>, z: &mut [T], truth: &[bool], [x, y]: [&[T]; 2]) {
    let steps = walk.steps();
    walk.rows_mut(z, |z, [m, i, j]| match steps {
        [1, 1, 1] => {
            let length = z.len();
            let (truth, x, y) = (&truth[m..][..length], &x[i..][..length], &y[j..][..length]);
            for (k, z) in z.iter_mut().enumerate() {
                *z = if truth[k] { x[k] } else { y[k] };
            }
        }
        [1, 1, 0] => {
            let (truth, x, y) = (&truth[m..][..z.len()], &x[i..][..z.len()], y[j]);
            for (k, z) in z.iter_mut().enumerate() {
                *z = if truth[k] { x[k] } else { y };
            }
        }
        [1, 0, 1] => {
            let (truth, x, y) = (&truth[m..][..z.len()], x[i], &y[j..][..z.len()]);
            for (k, z) in z.iter_mut().enumerate() {
                *z = if truth[k] { x } else { y[k] };
            }
        }
        steps => {
            for (k, z) in z.iter_mut().enumerate() {
                let [m, i, j] = [m + k * steps[0], i + k * steps[1], j + k * steps[2]];
                *z = if truth[m] { x[i] } else { y[j] };
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn each_side_gets_the_gradient_of_what_was_taken_of_it() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from([1.0, 2.0, 3.0]));
        let y = tape.leaf(&Tensor::from([[10.0], [20.0]]));
        let mask = Mask::new([2, 3], [true, false, true, false, false, true]).unwrap();
        let z = mask.select(x, y).unwrap();
        assert_eq!(z.value(), Tensor::from([[1.0, 10.0, 3.0], [20.0, 20.0, 3.0]]));
        let upstream = Tensor::from_flat_fn([2, 3], |k| 1.0 + k as f64);
        let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
        assert_eq!(gradients.get(x), Some(&Tensor::from([1.0, 0.0, 9.0])));
        assert_eq!(gradients.get(y), Some(&Tensor::from([[2.0], [9.0]])));
    }

    #[test]
    fn swapped_sides_of_the_opposite_mask_are_the_same() {
        let shapes: [&[usize]; 7] =
            [&[4, 2, 3], &[2, 3], &[4, 1, 3], &[3], &[2, 1], &[], &[4, 2, 1]];
        for (k, &left) in shapes.iter().enumerate() {
            for (&right, &mask_shape) in
                shapes.iter().flat_map(|r| shapes.iter().map(move |m| (r, m)))
            {
                let tape = Tape::new();
                let x = tape.leaf(&Tensor::from_flat_fn(left, |k| k as f64));
                let y = tape.leaf(&Tensor::from_flat_fn(right, |k| 0.5 - k as f64));
                let mask = Mask::from_flat_fn(mask_shape, |at| (at + k) % 3 > 0);
                let z = mask.select(x, y).unwrap();
                let numbers = mask.data().iter().map(|&truth| f64::from(truth)).collect();
                let numbers = tape.constant(&Tensor::new(mask_shape, numbers).unwrap());
                let mixed = numbers * x + (1.0 - numbers) * y;
                let upstream = Tensor::from_flat_fn(mixed.shape(), |k| 1.0 + k as f64);
                let of = |z| {
                    let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
                    (z.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y))
                };
                let expected = of(mixed);
                assert_eq!(of(z), expected, "{left:?} {right:?} {mask_shape:?}");
                assert_eq!(of((!mask).select(y, x).unwrap()), expected);
            }
        }
    }

    #[test]
    fn neither_value_nor_gradient_of_one_side_reaches_the_other() {
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let tape = Tape::new();
            let (x, y) =
                (tape.leaf(&Tensor::from([1.0, bad])), tape.leaf(&Tensor::from([bad, 2.0])));
            let z = Mask::from([true, false]).select(x, y).unwrap();
            assert_eq!(z.value(), Tensor::from([1.0, 2.0]));
            let gradients = tape.vjp(&[(z, &Tensor::from([bad, 3.0]))]).unwrap();
            assert_eq!(gradients.get(y), Some(&Tensor::from([0.0, 3.0])));
            let gradients = tape.vjp(&[(z, &Tensor::from([3.0, bad]))]).unwrap();
            assert_eq!(gradients.get(x), Some(&Tensor::from([3.0, 0.0])));
        }
    }

    #[test]
    fn a_side_that_is_taken_whole_is_passed_on() {
        let tape = Tape::new();
        let [x, y] = [1.0, 2.0].map(|number| tape.leaf_full([2], number));
        let yes = Mask::full([2], true);
        assert_eq!(yes.select(x, y).unwrap().value(), x.value());
        assert_eq!((!yes).select(x, y).unwrap().value(), y.value());
        assert_eq!(tape.len(), 2);
        let one = tape.leaf_scalar(3.0);
        assert_eq!(Mask::full([2], true).select(one, y).unwrap().value(), Tensor::full([2], 3.0));
    }

    #[test]
    fn the_mask_is_let_go_with_the_step_and_shapes_must_broadcast() {
        let mut tape = Tape::<f64>::new();
        let mask = Mask::from([true, false]);
        let x = tape.leaf_full([2], 1.0);
        let _ = mask.select(x, tape.constant_scalar(0.0)).unwrap();
        let three = tape.constant_full([3], 0.0);
        let message = "select needs shapes that broadcast, got [2] and [3]";
        assert_eq!(mask.select(three, x).unwrap_err().to_string(), message);
        assert_eq!(mask.select(x, three).unwrap_err().to_string(), message);
        let address = mask.data().as_ptr();
        tape.reset();
        let mut mask = mask;
        assert_eq!(mask.renew([2].into(), "is_less").unwrap().as_ptr(), address);
    }
}
