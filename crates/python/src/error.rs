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

create_exception!(
    bokashi,
    SceneError,
    PyValueError,
    "What is wrong with a file or a fit. The message says where, the rule, and then the value that broke it."
);

/// A refusal on its way to Python.
pub struct Refusal(PyErr);

impl From<bokashi_render_ops::RenderError> for Refusal {
    fn from(error: bokashi_render_ops::RenderError) -> Self {
        Self(RenderError::new_err(error.to_string()))
    }
}

impl From<bokashi_mesh::MeshError> for Refusal {
    fn from(error: bokashi_mesh::MeshError) -> Self {
        Self(RenderError::new_err(error.to_string()))
    }
}

impl From<bokashi_scene::SceneError> for Refusal {
    fn from(error: bokashi_scene::SceneError) -> Self {
        Self(SceneError::new_err(error.to_string()))
    }
}

impl From<bokashi_fit::FitError> for Refusal {
    fn from(error: bokashi_fit::FitError) -> Self {
        Self(SceneError::new_err(error.to_string()))
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
