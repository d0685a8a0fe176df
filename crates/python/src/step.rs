//! A step on a tape, beside the interpreter.

use std::sync::PoisonError;

use bokashi_core::{OutputVars, Recording, Tape, Var};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use smallvec::SmallVec;

use crate::array::{Array, Number, View};
use crate::error::Refusal;
use crate::pull_back::PullBack;
use crate::threads::released;

/// The inputs of a step: a variable each, or none where an array was left out.
pub type Given<'t, T> = SmallVec<[Option<Var<'t, T>>; 8]>;

/// The outputs of a step, and its pull-back.
pub type Recorded<'py> = PyResult<(Bound<'py, PyTuple>, PullBack)>;

/// What records the operations of a step.
type Operations<'a, T> =
    dyn for<'t> FnMut(&'t Tape<T>, &Given<'t, T>) -> Result<OutputVars<'t, T>, Refusal> + Send + 'a;

/// Records a step on arrays of type `T` and returns its outputs as arrays, and the pull-back.
///
/// # Errors
/// What `record` refuses; `TypeError` for an array of another type.
pub fn record<'py, T: Number>(
    py: Python<'py>,
    inputs: &[Option<&Array<'py>>],
    record: impl for<'t> FnOnce(&'t Tape<T>, &Given<'t, T>) -> Result<OutputVars<'t, T>, Refusal> + Send,
) -> PyResult<(Bound<'py, PyTuple>, PullBack)> {
    let mut record = Some(record);
    record_step(py, inputs, &mut |tape, given| {
        record.take().expect("a step is recorded once")(tape, given)
    })
}

/// The same for any operations: compiled once, and not for each of them.
fn record_step<'py, T: Number>(
    py: Python<'py>,
    inputs: &[Option<&Array<'py>>],
    record: &mut Operations<'_, T>,
) -> PyResult<(Bound<'py, PyTuple>, PullBack)> {
    let views: SmallVec<[Option<View<'_, T>>; 8]> = inputs
        .iter()
        .map(|array| array.map(Array::view::<T>).transpose())
        .collect::<PyResult<_>>()?;
    let recorded = released(py, || {
        let tape =
            T::tapes().lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        let recording = Recording::new(tape, |tape| {
            let given: Given<'_, T> = views
                .iter()
                .map(|view| {
                    view.as_ref().map(|(shape, entries)| tape.leaf_of(*shape, entries)).transpose()
                })
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
        values.into_iter().map(|value| T::to_array(py, value)).collect::<PyResult<Vec<_>>>()?;
    let is_given = inputs.iter().map(Option::is_some).collect();
    Ok((PyTuple::new(py, arrays)?, PullBack::new(T::pull_back(recording), is_given)))
}
