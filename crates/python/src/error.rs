//! What is refused, as a Python exception with the same words.

use bokashi_core::TensorError;
use pyo3::exceptions::PyValueError;
use pyo3::{PyErr, create_exception};

create_exception!(
    bokashi,
    RenderError,
    PyValueError,
    "What an operation refuses. The message says the rule, then the value that broke it."
);

/// A refusal on its way to Python.
pub struct Refusal(PyErr);

impl From<bokashi_render_ops::RenderError> for Refusal {
    fn from(error: bokashi_render_ops::RenderError) -> Self {
        Self(RenderError::new_err(error.to_string()))
    }
}

impl From<TensorError> for Refusal {
    fn from(error: TensorError) -> Self {
        Self(RenderError::new_err(error.to_string()))
    }
}

impl From<PyErr> for Refusal {
    fn from(error: PyErr) -> Self {
        Self(error)
    }
}

impl From<Refusal> for PyErr {
    fn from(Refusal(error): Refusal) -> Self {
        error
    }
}
