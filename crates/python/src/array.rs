//! Arrays of numpy, of `float32` or `float64`, and those that carry tangents.

use std::borrow::Cow;
use std::sync::Mutex;

use bokashi_core::{Recording, Scalar, Tape, Tensor};
use numpy::{
    Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use smallvec::SmallVec;

use crate::error::Refusal;

/// A number with a tangent. In double precision alone: so all operations are compiled for three types and not for four.
pub type DualNumber = bokashi_core::Dual<f64>;

/// A type of numbers that Python and the tape share.
pub trait Number: Scalar {
    /// Its name in numpy.
    const NAME: &'static str;

    /// Which of the types it is.
    const TYPE: NumberType;

    /// Tapes of steps that Python has let go of, to be used again.
    fn tapes() -> &'static Mutex<Vec<Tape<Self>>>;

    /// The numbers of an array, which has to be of this type. A number without a tangent stays as it is.
    ///
    /// # Errors
    /// `TypeError` for an array of another type.
    fn view<'a>(array: &'a Array<'_>) -> PyResult<View<'a, Self>>;

    /// A tensor as an object of its own.
    fn to_array(py: Python<'_>, tensor: Tensor<Self>) -> PyResult<Bound<'_, PyAny>>;

    /// The recording of this type.
    fn pull_back(recording: Recording<Self>) -> Kind;
}

macro_rules! tapes {
    ($number:ty) => {
        fn tapes() -> &'static Mutex<Vec<Tape<Self>>> {
            static TAPES: Mutex<Vec<Tape<$number>>> = Mutex::new(Vec::new());
            &TAPES
        }
    };
}

macro_rules! number {
    ($number:ident, $name:literal, $kind:ident) => {
        impl Number for $number {
            const NAME: &'static str = $name;
            const TYPE: NumberType = NumberType::$kind;

            tapes!($number);

            fn view<'a>(array: &'a Array<'_>) -> PyResult<View<'a, Self>> {
                let Array::$kind(numbers) = array else {
                    let (given, needed) = (array.name(), Self::NAME);
                    return Err(PyTypeError::new_err(format!(
                        "a call needs arrays of one type, got {given} beside {needed}"
                    )));
                };
                Ok((numbers.shape(), Cow::Borrowed(numbers.as_slice()?)))
            }

            fn to_array(py: Python<'_>, tensor: Tensor<Self>) -> PyResult<Bound<'_, PyAny>> {
                Ok(to_array(py, tensor)?.into_any())
            }

            fn pull_back(recording: Recording<Self>) -> Kind {
                Kind::$kind(Mutex::new(recording))
            }
        }
    };
}

number!(f32, "float32", Single);
number!(f64, "float64", Double);

impl Number for DualNumber {
    const NAME: &'static str = "numbers with tangents";
    const TYPE: NumberType = NumberType::Dual;

    tapes!(DualNumber);

    fn view<'a>(array: &'a Array<'_>) -> PyResult<View<'a, Self>> {
        let (shape, numbers) = match array {
            Array::Single(numbers) => {
                let plain = |&value: &f32| Self::new(f64::from(value), 0.0);
                (numbers.shape(), numbers.as_slice()?.iter().map(plain).collect())
            }
            Array::Double(numbers) => {
                let plain = |&value: &f64| Self::new(value, 0.0);
                (numbers.shape(), numbers.as_slice()?.iter().map(plain).collect())
            }
            Array::Dual([values, tangents]) => {
                let pairs = values.as_slice()?.iter().zip(tangents.as_slice()?);
                let pair = |(&value, &tangent): (&f64, &f64)| Self::new(value, tangent);
                (values.shape(), pairs.map(pair).collect::<Vec<_>>())
            }
        };
        Ok((shape, Cow::Owned(numbers)))
    }

    fn to_array(py: Python<'_>, tensor: Tensor<Self>) -> PyResult<Bound<'_, PyAny>> {
        static CLASS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let find = || Ok::<_, PyErr>(py.import("bokashi._dual")?.getattr("Dual")?.unbind());
        let class = CLASS.get_or_try_init(py, find)?.bind(py);
        class.call1((to_array(py, tensor.values())?, to_array(py, tensor.tangents())?))
    }

    fn pull_back(recording: Recording<Self>) -> Kind {
        Kind::Dual(Mutex::new(recording))
    }
}

/// A recording of a type of numbers.
pub enum Kind {
    /// Of `float32`.
    Single(Mutex<Recording<f32>>),
    /// Of `float64`.
    Double(Mutex<Recording<f64>>),
    /// Of `float64` with tangents.
    Dual(Mutex<Recording<DualNumber>>),
}

/// An array in the order of C. One that is not gets a copy that is.
pub enum Array<'py> {
    /// Of `float32`.
    Single(PyReadonlyArrayDyn<'py, f32>),
    /// Of `float64`.
    Double(PyReadonlyArrayDyn<'py, f64>),
    /// Values and tangents of one shape, of `float64`.
    Dual([PyReadonlyArrayDyn<'py, f64>; 2]),
}

/// What is not in the order of C would be read transposed, without a word.
fn in_order<'py>(array: &Bound<'py, PyUntypedArray>) -> PyResult<Bound<'py, PyAny>> {
    if array.is_c_contiguous() {
        return Ok(array.to_owned().into_any());
    }
    array.py().import("numpy")?.call_method1("ascontiguousarray", (array,))
}

/// The values and tangents of an object that has both, as `bokashi.Dual` does.
fn dual_of<'py>(object: &Bound<'py, PyAny>) -> PyResult<Option<Array<'py>>> {
    let [Some(value), Some(tangent)] =
        [object.getattr_opt("value")?, object.getattr_opt("tangent")?]
    else {
        return Ok(None);
    };
    let [Array::Double(value), Array::Double(tangent)] = [value.extract()?, tangent.extract()?]
    else {
        return Err(PyTypeError::new_err("values and tangents need to be of float64"));
    };
    if value.shape() != tangent.shape() {
        let message = format!(
            "a tangent needs the shape of its value, {:?}, got {:?}",
            value.shape(),
            tangent.shape()
        );
        return Err(PyValueError::new_err(message));
    }
    Ok(Some(Array::Dual([value, tangent])))
}

impl<'py> FromPyObject<'_, 'py> for Array<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let Ok(array) = object.cast::<PyUntypedArray>() else {
            if let Some(array) = dual_of(&object)? {
                return Ok(array);
            }
            let given = object.get_type().name()?;
            return Err(PyTypeError::new_err(format!(
                "bokashi needs numpy arrays of float32 or float64, got {given}"
            )));
        };
        let array = in_order(&array)?;
        if let Ok(numbers) = array.cast::<PyArrayDyn<f32>>() {
            return Ok(Self::Single(numbers.try_readonly()?));
        }
        if let Ok(numbers) = array.cast::<PyArrayDyn<f64>>() {
            return Ok(Self::Double(numbers.try_readonly()?));
        }
        let given = array.getattr("dtype")?;
        Err(PyTypeError::new_err(format!(
            "bokashi needs numpy arrays of float32 or float64, got {given}"
        )))
    }
}

