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
