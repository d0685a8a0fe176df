//! Operations on pairs of entries of two arrays whose shapes broadcast.
//!
//! With `z = f(x, y)` entry by entry: `x_bar += df/dx z_bar` and `y_bar += df/dy z_bar`; an entry
//! that was repeated collects the terms of all its copies, in row-major order.

use smallvec::SmallVec;

use crate::error::TensorError;
use crate::op::{Accumulator, Accumulators, Inputs, Keep, Kept, Op, Outputs};
use crate::parallel::{ENTRIES_PER_PIECE, for_each_piece_mut};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::summation::sum;
use crate::var::Var;

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

/// A pair of functions' worth of broadcasting: `z_k = f(x_i(k), y_j(k))`.
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
        let shape = left.broadcast(right).ok_or_else(|| TensorError::Broadcast {
            operation: F::NAME,
            left: left.clone(),
            right: right.clone(),
        })?;
        let pairs = Pairs::of(left, right, &shape);
        let z = outputs.push(shape);
        match pairs {
            Pairs::Same => for_each_piece_mut(z, ENTRIES_PER_PIECE, |k, z| {
                let at = k * ENTRIES_PER_PIECE;
                let pairs = x[at..][..z.len()].iter().zip(&y[at..][..z.len()]);
                z.iter_mut().zip(pairs).for_each(|(z, (&x, &y))| *z = self.0.value(x, y));
            }),
            Pairs::LeftOne => z.iter_mut().zip(y).for_each(|(z, &y)| *z = self.0.value(x[0], y)),
            Pairs::RightOne => z.iter_mut().zip(x).for_each(|(z, &x)| *z = self.0.value(x, y[0])),
            Pairs::Strided(walk) => walk.for_each(|k, i, j| z[k] = self.0.value(x[i], y[j])),
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
        let z_bar = kept.only_upstream();
        let pairs = Pairs::of(kept.input_shape(0), kept.input_shape(1), kept.output_shape(0));
        let [x_bar, y_bar] = gradients.first();
        if let Some(x_bar) = x_bar {
            let arguments = Arguments::kept(kept, F::LEFT_SLOPE_FROM);
            let slope = |i, j| arguments.apply(i, j, |x, y| self.0.left_slope(x, y));
            pairs.add_to(x_bar, z_bar, true, slope);
        }
        if let Some(y_bar) = y_bar {
            let arguments = Arguments::kept(kept, F::RIGHT_SLOPE_FROM);
            let slope = |i, j| arguments.apply(i, j, |x, y| self.0.right_slope(x, y));
            pairs.add_to(y_bar, z_bar, false, slope);
        }
    }
}

/// The arguments that a slope is a function of.
struct Arguments<'a, T>([Option<&'a [T]>; 2]);

impl<'a, T: Scalar> Arguments<'a, T> {
    fn kept(kept: &'a Kept<'_, T>, used: [bool; 2]) -> Self {
        Self([used[0].then(|| kept.input(0)), used[1].then(|| kept.input(1))])
    }

    #[inline]
    fn apply(&self, i: usize, j: usize, slope: impl Fn(T, T) -> T) -> T {
        slope(self.0[0].map_or(T::ONE, |x| x[i]), self.0[1].map_or(T::ONE, |y| y[j]))
    }
}

/// How entries of two arrays pair up.
enum Pairs {
    /// Entry by entry.
    Same,
    /// The one left entry with every right one.
    LeftOne,
    /// Every left entry with the one right one.
    RightOne,
    /// Any other way.
    Strided(Walk),
}

impl Pairs {
    fn of(left: &Shape, right: &Shape, full: &Shape) -> Self {
        if left == right {
            Self::Same
        } else if left.size() == 1 && right == full {
            Self::LeftOne
        } else if right.size() == 1 && left == full {
            Self::RightOne
        } else {
            Self::Strided(Walk {
                extents: full.iter().copied().collect(),
                left: left.strides_in(full),
                right: right.strides_in(full),
            })
        }
    }

    /// Adds `slope(i, j) z_bar[k]` over all pairs to the gradient of the left or right array.
    fn add_to<T: Scalar>(
        &self,
        gradient: &mut Accumulator<T>,
        z_bar: &[T],
        to_left: bool,
        slope: impl Fn(usize, usize) -> T + Send + Sync,
    ) {
        match (self, to_left) {
            (Self::Same, _) => gradient.add_each(|k| slope(k, k) * z_bar[k]),
            (Self::LeftOne, false) => gradient.add_each(|k| slope(0, k) * z_bar[k]),
            (Self::RightOne, true) => gradient.add_each(|k| slope(k, 0) * z_bar[k]),
            (Self::LeftOne, true) => {
                let total = sum::<T>(z_bar.len(), |k| (slope(0, k) * z_bar[k]).widen());
                gradient.add_each(|_| T::narrow(total));
            }
            (Self::RightOne, false) => {
                let total = sum::<T>(z_bar.len(), |k| (slope(k, 0) * z_bar[k]).widen());
                gradient.add_each(|_| T::narrow(total));
            }
            (Self::Strided(walk), _) => {
                let entries = gradient.entries();
                walk.for_each(|k, i, j| {
                    entries[if to_left { i } else { j }] += slope(i, j) * z_bar[k];
                });
            }
        }
    }
}

/// A walk over an array in row-major order beside two arrays that repeat along some axes.
struct Walk {
    extents: SmallVec<[usize; 4]>,
    left: SmallVec<[usize; 4]>,
    right: SmallVec<[usize; 4]>,
}

impl Walk {
    /// Calls `visit(k, i, j)` with the position in the full, the left and the right array.
    fn for_each(&self, mut visit: impl FnMut(usize, usize, usize)) {
        let total: usize = self.extents.iter().product();
        let mut at: SmallVec<[usize; 4]> = SmallVec::from_elem(0, self.extents.len());
        let (mut i, mut j) = (0, 0);
        for k in 0..total {
            visit(k, i, j);
            for axis in (0..at.len()).rev() {
                at[axis] += 1;
                i += self.left[axis];
                j += self.right[axis];
                if at[axis] < self.extents[axis] {
                    break;
                }
                at[axis] = 0;
                i -= self.left[axis] * self.extents[axis];
                j -= self.right[axis] * self.extents[axis];
            }
        }
    }
}

impl<'t, T: Scalar> Var<'t, T> {
    /// Records `f` of each pair of entries.
    ///
    /// # Errors
    /// [`TensorError::Broadcast`] unless the shapes broadcast.
    pub(crate) fn pairwise<F: Binary<T>>(self, other: Self, f: F) -> Result<Self, TensorError> {
        self.tape.apply(Broadcast(f), &[self, other])
    }
}
