//! Every operation, compiled for `f32`, and with the feature `precompiled-f64` for `f64`, too.
//!
//! The compiler generates a generic function anew in each crate that uses it with concrete types,
//! unless the function is never inlined and a crate below has it for the same types already. The
//! function behind [`Tape::record`] and [`Tape::apply`] and the function behind [`Var::backward`] are
//! never inlined, so it is enough that this crate uses each operation once. Nobody calls
//! these functions. An operation that is missing here still works: it is compiled where it is used.

use std::sync::Arc;

use crate::error::TensorError;
use crate::ops::{Padding, mean_squared_error, squared_error};
use crate::scalar::Scalar;
use crate::sparse::SparseMatrix;
use crate::tape::Tape;
use crate::tensor::Tensor;
use crate::var::Var;

macro_rules! for_each_precision {
    ($($name:ident: $t:ty),*) => {
        $(pub fn $name(tape: &mut Tape<$t>) -> Result<(), TensorError> {
            every_operation(tape.constant(&Tensor::zeros([])))?;
            tape.reset();
            Ok(())
        })*
    };
}

for_each_precision!(f32_operations: f32);
#[cfg(feature = "precompiled-f64")]
for_each_precision!(f64_operations: f64);

/// The tape itself in `f64`, with as few operations as can be.
pub fn f64_tape(tape: &mut Tape<f64>) -> Result<(), TensorError> {
    let x = tape.constant(&Tensor::zeros([]));
    ((x + x) * x - x).sum().backward()?;
    tape.reset();
    Ok(())
}

#[expect(clippy::eq_op, reason = "each operation once, on whatever is at hand")]
fn every_operation<T: Scalar>(x: Var<'_, T>) -> Result<(), TensorError> {
    let mask = x.is_less(x)?.and(&x.is_greater(x)?)?.or(&x.is_at_most(x)?)?;
    let mask = mask.and(&x.is_at_least(x)?)?.and(&x.is_finite())?;
    let pairs = [
        x + x,
        x - x,
        x * x,
        x / x,
        x.pow(x)?,
        x.minimum(x)?,
        x.maximum(x)?,
        mask.select(x, x)?,
        x.dot(x)?,
        x.cross(x)?,
    ];
    let entries = [x.exp(), x.ln(), x.sqrt(), x.powi(2), x.powf(T::ONE), x.sin(), x.cos()];
    let further = [x.tanh(), x.sigmoid(), x.softplus(), x.relu(), x.abs(), -x];
    let sums = [
        x.sum(),
        x.sum_axis(0)?,
        x.mean()?,
        x.mean_axis(0)?,
        x.norm()?,
        x.normalize()?,
        x.matmul(x)?,
        SparseMatrix::new(0, 0, [])?.product(x)?,
        squared_error(x, x)?,
        mean_squared_error(x, x)?,
    ];
    let parts = [
        x.clamp(T::ZERO, T::ONE)?,
        x.reshape([])?,
        x.keepdim(0)?,
        x.permute(&[])?,
        x.slice(0, 0..0)?,
        x.pad(0, [0, 0], Padding::Clamp)?,
        x.gather_rows(&Arc::from([]))?,
        x.scatter_add_rows(&Arc::from([]), 0)?,
    ];
    let all = [&pairs[..], &entries, &further, &sums, &parts].concat();
    Var::stack(&[Var::concat(&all, 0)?], 0)?.backward()?;
    Ok(())
}
