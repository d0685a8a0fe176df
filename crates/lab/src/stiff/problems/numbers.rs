//! Parameters taken apart into entries, and residuals put together.

use bokashi_core::{Scalar, Tensor, TensorError, Var};
use bokashi_fit::FitError;

/// The entry `k` of `x`, of shape `[1]`.
pub(super) fn entry<'t, T: Scalar>(x: Var<'t, T>, k: usize) -> Result<Var<'t, T>, TensorError> {
    x.slice(0, k..k + 1)
}

/// The entries of `x: [N]`, of shape `[1]` each.
pub(super) fn entries<'t, T: Scalar, const N: usize>(
    x: Var<'t, T>,
) -> Result<[Var<'t, T>; N], TensorError> {
    let mut all = [x; N];
    for (k, one) in all.iter_mut().enumerate() {
        *one = entry(x, k)?;
    }
    Ok(all)
}

/// Given numbers on the tape of `x`, of shape `[m]`.
pub(super) fn given<'t, T: Scalar>(x: Var<'t, T>, values: &[f64]) -> Var<'t, T> {
    x.tape().constant(&Tensor::from_fn([values.len()], |k| T::from_f64(values[k])))
}

/// Residuals of shape `[1]` each as one `[m]`.
pub(super) fn stacked<'t, T: Scalar>(residuals: &[Var<'t, T>]) -> Result<Var<'t, T>, FitError> {
    Ok(Var::concat(residuals, 0)?)
}
