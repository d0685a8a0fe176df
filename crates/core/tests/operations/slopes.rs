//! Values and slopes of scalars.

use bokashi_core::{Scalar, Tape, Var};

/// `f(x)` and `f'(x)`, as the tape computes them.
pub(crate) fn value_and_slope<T: Scalar>(x: T, f: for<'t> fn(Var<'t, T>) -> Var<'t, T>) -> [T; 2] {
    let tape = Tape::new();
    let x = tape.leaf_scalar(x);
    let y = f(x);
    [y.item(), y.backward().expect("a scalar").get_or_zeros(x).item()]
}

/// `f(x, y)` and its partial derivatives, as the tape computes them.
pub(crate) fn value_and_slopes<T: Scalar>(
    x: T,
    y: T,
    f: for<'t> fn(Var<'t, T>, Var<'t, T>) -> Var<'t, T>,
) -> [T; 3] {
    let tape = Tape::new();
    let (x, y) = (tape.leaf_scalar(x), tape.leaf_scalar(y));
    let z = f(x, y);
    let gradients = z.backward().expect("a scalar");
    [z.item(), gradients.get_or_zeros(x).item(), gradients.get_or_zeros(y).item()]
}
