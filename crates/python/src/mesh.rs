//! Meshes.

use bokashi_render_ops as ops;
use numpy::{PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::error::Refusal;

/// The faces of a triangle mesh.
#[pyclass(frozen, module = "bokashi")]
#[derive(Clone)]
pub struct Mesh(pub ops::Mesh);

/// Vertex indices of any type that people have.
#[derive(FromPyObject)]
enum Indices<'py> {
    U32(PyReadonlyArray2<'py, u32>),
    I32(PyReadonlyArray2<'py, i32>),
    I64(PyReadonlyArray2<'py, i64>),
}

/// The faces of an array `[F, 3]`, read in any order of its memory.
fn faces_of<I: numpy::Element + Copy + TryInto<u32> + std::fmt::Display>(
    indices: &PyReadonlyArray2<'_, I>,
) -> PyResult<Vec<[u32; 3]>> {
    let [count, 3] = *indices.shape() else {
        return Err(PyValueError::new_err(format!(
            "faces need shape [F, 3], got {:?}",
            indices.shape()
        )));
    };
    let entries = indices.as_array();
    (0..count)
        .map(|face| {
            let mut indices = [0; 3];
            for (corner, index) in indices.iter_mut().enumerate() {
                let given = entries[[face, corner]];
                *index = given.try_into().map_err(|_| {
                    PyValueError::new_err(format!(
                        "a face needs vertex indices from 0 on below 2^31, got {given} in face {face}"
                    ))
                })?;
            }
            Ok(indices)
        })
        .collect()
}

#[pymethods]
impl Mesh {
    #[new]
    fn new(faces: Bound<'_, PyAny>, vertex_count: usize) -> PyResult<Self> {
        let Ok(indices) = faces.extract::<Indices<'_>>() else {
            let given = faces.getattr("dtype").unwrap_or(faces.get_type().into_any());
            return Err(PyTypeError::new_err(format!(
                "faces need to be a numpy array [F, 3] of uint32, int32 or int64, got {given}"
            )));
        };
        let faces = match indices {
            Indices::U32(indices) => faces_of(&indices),
            Indices::I32(indices) => faces_of(&indices),
            Indices::I64(indices) => faces_of(&indices),
        };
        Ok(Self(ops::Mesh::new(faces?, vertex_count).map_err(Refusal::from)?))
    }

    /// The vertex indices of each face, `[F, 3]`, `uint32`.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let faces = self.0.faces();
        numpy::PyArray1::from_slice(py, faces.as_flattened()).reshape([faces.len(), 3])
    }

    /// The number of vertices.
    #[getter]
    fn vertex_count(&self) -> usize {
        self.0.vertex_count()
    }

    /// The faces from `start` to before `end`, over the same vertices.
    fn part(&self, start: usize, end: usize) -> PyResult<Self> {
        Ok(Self(self.0.part(start..end).map_err(Refusal::from)?))
    }

    fn __len__(&self) -> usize {
        self.0.faces().len()
    }

    fn __repr__(&self) -> String {
        format!("Mesh({} faces, {} vertices)", self.0.faces().len(), self.0.vertex_count())
    }
}
