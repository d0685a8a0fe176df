//! Operations on pairs of entries of two arrays whose shapes broadcast.
//!
//! With `z = f(x, y)` entry by entry: `x_bar += df/dx z_bar` and `y_bar += df/dy z_bar`; an entry
//! that was repeated collects the terms of all its copies, summed in row-major order.

use crate::error::TensorError;
use crate::op::{Accumulator, Accumulators, Inputs, Keep, Kept, Op, Outputs};
use crate::parallel::for_each_zipped_mut;
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::summation::sum;
use crate::var::Var;
use crate::walk::Walk;

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
            left: left.clone(),
            right: right.clone(),
        })?;
        let z = outputs.push(&shape);
        if *left == shape && right.size() == 1 {
            let y = y[0];
            for_each_zipped_mut(z, [x], |z, [x]| *z = self.0.value(x, y));
        } else if *right == shape && left.size() == 1 {
            let x = x[0];
            for_each_zipped_mut(z, [y], |z, [y]| *z = self.0.value(x, y));
        } else {
            let walk = Walk::new(axes([&shape, left, right]));
            walk.for_each(|[k, i, j]| z[k] = self.0.value(x[i], y[j]));
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
        let [x_bar, y_bar] = gradients.first();
        if let Some(x_bar) = x_bar {
            let (x, y, z_bar) = arguments(kept, F::LEFT_SLOPE_FROM);
            let term = |x, y, z_bar| self.0.left_slope(x, y) * z_bar;
            add_terms(x_bar, [z, left, right], [z_bar, x, y], term);
        }
        if let Some(y_bar) = y_bar {
            let (x, y, z_bar) = arguments(kept, F::RIGHT_SLOPE_FROM);
            let term = |y, x, z_bar| self.0.right_slope(x, y) * z_bar;
            add_terms(y_bar, [z, right, left], [z_bar, y, x], term);
        }
    }
}

/// `x`, `y` and `z_bar`; for an argument that is not used stands `z_bar`, whose numbers are at
/// hand and reach as far.
fn arguments<'a, T: Scalar>(kept: &'a Kept<'_, T>, used: [bool; 2]) -> (&'a [T], &'a [T], &'a [T]) {
    let z_bar = kept.only_upstream();
    let argument = |i: usize| if used[i] { kept.input(i) } else { z_bar };
    (argument(0), argument(1), z_bar)
}

/// Adds `term(own, other, z_bar)` over all pairs to the gradient of one side, `own`.
fn add_terms<T: Scalar>(
    own_bar: &mut Accumulator<T>,
    [full, own_shape, other_shape]: [&Shape; 3],
    [z_bar, own, other]: [&[T]; 3],
    term: impl Fn(T, T, T) -> T + Send + Sync,
) {
    if z_bar.is_empty() {
        return;
    }
    if own_shape == other_shape {
        own_bar.add_zipped([own, other, z_bar], |[own, other, z_bar]| term(own, other, z_bar));
    } else if own_shape == full && other_shape.size() == 1 {
        let other = other[0];
        own_bar.add_zipped([own, z_bar], |[own, z_bar]| term(own, other, z_bar));
    } else if own_shape == full {
        let entries = own_bar.entries();
        let walk = Walk::new(axes([full, other_shape]));
        walk.for_each(|[k, j]| entries[k] += term(own[k], other[j], z_bar[k]));
    } else if own_shape.size() == 1 && other_shape == full {
        let own = own[0];
        let total = sum::<T>(z_bar.len(), |k| term(own, other[k], z_bar[k]).widen());
        own_bar.entries()[0] += T::narrow(total);
    } else {
        let all = || axes([full, own_shape, other_shape]);
        let entries = Walk::new(all().filter(|(_, [_, own, _])| *own != 0));
        let copies = Walk::new(all().filter(|(_, [_, own, _])| *own == 0));
        let own_bar = own_bar.entries();
        entries.for_each(|[k, i, j]| {
            let mut total = T::Wide::ZERO;
            copies.for_each(|[dk, _, dj]| {
                total += term(own[i], other[j + dj], z_bar[k + dk]).widen();
            });
            own_bar[i] += T::narrow(total);
        });
    }
}

/// The axes of the first shape, and how far one step along each moves in arrays of all of them.
fn axes<const N: usize>(
    shapes: [&Shape; N],
) -> impl DoubleEndedIterator<Item = (usize, [usize; N])> {
    let strides = shapes.map(|shape| shape.strides_in(shapes[0]));
    let extents = shapes[0].iter().copied().enumerate();
    extents.map(move |(axis, extent)| (extent, std::array::from_fn(|i| strides[i][axis])))
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
