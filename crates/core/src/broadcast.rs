//! Operations on pairs of entries of two arrays whose shapes broadcast.
//!
//! With `z = f(x, y)` entry by entry: `x_bar += df/dx z_bar` and `y_bar += df/dy z_bar`; an entry
//! that was repeated collects the terms of all its copies, summed in row-major order.

use crate::axis::sum_rows;
use crate::copies::add_over_copies;
use crate::error::TensorError;
use crate::gradient::{Accumulator, Accumulators};
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut, for_each_zipped_mut};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::summation::sum;
use crate::var::Var;
use crate::walk::{Walk, axes};

/// A function of two numbers and its partial derivatives.
pub(crate) trait Binary<T: Scalar>: Copy + Send + Sync + 'static {
    const NAME: &'static str;
    /// Whether df/dx is a function of x, of y.
    const LEFT_SLOPE_FROM: [bool; 2];
    /// Whether df/dy is a function of x, of y.
    const RIGHT_SLOPE_FROM: [bool; 2];

    /// f(x, y).
    fn value(self, x: T, y: T) -> T;

    /// df/dx; arguments that it is not a function of hold any numbers.
    fn left_slope(self, x: T, y: T) -> T;

    /// df/dy; arguments that it is not a function of hold any numbers.
    fn right_slope(self, x: T, y: T) -> T;
}

/// `z_k = f(x_i(k), y_j(k))`.
struct Broadcast<F>(F);

impl<T: Scalar, F: Binary<T>> Op<T> for Broadcast<F> {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        F::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let (left, right) = (inputs.shape(0), inputs.shape(1));
        let (x, y) = (inputs.data(0), inputs.data(1));
        if left == right {
            let z = outputs.push(left);
            for_each_zipped_mut(z, [x, y], |z, [x, y]| *z = self.0.value(x, y));
            return Ok(());
        }
        let shape = left.broadcast(right).ok_or_else(|| TensorError::Broadcast {
            operation: F::NAME,
            shapes: Box::new([left.clone(), right.clone()]),
        })?;
        let z = outputs.try_push(F::NAME, &shape)?;
        if *left == shape && right.size() == 1 {
            let y = y[0];
            for_each_zipped_mut(z, [x], |z, [x]| *z = self.0.value(x, y));
        } else if *right == shape && left.size() == 1 {
            let x = x[0];
            for_each_zipped_mut(z, [y], |z, [y]| *z = self.0.value(x, y));
        } else {
            let walk = Walk::new(axes([&shape, left, right]).map(|(n, [_, i, j])| (n, [i, j])));
            walk.zip_mut(z, [x, y], |z, [x, y]| *z = self.0.value(x, y));
        }
        Ok(())
    }

    fn keeps(&self, inputs: &Inputs<'_, T>) -> Keep {
        let mut keep = Keep::NOTHING;
        for (input, slope_from) in [F::LEFT_SLOPE_FROM, F::RIGHT_SLOPE_FROM].iter().enumerate() {
            for (argument, &used) in slope_from.iter().enumerate() {
                if used && inputs.needs(input) {
                    keep = keep.input(argument);
                }
            }
        }
        keep
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let (z, left, right) = (kept.output_shape(0), kept.input_shape(0), kept.input_shape(1));
        if let Some(x_bar) = gradients.get(0) {
            let (x, y, z_bar) = arguments(kept, F::LEFT_SLOPE_FROM);
            let term = |x, y, z_bar| self.0.left_slope(x, y) * z_bar;
            add_terms(x_bar, [z, left, right], [z_bar, x, y], term);
        }
        if let Some(y_bar) = gradients.get(1) {
            let (x, y, z_bar) = arguments(kept, F::RIGHT_SLOPE_FROM);
            let term = |y, x, z_bar| self.0.right_slope(x, y) * z_bar;
            add_terms(y_bar, [z, right, left], [z_bar, y, x], term);
        }
    }
}

/// `x`, `y` and `z_bar`; for an argument that is not used stands `z_bar`, whose numbers are at
/// hand and reach as far.
#[inline(always)]
fn arguments<'a, T: Scalar>(kept: &'a Kept<'_, T>, used: [bool; 2]) -> (&'a [T], &'a [T], &'a [T]) {
    let z_bar = kept.only_upstream();
    let argument = |i: usize| if used[i] { kept.input(i) } else { z_bar };
    (argument(0), argument(1), z_bar)
}

