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

/// `f(x, y)` and its partial derivatives, as the tape computes them.
#[cfg(test)]
pub(crate) fn value_and_slopes<T: Scalar>(
    x: T,
    y: T,
    f: impl for<'t> Fn(Var<'t, T>, Var<'t, T>) -> Var<'t, T>,
) -> [T; 3] {
    let tape = crate::Tape::new();
    let (x, y) = (tape.leaf_scalar(x), tape.leaf_scalar(y));
    let z = f(x, y);
    let gradients = z.backward().expect("a scalar");
    [z.item(), gradients.get_or_zeros(x).item(), gradients.get_or_zeros(y).item()]
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::mask::Mask;
    use crate::ops::Padding;
    use crate::sparse::SparseMatrix;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    /// `x y` and both gradients, where everything is summed with the upstream gradient 1, 2, ...
    fn product(x: &[usize], y: &[usize]) -> [Tensor<f64>; 3] {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn(x, |k| 1.0 + k as f64));
        let y = tape.leaf(&Tensor::from_flat_fn(y, |k| 10.0 * (1.0 + k as f64)));
        let z = x.try_mul(y).unwrap();
        let upstream = Tensor::from_flat_fn(z.shape(), |k| 1.0 + k as f64);
        let gradients = tape.vjp(&[(z, &upstream)]).unwrap();
        [z.value(), gradients.get_or_zeros(x), gradients.get_or_zeros(y)]
    }

    #[test]
    fn a_repeated_entry_collects_the_terms_of_all_its_copies() {
        let [z, x_bar, y_bar] = product(&[2, 1], &[3]);
        assert_eq!(z.data(), [10.0, 20.0, 30.0, 20.0, 40.0, 60.0]);
        assert_eq!(x_bar.data(), [10.0 + 40.0 + 90.0, 40.0 + 100.0 + 180.0]);
        assert_eq!(y_bar.data(), [1.0 + 8.0, 2.0 + 10.0, 3.0 + 12.0]);
        assert_eq!(x_bar.shape(), &Shape::from([2, 1]));
    }

    #[test]
    fn both_sides_mirror_each_other() {
        let shapes: [&[usize]; 6] = [&[], &[1], &[3], &[2, 1], &[4, 1, 3], &[1, 2, 1]];
        for (left, right) in shapes.iter().flat_map(|&l| shapes.iter().map(move |&r| (l, r))) {
            let tape = Tape::new();
            let x = Tensor::from_flat_fn(left, |k| 0.3 + k as f64);
            let y = Tensor::from_flat_fn(right, |k| 0.7 - k as f64);
            let [a, b] = [tape.leaf(&x), tape.leaf(&y)];
            let (ab, ba) = ((a * b).sum(), (b * a).sum());
            let (one, other) = (ab.backward().unwrap(), ba.backward().unwrap());
            assert_eq!(ab.value(), ba.value());
            assert_eq!(one.get(a), other.get(a), "{left:?} {right:?}");
            assert_eq!(one.get(b), other.get(b), "{left:?} {right:?}");
        }
    }

    #[test]
    fn long_sums_of_copies_keep_their_digits_in_f32() {
        // In f32, 1 + 2^-24 is 1: summed so, the small terms would all be lost.
        let (rows, columns) = (1 << 16, 2);
        let tape = Tape::<f32>::new();
        let x = tape.leaf(&Tensor::zeros([columns]));
        let small = 2.0_f32.powi(-24);
        let terms =
            Tensor::from_flat_fn([rows, columns], |k| if k < columns { 1.0 } else { small });
        let z = x + tape.constant(&Tensor::zeros([rows, columns]));
        let gradients = tape.vjp(&[(z, &terms)]).unwrap();
        let expected = (1.0 + (rows - 1) as f64 * f64::from(small)) as f32;
        assert_eq!(gradients.get(x).unwrap().data(), [expected, expected]);
    }

    #[test]
    fn one_entry_and_none_broadcast_to_none() {
        let [z, x_bar, y_bar] = product(&[1], &[0]);
        assert_eq!((z.size(), y_bar.size()), (0, 0));
        assert_eq!(x_bar.data(), [0.0]);
    }

    #[test]
    fn what_no_memory_holds_is_refused_and_the_tape_goes_on() {
        let tape = Tape::<f32>::new();
        let (column, row) = (tape.leaf_full([1 << 20, 1], 2.0), tape.leaf_full([1 << 20], 3.0));
        let count = tape.len();
        let error = column.try_mul(row).unwrap_err();
        let message = "mul needs memory for its output, got shape [1048576, 1048576]";
        assert_eq!(error.to_string(), message);
        // Others whose outputs outgrow their inputs.
        let wide = row.reshape([1, 1 << 20]).unwrap();
        let hollow = tape.leaf(&Tensor::zeros([0, 1 << 20, 1 << 20]));
        let rows: Arc<[u32]> = Arc::from(vec![0; 1 << 20]);
        let (mask, flat) = (Mask::full([1 << 20, 1], true), Mask::full([1 << 20], true));
        let stacked = |axes: &[usize]| wide.reshape(axes).unwrap();
        let results = [
            column.is_less(row).map(|_| row),
            mask.select(row, row),
            column.matmul(wide),
            wide.gather_rows(&rows),
            wide.scatter_add_rows(&Arc::from([7]), 1 << 20),
            SparseMatrix::new(1 << 20, 1, []).unwrap().product(wide),
            row.pad(0, [1 << 40, 0], Padding::Wrap),
            stacked(&[1 << 20, 1, 1]).dot(stacked(&[1, 1 << 20, 1])),
            hollow.sum_axis(0),
            hollow.permute(&[1, 2, 0]).unwrap().norm(),
        ];
        for result in results {
            let message = result.unwrap_err().to_string();
            assert!(message.contains(" needs memory for its output, got shape ["), "{message}");
        }
        let message = "and needs memory for its output, got shape [1048576, 1048576]";
        assert_eq!(mask.and(&flat).unwrap_err().to_string(), message);
        // Since then there are a leaf, a permutation of it, and three reshapes of another.
        assert_eq!(tape.len(), count + 5);
        assert_eq!((row + row).sum().item(), 6.0 * (1 << 20) as f32);
    }

    #[test]
    fn what_the_slopes_do_not_need_is_not_kept() {
        let tape = Tape::new();
        let [x, c] = [tape.leaf_scalar(2.0), tape.constant_scalar(3.0)];
        let _ = x * c;
        assert_eq!(tape.inner.borrow().nodes[0].keep, Keep::NOTHING.input(1));
    }
}
