//! Rows added to those of another array, by index: `y_(i_r) += x_r`, in the order of `r`;
//! `x_bar_r += y_bar_(i_r)`. The adjoint of `gather_rows`. The indices have no gradient.
//!
//! Each row of `y` gathers its own: they are grouped by index once, and as long as the list is the same
//! one.

use std::sync::Arc;

use crate::axis::{blocks, for_each_line_mut};
use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::grouping::{Grouping, check};
use crate::listed_rows::sum_listed_rows;
use crate::op::{Inputs, Kept, Op, Outputs};
use crate::scalar::Scalar;
use crate::var::Var;

struct ScatterAddRows {
    rows: Arc<[u32]>,
    count: usize,
}

impl ScatterAddRows {
    const NAME: &'static str = "scatter_add_rows";
}

impl<T: Scalar> Op<T> for ScatterAddRows {
    type Saved = Grouping;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        saved: &mut Grouping,
    ) -> Result<(), TensorError> {
        let (x, shape) = (inputs.data(0), inputs.shape(0));
        let (operation, count) = (Self::NAME, self.count);
        let [_, extent, inner] = blocks(shape, 0, operation)?;
        if extent != self.rows.len() {
            let rule = format!("{} rows, one per index", self.rows.len()).into();
            return Err(TensorError::Shape { operation, rule, shape: shape.clone() });
        }
        check(&self.rows, count, operation)?;
        let summed = shape.with(0, count);
        let y = outputs.try_push(operation, summed)?;
        if y.is_empty() {
            return Ok(());
        }
        let lists = saved.lists(&self.rows, count);
        sum_listed_rows(lists, None, x, inner, y, |y, sum| *y = T::narrow(sum));
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, T>,
        _saved: &mut Grouping,
        gradients: &mut Accumulators<'_, T>,
    ) {
        let Some(x_bar) = gradients.get(0) else { return };
        let y_bar = kept.only_upstream();
        let (x_bar, fresh) = x_bar.entries_or_fresh();
        let inner = x_bar.len() / self.rows.len().max(1);
        for_each_line_mut(x_bar, inner, [], |r, x_bar, []| {
            let y_bar = &y_bar[self.rows[r] as usize * inner..][..inner];
            for (x_bar, &y_bar) in x_bar.iter_mut().zip(y_bar) {
                *x_bar = if fresh { y_bar } else { *x_bar + y_bar };
            }
        });
    }

    fn saved_bytes(&self, saved: &Grouping) -> usize {
        saved.bytes()
    }
}

impl<T: Scalar> Var<'_, T> {
    /// The sums `y: [count, ...]` of the rows of `self: [rows.len(), ...]`: row `r` is added to
    /// `y_(rows[r])`. What no index names is 0. The list is shared; as long as it is the same one, rows
    /// are not sorted by index again.
    ///
    /// # Errors
    /// [`TensorError::Axis`] for a scalar; [`TensorError::Shape`] unless there is a row per index;
    /// [`TensorError::Index`] unless each of `rows` is below `count`; [`TensorError::Memory`] for sums
    /// that take more than there is; [`TensorError::Value`] for 2^32 rows or more.
    pub fn scatter_add_rows(self, rows: &Arc<[u32]>, count: usize) -> Result<Self, TensorError> {
        self.tape.apply(ScatterAddRows { rows: Arc::clone(rows), count }, &[self])
    }
}