/// Adds `term(input, other, z_bar)` over all pairs to the gradient of one side, `input`.
fn add_terms<T: Scalar>(
    input_bar: &mut Accumulator<T>,
    [full, input_shape, other_shape]: [&Shape; 3],
    [z_bar, input, other]: [&[T]; 3],
    term: impl Fn(T, T, T) -> T + Send + Sync,
) {
    if z_bar.is_empty() {
        return;
    }
    if input_shape == other_shape {
        input_bar
            .add_zipped([input, other, z_bar], |[input, other, z_bar]| term(input, other, z_bar));
    } else if input_shape == full && other_shape.size() == 1 {
        let other = other[0];
        input_bar.add_zipped([input, z_bar], |[input, z_bar]| term(input, other, z_bar));
    } else if input_shape == full {
        let walk = Walk::new(axes([full, other_shape]).map(|(n, [k, j])| (n, [k, j, k])));
        let add = |sum: &mut T, [input, other, z_bar]: [T; 3]| *sum += term(input, other, z_bar);
        walk.zip_mut(input_bar.entries(), [input, other, z_bar], add);
    } else if input_shape.size() == 1 && other_shape == full {
        let input = input[0];
        let total = sum::<T>(z_bar.len(), |k| term(input, other[k], z_bar[k]).widen());
        input_bar.entries()[0] += T::narrow(total);
    } else {
        let input_bar = input_bar.entries();
        match *Walk::new(axes([full, input_shape, other_shape])).axes() {
            // A row beside each row, short enough for a piece.
            [(columns, [1, 1, step]), (rows, [_, 0, stride])] if columns <= ENTRIES_PER_PIECE => {
                let term = |row: usize, column: usize| {
                    let other = other[row * stride + column * step];
                    term(input[column], other, z_bar[row * columns + column]).widen()
                };
                let put = |column, total| input_bar[column] += T::narrow(total);
                sum_rows::<T>(rows, columns, term, put);
            }
            // One entry beside each row.
            [(columns, [1, 0, step]), (rows, [_, 1, stride])] => {
                let add = |row: usize, sum: &mut T| {
                    let total: T::Wide = (0..columns)
                        .map(|column| {
                            let other = other[row * stride + column * step];
                            term(input[row], other, z_bar[row * columns + column]).widen()
                        })
                        .sum();
                    *sum += T::narrow(total);
                };
                let piece = (ENTRIES_PER_PIECE / columns).max(1);
                for_each_piece_mut(&mut input_bar[..rows], piece, |k, sums| {
                    (k * piece..).zip(sums).for_each(|(row, sum)| add(row, sum));
                });
            }
            _ => {
                let all = axes([full, input_shape, other_shape]);
                let all = all.map(|(extent, [k, i, j])| (extent, [i, j, k]));
                let term = |[i, j, k]: [usize; 3]| term(input[i], other[j], z_bar[k]).widen();
                add_over_copies(input_bar, all, term);
            }
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// Records `f` of each pair of entries.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub(crate) fn pairwise<F: Binary<T>>(self, other: Self, f: F) -> Result<Self, TensorError> {
        self.tape.apply(Broadcast(f), &[self, other])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::value::Value;

    /// `x y^2`: its slopes are `y^2` and `2 x y`.
    #[derive(Clone, Copy)]
    struct ByTheSquare;

    impl Binary<f64> for ByTheSquare {
        const NAME: &'static str = "by_the_square";
        const LEFT_SLOPE_FROM: [bool; 2] = [false, true];
        const RIGHT_SLOPE_FROM: [bool; 2] = [true, true];

        fn value(self, x: f64, y: f64) -> f64 {
            x * y * y
        }
        fn left_slope(self, _x: f64, y: f64) -> f64 {
            y * y
        }
        fn right_slope(self, x: f64, y: f64) -> f64 {
            2.0 * x * y
        }
    }

    #[test]
    fn what_the_slopes_do_not_need_is_not_kept() {
        let (none, x, y) = (Keep::NOTHING, Keep::NOTHING.input(0), Keep::NOTHING.input(1));
        let both = x.input(1);
        for (needs, expected) in [
            ([false, false], none),
            ([true, false], y),
            ([false, true], both),
            ([true, true], both),
        ] {
            let mut values = [Value::vacant(), Value::vacant()];
            values.iter_mut().zip(needs).for_each(|(value, needs)| value.needs = needs);
            let inputs = Inputs { values: &values, indices: &[0, 1] };
            assert_eq!(Broadcast(ByTheSquare).keeps(&inputs), expected, "{needs:?}");
        }
    }
}
