//! Jacobian-vector and Hessian-vector products, over dual numbers.
//!
//! # Forward
//! `f(x + v e) = f(x) + J v e`: one run of `f` over dual numbers, no Jacobian.
//!
//! # Forward over reverse
//! The gradient of a scalar `f` is a function of `x` too, so at `x + v e` the backward pass gives
//! `g + H v e`: one step over dual numbers, no Hessian.
//!
//! # Source
//! Pearlmutter, *Fast exact multiplication by the Hessian*, Neural Computation 6(1), 1994.

use crate::dual::Dual;
use crate::error::TensorError;
use crate::scalar::Scalar;
use crate::tape::Tape;
use crate::tensor::Tensor;
use crate::var::Var;

/// Tensors of dual numbers.
impl<T: Scalar, const HAS_BACKWARD: bool> Tensor<Dual<T, HAS_BACKWARD>> {
    /// `values + tangents e`, entry by entry.
    ///
    /// # Errors
    /// [`TensorError::Mismatch`] unless both have the same shape.
    pub fn dual(values: &Tensor<T>, tangents: &Tensor<T>) -> Result<Self, TensorError> {
        if values.shape() != tangents.shape() {
            return Err(TensorError::Mismatch {
                operation: "dual",
                rule: "a tangent of its value's shape".into(),
                shapes: Box::new([tangents.shape().clone(), values.shape().clone()]),
            });
        }
        let entries = values.data().iter().zip(tangents.data());
        Self::new(
            values.shape(),
            entries.map(|(&value, &tangent)| Dual { value, tangent }).collect(),
        )
    }

    /// The values of the entries.
    pub fn values(&self) -> Tensor<T> {
        self.map(|entry| entry.value)
    }

    /// The tangents of the entries.
    pub fn tangents(&self) -> Tensor<T> {
        self.map(|entry| entry.tangent)
    }
}

/// `f(x)` and `J v`, the derivative of `f` at `x` along `v`, for `point` the pairs `(x, v)` of its
/// inputs.
///
/// `f` is run once over dual numbers on `tape`, which starts a new step: the same tape again
/// recycles its memory. It is a tape of [`ForwardDual`](crate::ForwardDual) numbers, or, where
/// [`hvp`] compiles `f` over [`Dual`] anyway, of these.
///
/// ```
/// use bokashi_core::{ForwardDual, Tape, Tensor, TensorError, jvp};
///
/// let (x, v) = (Tensor::new([2], vec![3.0, 5.0])?, Tensor::new([2], vec![1.0, 0.0])?);
/// let mut tape = Tape::<ForwardDual<f64>>::new();
/// let [y, slope] = jvp(&mut tape, &[(&x, &v)], |x| {
///     Ok::<_, TensorError>(x[0].slice(0, 0..1)? * x[0].slice(0, 1..2)?)
/// })?;
/// assert_eq!((y.data(), slope.data()), (&[15.0][..], &[5.0][..]));
/// # Ok::<(), TensorError>(())
/// ```
///
/// # Errors
/// [`TensorError::Mismatch`] unless each tangent has the shape of its value, and whatever `f`
/// refuses.
pub fn jvp<T: Scalar, E: From<TensorError>, const HAS_BACKWARD: bool>(
    tape: &mut Tape<Dual<T, HAS_BACKWARD>>,
    point: &[(&Tensor<T>, &Tensor<T>)],
    f: impl for<'t> FnOnce(
        &[Var<'t, Dual<T, HAS_BACKWARD>>],
    ) -> Result<Var<'t, Dual<T, HAS_BACKWARD>>, E>,
) -> Result<[Tensor<T>; 2], E> {
    tape.reset();
    let tape = &*tape;
    // Constants: nothing is kept for a backward pass.
    let record = |&(x, v): &(&Tensor<T>, &Tensor<T>)| Ok(tape.constant(&Tensor::dual(x, v)?));
    let inputs = point.iter().map(record).collect::<Result<Vec<_>, TensorError>>()?;
    let y = f(&inputs)?.value();
    Ok([y.values(), y.tangents()])
}

/// The gradient of the scalar `f` at `x`, and `H v`, the Hessian times `v`, for each input; `point`
/// are the pairs `(x, v)` of the inputs, and `v` is one direction across all of them.
///
/// `f` is run once over dual numbers on `tape`, forward and backward; the tape starts a new step.
///
/// ```
/// use bokashi_core::{Tape, Tensor, TensorError, hvp};
///
/// // x^2 y: the gradient is (2 x y, x^2), the Hessian [[2 y, 2 x], [2 x, 0]].
/// let [x, y, one, zero] = [3.0, 5.0, 1.0, 0.0].map(Tensor::<f64>::scalar);
/// let products = hvp(&mut Tape::new(), &[(&x, &one), (&y, &zero)], |inputs| {
///     Ok::<_, TensorError>(inputs[0].square() * inputs[1])
/// })?;
/// assert_eq!(products, [[30.0, 10.0], [9.0, 6.0]].map(|pair| pair.map(Tensor::scalar)));
/// # Ok::<(), TensorError>(())
/// ```
///
/// # Errors
/// [`TensorError::Mismatch`] unless each tangent has the shape of its value,
/// [`TensorError::NotScalar`] unless `f` gives exactly one entry, and whatever `f` refuses.
pub fn hvp<T: Scalar, E: From<TensorError>>(
    tape: &mut Tape<Dual<T>>,
    point: &[(&Tensor<T>, &Tensor<T>)],
    f: impl for<'t> FnOnce(&[Var<'t, Dual<T>>]) -> Result<Var<'t, Dual<T>>, E>,
) -> Result<Vec<[Tensor<T>; 2]>, E> {
    tape.reset();
    let tape = &*tape;
    let record = |&(x, v): &(&Tensor<T>, &Tensor<T>)| Ok(tape.leaf(&Tensor::dual(x, v)?));
    let inputs = point.iter().map(record).collect::<Result<Vec<_>, TensorError>>()?;
    let gradients = f(&inputs)?.backward_to(&inputs)?;
    let product = |&input: &Var<'_, Dual<T>>| {
        let gradient = gradients.get_or_zeros(input);
        [gradient.values(), gradient.tangents()]
    };
    Ok(inputs.iter().map(product).collect())
}
