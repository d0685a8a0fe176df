//! Arrays of numpy, of `float32` or `float64`.

use std::sync::Mutex;

use bokashi_core::{Recording, Scalar, Tape, Tensor};
use numpy::{
    Element, PyArray1, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use smallvec::SmallVec;

/// A type of numbers that numpy and the tape share.
pub trait Number: Scalar + Element + Send + Sync {
    /// Its name in numpy.
    const NAME: &'static str;

    /// Tapes of steps that Python has let go of, to be used again.
    fn tapes() -> &'static Mutex<Vec<Tape<Self>>>;

    /// The numbers of an array of this type.
    fn numbers<'a, 'py>(array: &'a Array<'py>) -> Option<&'a PyReadonlyArrayDyn<'py, Self>>;

    /// The recording of this type.
    fn pull_back(recording: Recording<Self>) -> Kind;
}

macro_rules! number {
    ($number:ident, $name:literal, $kind:ident) => {
        impl Number for $number {
            const NAME: &'static str = $name;

            fn tapes() -> &'static Mutex<Vec<Tape<Self>>> {
                static TAPES: Mutex<Vec<Tape<$number>>> = Mutex::new(Vec::new());
                &TAPES
            }

            fn numbers<'a, 'py>(
                array: &'a Array<'py>,
            ) -> Option<&'a PyReadonlyArrayDyn<'py, Self>> {
                match array {
                    Array::$kind(numbers) => Some(numbers),
                    _ => None,
                }
            }

            fn pull_back(recording: Recording<Self>) -> Kind {
                Kind::$kind(Mutex::new(recording))
            }
        }
    };
}

number!(f32, "float32", Single);
number!(f64, "float64", Double);

/// A recording of either type of numbers.
pub enum Kind {
    /// Of `float32`.
    Single(Mutex<Recording<f32>>),
    /// Of `float64`.
    Double(Mutex<Recording<f64>>),
}

/// An array in the order of C. One that is not gets a copy that is.
pub enum Array<'py> {
    /// Of `float32`.
    Single(PyReadonlyArrayDyn<'py, f32>),
    /// Of `float64`.
    Double(PyReadonlyArrayDyn<'py, f64>),
}

impl<'py> FromPyObject<'_, 'py> for Array<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let Ok(array) = object.cast::<PyUntypedArray>() else {
            let given = object.get_type().name()?;
            return Err(PyTypeError::new_err(format!(
                "bokashi needs numpy arrays of float32 or float64, got {given}"
            )));
        };
        // What is not in the order of C would be read transposed, without a word.
        let array = if array.is_c_contiguous() {
            array.to_owned().into_any()
        } else {
            object.py().import("numpy")?.call_method1("ascontiguousarray", (array,))?
        };
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
pub type View<'a, T> = (&'a [usize], &'a [T]);

impl<'py> Array<'py> {
    /// The entries and the shape of an array of type `T`.
    ///
    /// # Errors
    /// `TypeError` for an array of another type.
    pub fn view<T: Number>(&self) -> PyResult<View<'_, T>> {
        let Some(numbers) = T::numbers(self) else {
            let (given, needed) = (self.name(), T::NAME);
            return Err(PyTypeError::new_err(format!(
                "a call needs arrays of one type, got {given} beside {needed}"
            )));
        };
        Ok((numbers.shape(), numbers.as_slice()?))
    }

    fn name(&self) -> &'static str {
        match self {
            Self::Single(_) => f32::NAME,
            Self::Double(_) => f64::NAME,
        }
    }
}

/// A tensor as an array of its own.
pub fn to_array<T: Number>(
    py: Python<'_>,
    tensor: Tensor<T>,
) -> PyResult<Bound<'_, PyArrayDyn<T>>> {
    let shape: SmallVec<[usize; 4]> = tensor.shape().iter().copied().collect();
    PyArray1::from_vec(py, Vec::from(tensor)).reshape(&shape[..])
}

/// Runs `$body` with the type of numbers that `$array` has, as `$number`.
macro_rules! by_type {
    ($array:expr, $number:ident => $body:expr) => {
        match &$array {
            $crate::array::Array::Single(_) => {
                type $number = f32;
                $body
            }
            $crate::array::Array::Double(_) => {
                type $number = f64;
                $body
            }
        }
    };
}

pub(crate) use by_type;
