//! Rows of the first axis, by index: `y_r = x_(i_r)`; `x_bar_(i_r) += y_bar_r`, in the order of
//! `r`. The indices have no gradient.
//!
//! In the backward pass each row of `x_bar` gathers its own: they are grouped by index once, and as long
//! as the list is the same one.

use std::sync::Arc;

use crate::axis::{blocks, for_each_line_mut};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::grouping::{Grouping, check};
use crate::listed_rows::sum_listed_rows;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;

struct GatherRows {
    rows: Arc<[u32]>,
}

impl GatherRows {
    const NAME: &'static str = "gather_rows";
}

impl<T: Scalar> Op<T> for GatherRows {
    /// Filled by the first backward pass.
    type Saved = Grouping;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        _saved: &mut Grouping,
    ) -> Result<(), TensorError> {
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let [_, extent, inner] = blocks(shape, 0, Self::NAME)?;
        check(&self.rows, extent, Self::NAME)?;
        let y = outputs.try_push(Self::NAME, shape.with(0, self.rows.len()))?;
        for_each_line_mut(y, inner, [], |r, y, []| {
            y.copy_from_slice(&x[self.rows[r] as usize * inner..][..inner]);
        });
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        saved: &mut Grouping,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(x_bar) = gradients.get(0) else { return };
        let shape = kept.input_shape(0);
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        if x_bar.is_empty() {
            return;
        }
        let (y_bar, inner) = (kept.only_upstream(), x_bar.len() / shape[0]);
        let lists = saved.lists(&self.rows, shape[0]);
        let put = |x_bar: &mut T, sum: T::Wide| {
            let sum = T::narrow(sum);
            *x_bar = if fresh { sum } else { *x_bar + sum };
        };
        sum_listed_rows(lists, None, y_bar, inner, x_bar, put);
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The rows of `self: [n, ...]` that `rows` names, of shape `[rows.len(), ...]`. The list is
    /// shared, so that a step that gathers again copies nothing.
    ///
    /// # Errors
    /// [`TensorError::Axis`] for a scalar; [`TensorError::Index`] unless each of `rows` is below n;
    /// [`TensorError::Value`] for 2^32 rows or more.
    pub fn gather_rows(self, rows: &Arc<[u32]>) -> Result<Self, TensorError> {
        self.tape.apply(GatherRows { rows: Arc::clone(rows) }, &[self])
    }
}
