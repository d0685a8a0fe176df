//! What an operation on a surface needs of numbers at vertices: rows of a known width, all finite.

use bokashi_core::{Inputs, Scalar, TensorError};

use crate::error::RenderError;

/// Which input of which operation has which rows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows {
    pub(crate) operation: &'static str,
    /// The input's name, in the plural.
    pub(crate) name: &'static str,
    pub(crate) input: usize,
    /// How many rows there are, of how many numbers.
    pub(crate) shape: [usize; 2],
}

impl Rows {
    /// Checks the input.
    ///
    /// # Errors
    /// [`RenderError::Shape`] for another shape; `TensorError::Value` for a number that is not finite.
    pub(crate) fn check<T: Scalar>(&self, inputs: &Inputs<'_, T>) -> Result<(), RenderError> {
        let Self { operation, name, input, shape } = *self;
        if **inputs.shape(input) != shape {
            let [count, width] = shape;
            let rule = format!("{name} of shape [{count}, {width}]");
            return Err(RenderError::Shape { operation, rule, shape: inputs.shape(input).clone() });
        }
        // Without a branch for each number.
        let data = inputs.data(input);
        let is_finite = |part: &[T]| part.iter().fold(true, |all, entry| all & entry.is_finite());
        if data.chunks(1024).all(is_finite) {
            return Ok(());
        }
        let index = data.iter().position(|entry| !entry.is_finite()).unwrap_or_default();
        let rule = format!("finite numbers in row {} of the {name}", index / shape[1]).into();
        Err(TensorError::Value { operation, rule, value: data[index].to_f64() }.into())
    }
}
