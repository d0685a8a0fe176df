//! Rows of the first axis, by index: `y_r = x_(i_r)`; `x_bar_(i_r) += y_bar_r`, in the order of
//! `r`. The indices have no gradient.

use std::sync::Arc;

use crate::axis::blocks;
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;

struct GatherRows {
    rows: Arc<[u32]>,
}

impl GatherRows {
    const NAME: &'static str = "gather_rows";
}

impl<T: Scalar> Op<T> for GatherRows {
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
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let [_, extent, inner] = blocks(shape, 0, Self::NAME)?;
        if let Some(&row) = self.rows.iter().find(|&&row| row as usize >= extent) {
            let (operation, index) = (Self::NAME, row as usize);
            return Err(TensorError::Index { operation, index, extent });
        }
        let y = outputs.push(shape.with(0, self.rows.len()));
        for (&row, y) in self.rows.iter().zip(y.chunks_mut(inner.max(1))) {
            y.copy_from_slice(&x[row as usize * inner..][..inner]);
        }
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        Keep::NOTHING
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let (x_bar, y_bar) = (x_bar.entries(), kept.only_upstream());
        let inner = kept.input_shape(0)[1..].iter().product::<usize>();
        for (&row, y_bar) in self.rows.iter().zip(y_bar.chunks(inner.max(1))) {
            let x_bar = &mut x_bar[row as usize * inner..][..inner];
            x_bar.iter_mut().zip(y_bar).for_each(|(x_bar, &y_bar)| *x_bar += y_bar);
        }
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The rows of `self: [n, ...]` that `rows` names, of shape `[rows.len(), ...]`. The list is
    /// shared, so that a step that gathers again copies nothing.
    ///
    /// # Errors
    /// [`TensorError::Axis`] for a scalar; [`TensorError::Index`] unless each of `rows` is below n.
    pub fn gather_rows(self, rows: &Arc<[u32]>) -> Result<Self, TensorError> {
        self.tape.apply(GatherRows { rows: Arc::clone(rows) }, &[self])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tape::Tape;
    use crate::tensor::Tensor;

    #[test]
    fn a_row_gathered_twice_collects_both_gradients() {
        let tape = Tape::new();
        let x = tape.leaf(&Tensor::from_flat_fn([3, 2], |k| k as f64));
        let y = x.gather_rows(&Arc::from([2, 0, 2])).unwrap();
        assert_eq!(y.value().data(), [4.0, 5.0, 0.0, 1.0, 4.0, 5.0]);
        let upstream = Tensor::from_flat_fn([3, 2], |k| 1.0 + k as f64);
        let gradients = tape.vjp(&[(y, &upstream)]).unwrap();
        assert_eq!(gradients.get(x).unwrap().data(), [3.0, 4.0, 0.0, 0.0, 6.0, 8.0]);
    }

    #[test]
    fn rows_without_entries_and_no_rows_are_defined() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&Tensor::zeros([3, 0]));
        let y = x.gather_rows(&Arc::from([1, 1])).unwrap();
        assert_eq!(y.value(), Tensor::zeros([2, 0]));
        assert_eq!(y.sum().backward().unwrap().get_or_zeros(x).size(), 0);
        let none = tape.leaf(&Tensor::zeros([3, 2])).gather_rows(&Arc::from([])).unwrap();
        assert_eq!(none.value(), Tensor::zeros([0, 2]));
    }

    #[test]
    fn the_list_is_let_go_with_the_step() {
        let mut tape = Tape::new();
        let rows = Arc::from([0]);
        let _ = tape.leaf(&Tensor::full([1, 1], 1.0)).gather_rows(&rows).unwrap();
        assert_eq!(Arc::strong_count(&rows), 2);
        tape.reset();
        assert_eq!(Arc::strong_count(&rows), 1);
    }

    #[test]
    fn rows_must_exist() {
        let tape = Tape::<f64>::new();
        let x = tape.leaf(&Tensor::zeros([3, 2]));
        let message = "gather_rows needs indices within an axis of extent 3, got 3";
        assert_eq!(x.gather_rows(&Arc::from([0, 3, 9])).unwrap_err().to_string(), message);
        assert!(tape.leaf_scalar(0.0).gather_rows(&Arc::from([])).is_err());
    }
}
