//! One update of gradient descent: `x -= a g`.

use bokashi_core::Scalar;

use super::entries::{first_not_finite, value_of, vanishes};
use crate::parameter::Parameter;

/// Updates a parameter along its gradient. Returns the number of entries whose updates vanished.
pub(super) fn descend<T: Scalar>(
    parameter: &mut Parameter<T>,
    gradient: Option<&[T]>,
    rate: f64,
) -> usize {
    let Some(gradient) = gradient else { return 0 };
    let rate = T::from_f64(rate);
    let mut vanished = 0;
    for (x, &g) in parameter.raw.data_mut().iter_mut().zip(gradient) {
        let new = *x + -rate * g;
        vanished += usize::from(vanishes(*x, new, g, rate));
        *x = new;
    }
    vanished
}

/// The first value that [`descend`] would make infinite or NaN.
pub(super) fn descends_out_of_range<T: Scalar>(
    parameter: &Parameter<T>,
    gradient: Option<&[T]>,
    rate: f64,
) -> Option<T> {
    let (raw, mapping, rate) = (parameter.raw.data(), parameter.mapping, T::from_f64(rate));
    let gradient = &gradient?[..raw.len()];
    first_not_finite(raw.len(), |k| value_of(mapping, raw[k] + -rate * gradient[k]))
}
