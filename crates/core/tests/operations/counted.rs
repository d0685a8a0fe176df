//! An operation that counts how often memory is made for what it saves.

use std::cell::Cell;

use bokashi_core::{Accumulators, Inputs, Kept, Op, Outputs, TensorError};

thread_local! {
    static MADE: Cell<usize> = const { Cell::new(0) };
}

/// How often this thread made memory for what such operations save.
pub(crate) fn made() -> usize {
    MADE.get()
}

/// `y = x`; operations of several kinds differ in `K`.
pub(crate) struct Counted<const K: usize>;

pub(crate) struct Saved;

impl Default for Saved {
    fn default() -> Self {
        MADE.set(MADE.get() + 1);
        Self
    }
}

impl<const K: usize> Op<f64> for Counted<K> {
    type Saved = Saved;
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "counted"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, f64>,
        outputs: &mut Outputs<'_, f64>,
        _saved: &mut Saved,
    ) -> Result<(), TensorError> {
        outputs.push(inputs.shape(0)).copy_from_slice(inputs.data(0));
        Ok(())
    }

    fn backward(
        &self,
        kept: &Kept<'_, f64>,
        _saved: &mut Saved,
        gradients: &mut Accumulators<'_, f64>,
    ) {
        if let Some(x_bar) = gradients.get(0) {
            x_bar.add(kept.only_upstream());
        }
    }
}
