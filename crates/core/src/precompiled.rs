//! Operations that are compiled ahead: those of the program `bokashi` in `f32`, and with the feature `precompiled-f64`
//! all of them, in `f64` too.
//!
//! The compiler generates a generic function anew in each crate that uses it with concrete types,
//! unless the function is never inlined and a crate below has it for the same types already. The
//! function behind [`Tape::record`] and [`Tape::apply`] and the function behind [`Var::backward`] are
//! never inlined, so it is enough that this crate uses each operation once. Nobody calls
//! these functions. An operation that is missing here still works: it is compiled where it is used.

use std::sync::Arc;

use crate::error::TensorError;
#[cfg(feature = "precompiled-f64")]
use crate::ops::Padding;
use crate::ops::{mean_squared_error, squared_error};
use crate::scalar::Scalar;
use crate::sparse::SparseMatrix;
use crate::tape::Tape;
use crate::tensor::Tensor;
use crate::var::Var;

macro_rules! for_each_precision {
    ($($name:ident: $operations:ident in $t:ty),*) => {
        $(pub fn $name(tape: &mut Tape<$t>) -> Result<(), TensorError> {
            $operations(tape.constant(&Tensor::zeros([])))?;
            tape.reset();
            Ok(())
        })*
    };
}

for_each_precision!(f32_operations: operations_of_the_program in f32);
#[cfg(feature = "precompiled-f64")]
for_each_precision!(
    f32_others: other_operations in f32,
    f64_operations: operations_of_the_program in f64,
    f64_others: other_operations in f64
);

/// The tape itself in `f64`, with as few operations as can be.
pub fn f64_tape(tape: &mut Tape<f64>) -> Result<(), TensorError> {
    let x = tape.constant(&Tensor::zeros([]));
    ((x + x) * x - x).sum().backward()?;
    tape.reset();
    Ok(())
}

#[expect(clippy::eq_op, reason = "each operation once, on whatever is at hand")]
fn operations_of_the_program<T: Scalar>(x: Var<'_, T>) -> Result<(), TensorError> {
    let mask = x.is_greater(x)?;
    let pairs =
        [x + x, x - x, x * x, x / x, x.pow(x)?, x.maximum(x)?, mask.select(x, x)?, x.dot(x)?];
    let entries = [
        x.exp(),
        x.sqrt(),
        x.powi(2),
        x.powf(T::ONE),
        x.sin(),
        x.relu(),
        x.sigmoid(),
        x.softplus(),
        x.abs(),
        -x,
    ];
    let sums = [
        x.sum(),
        x.mean()?,
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
        x.slice(0, 0..0)?,
        x.gather_rows(&Arc::from([]))?,
    ];
    let all = [&pairs[..], &entries, &sums, &parts].concat();
    Var::concat(&all, 0)?.backward()?;
    Ok(())
}

#[cfg(feature = "precompiled-f64")]
fn other_operations<T: Scalar>(x: Var<'_, T>) -> Result<(), TensorError> {
    let mask = x.is_less(x)?.or(&x.is_at_most(x)?)?;
    let mask = mask.and(&x.is_at_least(x)?)?.and(&x.is_finite())?;
    let all = [
        mask.select(x, x)?,
        x.minimum(x)?,
        x.cross(x)?,
        x.ln(),
        x.cos(),
        x.tanh(),
        x.sum_axis(0)?,
        x.mean_axis(0)?,
        x.permute(&[])?,
        x.pad(0, [0, 0], Padding::Clamp)?,
        x.scatter_add_rows(&Arc::from([]), 0)?,
    ];
    Var::stack(&all, 0)?.backward()?;
    Ok(())
}
