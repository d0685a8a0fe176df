//! Operations that map each entry on its own.

use crate::error::TensorError;
use crate::gradient::Accumulators;
use crate::op::{Inputs, Keep, Kept, Op, Outputs};
use crate::parallel::for_each_zipped_mut;
use crate::scalar::Scalar;
use crate::var::Var;

/// What the derivative of a function is computed from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum SlopeFrom {
    /// The function's argument `x`.
    Input,
    /// The function's value `y`.
    Output,
    /// Nothing: the slope is constant.
    Nothing,
}

/// A function of one number and its derivative.
pub(crate) trait Unary<T: Scalar>: Copy + Send + Sync + 'static {
    const NAME: &'static str;
    const SLOPE_FROM: SlopeFrom;

    /// Why f is the identity, if it is.
    fn is_identity(self) -> Option<&'static str> {
        None
    }

    /// y = f(x).
    fn value(self, x: T) -> T;

    /// f'(x), from x or y as [`Unary::SLOPE_FROM`] says.
    fn slope(self, x_or_y: T) -> T;
}

/// `y_k = f(x_k)`; `x_bar_k += f'(x_k) y_bar_k`.
struct Elementwise<F>(F);

impl<T: Scalar, F: Unary<T>> Op<T> for Elementwise<F> {
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
        if let Some(reason) = self.0.is_identity() {
            outputs.pass(0, reason);
            return Ok(());
        }
        let y = outputs.push(inputs.shape(0));
        for_each_zipped_mut(y, [inputs.data(0)], |y, [x]| *y = self.0.value(x));
        Ok(())
    }

    fn keeps(&self, _inputs: &Inputs<'_, T>) -> Keep {
        match F::SLOPE_FROM {
            SlopeFrom::Input => Keep::NOTHING.input(0),
            SlopeFrom::Output => Keep::NOTHING.output(0),
            SlopeFrom::Nothing => Keep::NOTHING,
        }
    }

    fn backward(&self, kept: &Kept<'_, T>, _saved: &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(x_bar) = gradients.get(0) else { return };
        let y_bar = kept.only_upstream();
        let argument = match F::SLOPE_FROM {
            SlopeFrom::Input => kept.input(0),
            SlopeFrom::Output => kept.output(0),
            // Any numbers will do.
            SlopeFrom::Nothing => y_bar,
        };
        x_bar.add_zipped([argument, y_bar], |[argument, y_bar]| self.0.slope(argument) * y_bar);
    }
}

impl<'t, T: Scalar> Var<'t, T> {
    /// Records `f` of each entry.
    pub(crate) fn each<F: Unary<T>>(self, f: F) -> Self {
        self.tape.apply(Elementwise(f), &[self]).expect("any shape has entries to map")
    }
}
