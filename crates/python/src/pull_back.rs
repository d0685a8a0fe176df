//! From the gradients of a step's outputs to those of its inputs.

use std::borrow::Cow;
use std::sync::{Mutex, PoisonError};

use bokashi_core::{InputGradients, Recording, Tensor};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use smallvec::SmallVec;

use crate::array::{Array, Kind, Number};
use crate::error::Refusal;
use crate::threads::released;

/// The gradient of an output: an array, or a number where the output is one.
enum Upstream<'py> {
    Array(Array<'py>),
    Number(f64),
}

impl<'py> FromPyObject<'_, 'py> for Upstream<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        match object.extract() {
            Ok(array) => Ok(Self::Array(array)),
            Err(error) => object.extract().map(Self::Number).map_err(|_| error),
        }
    }
}

impl Upstream<'_> {
    /// The shape and the numbers.
    fn view<T: Number>(&self) -> PyResult<(&[usize], Cow<'_, [T]>)> {
        match self {
            Self::Array(array) => array.view(),
            Self::Number(number) => Ok((&[], vec![T::from_f64(*number)].into())),
        }
    }
}

/// A recorded step, to be pulled back. Called with a gradient, or `None`, for each output, it returns a gradient, or
/// `None`, for each array that the step was given. It can be called as often as one likes.
#[pyclass(frozen, module = "bokashi")]
pub struct PullBack {
    /// Nothing once the tape has been given back.
    kind: Option<Kind>,
    /// Whether each input was given.
    is_given: Vec<bool>,
}

impl PullBack {
    /// The pull-back of a recording, of whose inputs some were given.
    pub fn new(kind: Kind, is_given: Vec<bool>) -> Self {
        Self { kind: Some(kind), is_given }
    }

    fn pull<'py, T: Number>(
        &self,
        py: Python<'py>,
        recording: &Mutex<Recording<T>>,
        upstream: &[Option<Upstream<'py>>],
        wanted: Option<&[bool]>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let views = upstream
            .iter()
            .map(|given| given.as_ref().map(Upstream::view::<T>).transpose())
            .collect::<PyResult<SmallVec<[_; 4]>>>()?;
        let places: SmallVec<[usize; 8]> =
            (0..self.is_given.len()).filter(|&k| self.is_given[k]).collect();
        let is_wanted = |k: usize| wanted.is_none_or(|wanted| wanted[places[k]]);
        let pulled = released(py, || {
            let recording = recording.lock().unwrap_or_else(PoisonError::into_inner);
            let tensors = views
                .into_iter()
                .map(|view| {
                    view.map(|(shape, entries)| Tensor::new(shape, entries.into_owned()))
                        .transpose()
                })
                .collect::<Result<SmallVec<[_; 4]>, _>>()?;
            let upstream: SmallVec<[_; 4]> = tensors.iter().map(Option::as_ref).collect();
            Ok::<InputGradients<T>, Refusal>(recording.pull_back_to(&upstream, is_wanted)?)
        });
        let mut gradients = pulled?.into_iter();
        let all = self.is_given.iter().map(|&is_given| {
            let gradient = if is_given { gradients.next().flatten() } else { None };
            gradient.map(|gradient| T::to_array(py, gradient)).transpose()
        });
        PyTuple::new(py, all.collect::<PyResult<Vec<_>>>()?)
    }
}

#[pymethods]
impl PullBack {
    #[pyo3(signature = (*upstream, wanted=None))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        upstream: Vec<Option<Upstream<'py>>>,
        wanted: Option<Vec<bool>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        if let Some(wanted) = &wanted
            && wanted.len() != self.is_given.len()
        {
            let (inputs, given) = (self.is_given.len(), wanted.len());
            return Err(PyValueError::new_err(format!(
                "a pull-back needs to know of each of {inputs} inputs whether it is wanted, got {given}"
            )));
        }
        let wanted = wanted.as_deref();
        match self.kind.as_ref().expect("it is there until it is dropped") {
            Kind::Single(recording) => self.pull(py, recording, &upstream, wanted),
            Kind::Double(recording) => self.pull(py, recording, &upstream, wanted),
            Kind::Dual(recording) => self.pull(py, recording, &upstream, wanted),
        }
    }
}

/// Tapes that are kept, as many as a step of several operations needs.
const MOST_TAPES: usize = 32;

/// The tape is kept for a later step, unless enough of them wait.
fn give_back<T: Number>(recording: Mutex<Recording<T>>) {
    let tape = recording.into_inner().unwrap_or_else(PoisonError::into_inner).into_tape();
    let mut tapes = T::tapes().lock().unwrap_or_else(PoisonError::into_inner);
    if tapes.len() < MOST_TAPES {
        tapes.push(tape);
    }
}

impl Drop for PullBack {
    fn drop(&mut self) {
        match self.kind.take() {
            Some(Kind::Single(recording)) => give_back(recording),
            Some(Kind::Double(recording)) => give_back(recording),
            Some(Kind::Dual(recording)) => give_back(recording),
            None => {}
        }
    }
}
