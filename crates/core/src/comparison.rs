//! The same pipeline in two precisions, value by value.
//!
//! A pipeline that is generic over its numbers is recorded on two tapes, a rough and an exact tape.
//! Their values are compared in the order of recording. A backward pass to every value
//! ([`Tape::variables`]) compares the gradients, too.
//!
//! The relative error of an array is `max_k |rough_k - exact_k| / max_k |exact_k|`.

use crate::backward::Gradients;
use crate::error::TensorError;
use crate::report::ValueError;
use crate::scalar::Scalar;
use crate::tape::{Inner, Tape};
use crate::tensor::Tensor;

/// The relative errors of the values on `rough`, against those on `exact`, in the order of
/// recording.
///
/// # Errors
/// [`TensorError::Recordings`] unless both tapes hold the values of the same operations.
pub fn value_errors<T: Scalar, U: Scalar>(
    rough: &Tape<T>,
    exact: &Tape<U>,
) -> Result<Vec<ValueError>, TensorError> {
    let (rough, exact) = (rough.inner.borrow(), exact.inner.borrow());
    let compare = |index| {
        let operation = same_operation(&rough, &exact, index)?;
        let (rough, exact) = (&rough.values[index], &exact.values[index]);
        let error = (rough.shape == exact.shape).then(|| {
            let (rough, exact) = (rough.data(), exact.data());
            relative_error(rough.len(), |k| rough[k].to_f64(), |k| exact[k].to_f64())
        });
        Ok(ValueError { index, operation, error })
    };
    (0..rough.live.max(exact.live)).map(compare).collect()
}

/// The relative errors of the gradients `rough`, against `exact`, of two passes to the same
/// variables, in the order of recording; a gradient that there is none of counts as zero.
///
/// # Errors
/// [`TensorError::Recordings`] unless both passes were asked for the same variables, and they are
/// of the same operations.
pub fn gradient_errors<T: Scalar, U: Scalar>(
    rough: &Gradients<'_, T>,
    exact: &Gradients<'_, U>,
) -> Result<Vec<ValueError>, TensorError> {
    let tapes = (rough.tape.inner.borrow(), exact.tape.inner.borrow());
    let (rough, exact) = (&rough.results, &exact.results);
    let compare = |k: usize| {
        let asked = [rough.get(k).map(|asked| asked.0), exact.get(k).map(|asked| asked.0)];
        let index = asked[0].or(asked[1]).unwrap_or_default() as usize;
        if asked[0] != asked[1] {
            let name = |asked: Option<u32>| if asked.is_some() { "a gradient" } else { "nothing" };
            return Err(TensorError::Recordings { value: index, operations: asked.map(name) });
        }
        let operation = same_operation(&tapes.0, &tapes.1, index)?;
        let (rough, exact) = (rough[k].1.as_ref(), exact[k].1.as_ref());
        let (rough_size, exact_size) = (rough.map(Tensor::size), exact.map(Tensor::size));
        let size = rough_size.or(exact_size).unwrap_or_default();
        let error = (size == exact_size.unwrap_or(size)).then(|| {
            let rough = |k: usize| rough.map_or(0.0, |rough| rough.data()[k].to_f64());
            let exact = |k: usize| exact.map_or(0.0, |exact| exact.data()[k].to_f64());
            relative_error(size, rough, exact)
        });
        Ok(ValueError { index, operation, error })
    };
    (0..rough.len().max(exact.len())).map(compare).collect()
}

/// The operation that computed value `index` on both tapes.
fn same_operation<T: Scalar, U: Scalar>(
    rough: &Inner<T>,
    exact: &Inner<U>,
    index: usize,
) -> Result<Option<&'static str>, TensorError> {
    match (rough.operation(index), exact.operation(index)) {
        (Some(rough), Some(exact)) if rough == exact => Ok(rough),
        (rough, exact) => {
            let name =
                |value: Option<Option<_>>| value.map_or("nothing", |of| of.unwrap_or("a leaf"));
            let operations = [name(rough), name(exact)];
            Err(TensorError::Recordings { value: index, operations })
        }
    }
}

