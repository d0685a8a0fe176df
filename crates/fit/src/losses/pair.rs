//! Checks of two images that are compared. They come before anything is recorded, so a call that is refused
//! leaves the tape as it was.

use bokashi_core::{Scalar, TensorError, Var};

/// Checks that two variables belong to one tape.
pub(crate) fn check_tapes<T: Scalar>(
    operation: &'static str,
    [one, other]: [Var<'_, T>; 2],
) -> Result<(), TensorError> {
    match std::ptr::eq(one.tape(), other.tape()) {
        true => Ok(()),
        false => Err(TensorError::ForeignVariable { operation }),
    }
}

/// Checks that two variables belong to one tape and have one shape. `rule` says so in the error.
pub(crate) fn check_pair<T: Scalar>(
    operation: &'static str,
    rule: &'static str,
    pair: [Var<'_, T>; 2],
) -> Result<(), TensorError> {
    check_tapes(operation, pair)?;
    let shapes = pair.map(|variable| variable.shape());
    if shapes[0] == shapes[1] {
        return Ok(());
    }
    Err(TensorError::Mismatch { operation, rule: rule.into(), shapes: Box::new(shapes) })
}
