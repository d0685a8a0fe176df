//! Axes in another order: `y_a(k) = x_k`, where axis `j` of `y` is axis `a_j` of `x`;
//! `x_bar_k += y_bar_a(k)`. With two axes swapped, the transpose of a matrix.

use smallvec::SmallVec;

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::shape::Shape;
use crate::var::Var;
use crate::walk::Walk;

struct Permute {
    operation: &'static str,
    axes: SmallVec<[usize; 4]>,
}

impl Permute {
    /// A walk over the permuted array beside the original one.
    fn walk(&self, original: &Shape, permuted: &Shape) -> Walk<2> {
        let (from, to) = (original.strides_in(original), permuted.strides_in(permuted));
        let axes = permuted.iter().zip(to).zip(&self.axes);
        Walk::new(axes.map(|((&extent, to), &axis)| (extent, [to, from[axis]])))
    }
}

impl<T: Scalar> Op<T> for Permute {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        self.operation
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut (),
    ) -> Result<(), TensorError> {
        let shape = inputs.shape(0);
        let once = |axis: usize| self.axes.iter().filter(|&&other| other == axis).count() == 1;
        if self.axes.len() != shape.rank() || !(0..shape.rank()).all(once) {
            return Err(TensorError::Axes {
                operation: self.operation,
                axes: self.axes.as_slice().into(),
                shape: shape.clone(),
            });
        }
        if self.axes.is_sorted() {
            outputs.pass(0, "the axes are in order");
            return Ok(());
        }
        let permuted: SmallVec<[usize; 4]> = self.axes.iter().map(|&axis| shape[axis]).collect();
        let permuted = Shape::from(&permuted[..]);
        let walk = self.walk(shape, &permuted);
        let (x, y) = (inputs.data(0), outputs.push(permuted));
        walk.for_each(|[to, from]| y[to] = x[from]);
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let (x_bar, y_bar) = (x_bar.entries(), kept.only_upstream());
        let walk = self.walk(kept.input_shape(0), kept.output_shape(0));
        walk.for_each(|[to, from]| x_bar[from] += y_bar[to]);
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The array whose axis `j` is axis `axes[j]` of this one.
    ///
    /// # Errors
    /// [`TensorError::Axes`] unless `axes` names each axis once.
    pub fn permute(self, axes: &[usize]) -> Result<Self, TensorError> {
        let op = Permute { operation: "permute", axes: SmallVec::from_slice(axes) };
        self.tape.apply(op, &[self])
    }

    /// The transpose of a matrix: `[m, n]` becomes `[n, m]`.
    ///
    /// # Errors
    /// [`TensorError::Axes`] unless there are two axes.
    pub fn transpose(self) -> Result<Self, TensorError> {
        let op = Permute { operation: "transpose", axes: SmallVec::from_slice(&[1, 0]) };
        self.tape.apply(op, &[self])
    }
}