/// `max_k |rough(k) - exact(k)| / max_k |exact(k)|` over `0..size`; infinite where only one of two
/// numbers is finite, or only one of the arrays is not zero everywhere.
fn relative_error(size: usize, rough: impl Fn(usize) -> f64, exact: impl Fn(usize) -> f64) -> f64 {
    let (mut error, mut scale) = (0.0_f64, 0.0_f64);
    for k in 0..size {
        let (rough, exact) = (rough(k), exact(k));
        let same = rough == exact || (rough.is_nan() && exact.is_nan());
        let difference = if same { 0.0 } else { (rough - exact).abs() };
        error = error.max(if difference.is_nan() { f64::INFINITY } else { difference });
        if exact.is_finite() {
            scale = scale.max(exact.abs());
        }
    }
    if error == 0.0 { 0.0 } else { error / scale }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Var;

    /// A loss and what it is made of, in any precision.
    fn pipeline<T: Scalar>(tape: &Tape<T>) -> Var<'_, T> {
        let x = tape.leaf(&Tensor::from_fn([50], |k| T::from_f64(0.1 + k as f64 / 64.0)));
        let c = tape.constant_full([50], T::from_f64(0.3));
        ((x * c).exp().reshape([5, 10]).unwrap().sin() - T::from_f64(0.5)).square().sum()
    }

    #[test]
    fn the_errors_are_those_of_the_tensors_that_a_caller_sees() {
        let (rough, exact) = (Tape::<f32>::new(), Tape::<f64>::new());
        let (rough_loss, exact_loss) = (pipeline(&rough), pipeline(&exact));
        let errors = value_errors(&rough, &exact).unwrap();
        assert_eq!(errors.len(), rough.len());
        let pairs = rough.variables().zip(exact.variables());
        for (error, (rough, exact)) in errors.iter().zip(pairs) {
            assert_eq!(error.operation, rough.operation());
            let (rough, exact) = (rough.value().cast::<f64>(), exact.value());
            let largest = |x: &Tensor<f64>| x.data().iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            let pairs = rough.data().iter().zip(exact.data());
            let difference = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert_eq!(error.error, Some(difference / largest(&exact)));
        }
        let [of_rough, of_exact] = [rough_loss.item() as f64, exact_loss.item()];
        let last = (of_rough - of_exact).abs() / of_exact;
        assert_eq!(errors.last().unwrap().error, Some(last));
        assert!(0.0 < last && last < 1e-6);
    }

    #[test]
    fn gradients_are_compared_at_every_value_of_a_pass_to_all() {
        let (rough, exact) = (Tape::<f32>::new(), Tape::<f64>::new());
        let (rough_loss, exact_loss) = (pipeline(&rough), pipeline(&exact));
        let (all, all_exact): (Vec<_>, Vec<_>) =
            (rough.variables().collect(), exact.variables().collect());
        let gradients = rough_loss.backward_to(&all).unwrap();
        let exact_gradients = exact_loss.backward_to(&all_exact).unwrap();
        let errors = gradient_errors(&gradients, &exact_gradients).unwrap();
        // All but the constants have one.
        let indices: Vec<_> = errors.iter().map(|error| error.index).collect();
        let needed = (0..rough.len()).filter(|&k| all[k].needs_gradient());
        assert_eq!(indices, needed.collect::<Vec<_>>());
        assert_eq!(errors.last().unwrap().error, Some(0.0));
        assert!(errors.iter().all(|error| error.error.is_some_and(|error| error < 1e-5)));
        assert!(errors[0].error > Some(0.0));
        // Another number of gradients is another pass.
        let fewer = exact_loss.backward().unwrap();
        assert!(gradient_errors(&gradients, &fewer).is_err());
        assert!(gradient_errors(&rough_loss.backward().unwrap(), &exact_gradients).is_err());
    }

    #[test]
    fn another_pipeline_is_refused_and_another_shape_is_not_compared() {
        let (rough, exact) = (Tape::<f32>::new(), Tape::<f64>::new());
        let [x, y] = [rough.constant_full([2], 1.0), rough.constant_full([3], 1.0)];
        let (x_exact, y_exact) = (exact.constant_full([2], 1.0), exact.constant_full([2], 1.0));
        let errors = value_errors(&rough, &exact).unwrap();
        assert_eq!(errors.iter().map(|of| of.error).collect::<Vec<_>>(), [Some(0.0), None]);
        let _ = (x.exp(), x_exact.sin());
        let message =
            "a comparison needs two recordings of one pipeline, got exp and sin as value 2";
        assert_eq!(value_errors(&rough, &exact).unwrap_err().to_string(), message);
        let _ = (y, y_exact);
        let message =
            "a comparison needs two recordings of one pipeline, got exp and nothing as value 2";
        let shorter = Tape::<f64>::new();
        let _ = [shorter.scalar(1.0), shorter.scalar(1.0)];
        assert_eq!(value_errors(&rough, &shorter).unwrap_err().to_string(), message);
    }

    #[test]
    fn what_only_one_recording_gets_wrong_is_an_infinite_error() {
        let error = |rough: f64, exact: f64| relative_error(1, |_| rough, |_| exact);
        let (nan, infinite) = (f64::NAN, f64::INFINITY);
        for (rough, exact) in [(nan, 1.0), (1.0, nan), (infinite, 1.0), (1.0, infinite), (1.0, 0.0)]
        {
            assert_eq!(error(rough, exact), infinite);
        }
        for same in [0.0, 1.0, nan, infinite] {
            assert_eq!(error(same, same), 0.0);
        }
        assert_eq!(error(3.0, 2.0), 0.5);
    }
}
