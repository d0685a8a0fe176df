//! A step on a tape, beside the interpreter.

use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

use bokashi_core::parallel::with_threads;
use bokashi_core::{OutputVars, Recording, Tape, Tensor, Var};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use smallvec::SmallVec;

use crate::array::{Array, Number, View};
use crate::error::Refusal;
use crate::pull_back::PullBack;

/// The inputs of a step: a variable each, or none where an array was left out.
pub type Given<'t, T> = SmallVec<[Option<Var<'t, T>>; 8]>;

/// The threads that were asked for; 0 for as many as there are.
static THREADS: AtomicUsize = AtomicUsize::new(0);

/// Lets every operation run on `count` threads from now on, or on as many as there are. The bits of results do not
/// depend on it.
#[pyfunction]
#[pyo3(signature = (count=None))]
pub fn set_num_threads(count: Option<usize>) {
    THREADS.store(count.unwrap_or(0), Ordering::Relaxed);
}

/// The number of threads that operations run on.
#[pyfunction]
pub fn num_threads() -> usize {
    match THREADS.load(Ordering::Relaxed) {
        0 => bokashi_core::parallel::threads(),
        count => count,
    }
}

/// Runs `work` with the interpreter's lock released, on the threads that were asked for.
pub fn released<R: Send>(py: Python<'_>, work: impl FnOnce() -> R + Send) -> R {
    py.detach(|| match THREADS.load(Ordering::Relaxed) {
        0 => work(),
        count => with_threads(count, work),
    })
}

/// Records a step on arrays of type `T` and returns its outputs as arrays, and the pull-back.
///
/// # Errors
/// What `record` refuses; `TypeError` for an array of another type.
pub fn record<'py, T: Number>(
    py: Python<'py>,
    inputs: &[Option<&Array<'py>>],
    record: impl for<'t> FnOnce(&'t Tape<T>, &Given<'t, T>) -> Result<OutputVars<'t, T>, Refusal> + Send,
) -> PyResult<(Bound<'py, PyTuple>, PullBack)> {
    let views: SmallVec<[Option<View<'_, T>>; 8]> =
        inputs.iter().map(|array| array.map(Array::view).transpose()).collect::<PyResult<_>>()?;
    let recorded = released(py, || {
        let tape =
            T::tapes().lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        let recording = Recording::new(tape, |tape| {
            let given: Given<'_, T> = views
                .iter()
                .map(|view| view.map(|(shape, entries)| tape.leaf_of(shape, entries)).transpose())
                .collect::<Result<_, _>>()?;
            let outputs = record(tape, &given)?;
            Ok::<_, Refusal>([given.into_iter().flatten().collect(), outputs])
        })?;
        let values: SmallVec<[_; 4]> =
            (0..recording.output_count()).map(|k| recording.value(k)).collect();
        Ok::<_, Refusal>((recording, values))
    });
    let (recording, values) = recorded?;
    let arrays =
        values.into_iter().map(|value| to_array(py, value)).collect::<PyResult<Vec<_>>>()?;
    let is_given = inputs.iter().map(Option::is_some).collect();
    Ok((PyTuple::new(py, arrays)?, PullBack::new(T::pull_back(recording), is_given)))
}

/// A tensor as an array of its own.
pub fn to_array<T: Number>(
    py: Python<'_>,
    tensor: Tensor<T>,
) -> PyResult<Bound<'_, PyArrayDyn<T>>> {
    let shape: SmallVec<[usize; 4]> = tensor.shape().iter().copied().collect();
    PyArray1::from_vec(py, Vec::from(tensor)).reshape(&shape[..])
}