/// The entries of an array and its shape.
pub type View<'a, T> = (&'a [usize], Cow<'a, [T]>);

impl Array<'_> {
    /// The entries and the shape of an array of type `T`.
    ///
    /// # Errors
    /// As [`Number::view`].
    pub fn view<T: Number>(&self) -> PyResult<View<'_, T>> {
        T::view(self)
    }

    /// The shape and the numbers, in double precision, of an array that stays as it is.
    ///
    /// # Errors
    /// `TypeError` for one with tangents: they would be lost.
    pub fn constant(&self) -> PyResult<(&[usize], Vec<f64>)> {
        match self {
            Self::Single(numbers) => {
                let wide = numbers.as_slice()?.iter().map(|&number| f64::from(number));
                Ok((numbers.shape(), wide.collect()))
            }
            Self::Double(numbers) => Ok((numbers.shape(), numbers.as_slice()?.to_vec())),
            Self::Dual(_) => {
                Err(PyTypeError::new_err("a constant has no gradient and no tangent, got one"))
            }
        }
    }

    /// The same as a tensor.
    ///
    /// # Errors
    /// As [`Self::constant`].
    pub fn constant_tensor(&self) -> PyResult<Tensor<f64>> {
        let (shape, numbers) = self.constant()?;
        Ok(Tensor::new(shape, numbers).map_err(Refusal::from)?)
    }

    /// The name of its numbers.
    fn name(&self) -> &'static str {
        match self {
            Self::Single(_) => f32::NAME,
            Self::Double(_) => f64::NAME,
            Self::Dual(_) => DualNumber::NAME,
        }
    }
}

/// A type of numbers, by its name.
pub enum NumberType {
    /// `float32`.
    Single,
    /// `float64`.
    Double,
    /// `float64` with tangents.
    Dual,
}

/// The type that a step on `inputs` computes with: that of the first, or where any has tangents numbers with tangents.
pub fn number_type(inputs: &[Option<&Array<'_>>]) -> NumberType {
    let mut given = inputs.iter().flatten();
    if given.clone().any(|array| matches!(array, Array::Dual(_))) {
        return NumberType::Dual;
    }
    match given.next() {
        Some(Array::Single(_)) => NumberType::Single,
        _ => NumberType::Double,
    }
}

/// A tensor as an array of its own.
pub fn to_array<T: Scalar + Element>(
    py: Python<'_>,
    tensor: Tensor<T>,
) -> PyResult<Bound<'_, PyArrayDyn<T>>> {
    let shape: SmallVec<[usize; 4]> = tensor.shape().iter().copied().collect();
    PyArray1::from_vec(py, Vec::from(tensor)).reshape(&shape[..])
}

/// Runs `$body` with the type of numbers that a step on `$inputs` computes with, as `$number`.
macro_rules! by_type {
    ($inputs:expr, $number:ident => $body:expr) => {
        match $crate::array::number_type($inputs) {
            $crate::array::NumberType::Single => {
                type $number = f32;
                $body
            }
            $crate::array::NumberType::Double => {
                type $number = f64;
                $body
            }
            $crate::array::NumberType::Dual => {
                type $number = $crate::array::DualNumber;
                $body
            }
        }
    };
}

pub(crate) use by_type;
