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
impl<T: Scalar> Tensor<Dual<T>> {
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
        Self::new(values.shape(), entries.map(|(&value, &v)| Dual::new(value, v)).collect())
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
/// recycles its memory.
///
/// ```
/// use bokashi_core::{Tape, Tensor, TensorError, jvp};
///
/// let (x, v) = (Tensor::new([2], vec![3.0, 5.0])?, Tensor::new([2], vec![1.0, 0.0])?);
/// let [y, slope] = jvp(&mut Tape::new(), &[(&x, &v)], |x| {
///     Ok::<_, TensorError>(x[0].slice(0, 0..1)? * x[0].slice(0, 1..2)?)
/// })?;
/// assert_eq!((y.data(), slope.data()), (&[15.0][..], &[5.0][..]));
/// # Ok::<(), TensorError>(())
/// ```
///
/// # Errors
/// [`TensorError::Mismatch`] unless each tangent has the shape of its value, and whatever `f`
/// refuses.
pub fn jvp<T: Scalar, E: From<TensorError>>(
    tape: &mut Tape<Dual<T>>,
    point: &[(&Tensor<T>, &Tensor<T>)],
    f: impl for<'t> FnOnce(&[Var<'t, Dual<T>>]) -> Result<Var<'t, Dual<T>>, E>,
) -> Result<[Tensor<T>; 2], E> {
    tape.reset();
    let tape = &*tape;
    // Constants: nothing is kept for a backward pass.
    let place = |&(x, v): &(&Tensor<T>, &Tensor<T>)| Ok(tape.constant(&Tensor::dual(x, v)?));
    let inputs = point.iter().map(place).collect::<Result<Vec<_>, TensorError>>()?;
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
    let place = |&(x, v): &(&Tensor<T>, &Tensor<T>)| Ok(tape.leaf(&Tensor::dual(x, v)?));
    let inputs = point.iter().map(place).collect::<Result<Vec<_>, TensorError>>()?;
    let gradients = f(&inputs)?.backward_to(&inputs)?;
    let product = |&input: &Var<'_, Dual<T>>| {
        let gradient = gradients.get_or_zeros(input);
        [gradient.values(), gradient.tangents()]
    };
    Ok(inputs.iter().map(product).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `sum exp(x y) + x^3` of `[2]` and `[]`.
    fn curved<'t, T: Scalar>(inputs: &[Var<'t, T>]) -> Result<Var<'t, T>, TensorError> {
        let &[x, y] = inputs else { unreachable!("there are two") };
        Ok(((x * y).exp() + x.powi(3)).sum())
    }

    #[test]
    fn products_by_hand_on_one_tape() {
        let mut tape = Tape::new();
        let (x, y) = (Tensor::new([2], vec![0.3, -0.7]).unwrap(), Tensor::scalar(0.9_f64));
        let (v, w) = (Tensor::new([2], vec![1.5, 0.25]).unwrap(), Tensor::scalar(-2.0));
        let e = x.map(|x| (0.9 * x).exp());
        let near = |got: &Tensor<f64>, expected: &[f64]| {
            let pairs = got.data().iter().zip(expected);
            assert_eq!(got.size(), expected.len());
            pairs.for_each(|(a, b)| assert!((a - b).abs() < 1e-14, "{a} {b}"));
        };
        for _ in 0..2 {
            let [value, slope] = jvp(&mut tape, &[(&x, &v), (&y, &w)], curved).unwrap();
            let sum = |term: &dyn Fn(f64, f64, f64) -> f64| {
                (0..2).map(|k| term(x.data()[k], e.data()[k], v.data()[k])).sum::<f64>()
            };
            near(&value, &[sum(&|x, e, _| e + x.powi(3))]);
            let along = sum(&|x, e, v| (0.9 * e + 3.0 * x * x) * v - 2.0 * x * e);
            near(&slope, &[along]);
            let products = hvp(&mut tape, &[(&x, &v), (&y, &w)], curved).unwrap();
            let of_x = |term: &dyn Fn(f64, f64, f64) -> f64| {
                [0, 1].map(|k| term(x.data()[k], e.data()[k], v.data()[k]))
            };
            near(&products[0][0], &of_x(&|x, e, _| 0.9 * e + 3.0 * x * x));
            near(&products[1][0], &[sum(&|x, e, _| x * e)]);
            let mixed = |x: f64, e: f64| e + 0.9 * x * e;
            let h = of_x(&|x, e, v| (0.81 * e + 6.0 * x) * v - 2.0 * mixed(x, e));
            near(&products[0][1], &h);
            near(&products[1][1], &[sum(&|x, e, v| mixed(x, e) * v - 2.0 * x * x * e)]);
        }
    }

    #[test]
    fn an_input_that_is_not_used_has_products_of_zero() {
        let (x, v) = (Tensor::scalar(2.0), Tensor::scalar(1.0));
        let point = [(&x, &v), (&x, &v)];
        let of = hvp(&mut Tape::new(), &point, |x| Ok::<_, TensorError>(x[0].square())).unwrap();
        assert_eq!((of[1][0].item(), of[1][1].item()), (0.0, 0.0));
        assert_eq!((of[0][0].item(), of[0][1].item()), (4.0, 2.0));
    }

    #[test]
    fn a_tangent_has_the_shape_of_its_value_and_a_hessian_is_of_a_scalar() {
        let (x, v) = (Tensor::full([2], 1.0_f64), Tensor::full([3], 1.0));
        let message = "dual needs a tangent of its value's shape, got shapes [3] and [2]";
        let refused = jvp(&mut Tape::new(), &[(&x, &v)], |x| Ok::<_, TensorError>(x[0]));
        assert_eq!(refused.unwrap_err().to_string(), message);
        let refused = hvp(&mut Tape::new(), &[(&x, &x)], |x| Ok::<_, TensorError>(x[0]));
        assert!(matches!(refused, Err(TensorError::NotScalar { .. })));
    }
}
