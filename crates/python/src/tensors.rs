//! Operations on tensors: those of rows and of lists of rows, and functions with a careful form.

use std::sync::Arc;

use bokashi_core::{self as core, SparseMatrix};
use numpy::{Element, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use smallvec::smallvec;

use crate::array::{Array, Number, by_type};
use crate::casts::Casts;
use crate::error::Refusal;
use crate::step::{Recorded, record};

/// Operations on one array.
macro_rules! unary {
    ($($name:ident => $call:expr;)+) => {$(
        #[pyfunction]
        pub fn $name<'py>(py: Python<'py>, x: Array<'py>) -> Recorded<'py> {
            let inputs = [Some(&x)];
            by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
                let call: for<'t> fn(core::Var<'t, T>) -> Result<core::Var<'t, T>, core::TensorError> = $call;
                Ok(smallvec![call(x[0].expect("it is required"))?])
            }))
        }
    )+};
}

unary! {
    norm => |x| x.norm();
    normalize => |x| x.normalize();
    sigmoid => |x| Ok(x.sigmoid());
    softplus => |x| Ok(x.softplus());
}

/// Operations on two arrays.
macro_rules! binary {
    ($($name:ident($a:ident, $b:ident) => $call:expr;)+) => {$(
        #[pyfunction]
        pub fn $name<'py>(py: Python<'py>, $a: Array<'py>, $b: Array<'py>) -> Recorded<'py> {
            let inputs = [Some(&$a), Some(&$b)];
            by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
                let [Some(a), Some(b)] = x[..] else { unreachable!("they are required") };
                let call: for<'t> fn(core::Var<'t, T>, core::Var<'t, T>) -> Result<core::Var<'t, T>, core::TensorError> = $call;
                Ok(smallvec![call(a, b)?])
            }))
        }
    )+};
}

binary! {
    dot(a, b) => |a, b| a.dot(b);
    cross(a, b) => |a, b| a.cross(b);
    matmul(a, b) => |a, b| a.matmul(b);
    squared_error(image, reference) => |image, reference| core::squared_error(image, reference);
}

/// Row numbers of any type that people have.
#[derive(FromPyObject)]
enum Indices<'py> {
    U32(PyReadonlyArray1<'py, u32>),
    I32(PyReadonlyArray1<'py, i32>),
    I64(PyReadonlyArray1<'py, i64>),
}

/// Whole numbers from 0 on, in any order of their memory.
fn numbers_of<I: Element + Copy + TryInto<u32> + std::fmt::Display>(
    numbers: &PyReadonlyArray1<'_, I>,
) -> PyResult<Vec<u32>> {
    let number = |&given: &I| {
        given.try_into().map_err(|_| {
            PyValueError::new_err(format!("a row needs a number from 0 on below 2^32, got {given}"))
        })
    };
    numbers.as_array().iter().map(number).collect()
}

/// # Errors
/// `TypeError` unless `rows` is an array `[R]` of whole numbers; `ValueError` for a negative one.
fn row_numbers(rows: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
    let Ok(indices) = rows.extract::<Indices<'_>>() else {
        let given = rows.getattr("dtype").unwrap_or(rows.get_type().into_any());
        return Err(PyTypeError::new_err(format!(
            "rows need to be a numpy array [R] of uint32, int32 or int64, got {given}"
        )));
    };
    match indices {
        Indices::U32(rows) => numbers_of(&rows),
        Indices::I32(rows) => numbers_of(&rows),
        Indices::I64(rows) => numbers_of(&rows),
    }
}

#[pyfunction]
pub fn gather_rows<'py>(py: Python<'py>, x: Array<'py>, rows: Bound<'py, PyAny>) -> Recorded<'py> {
    let rows: Arc<[u32]> = row_numbers(&rows)?.into();
    let inputs = [Some(&x)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        Ok(smallvec![x[0].expect("it is required").gather_rows(&rows)?])
    }))
}

#[pyfunction]
pub fn scatter_add_rows<'py>(
    py: Python<'py>,
    x: Array<'py>,
    rows: Bound<'py, PyAny>,
    count: usize,
) -> Recorded<'py> {
    let rows: Arc<[u32]> = row_numbers(&rows)?.into();
    let inputs = [Some(&x)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        Ok(smallvec![x[0].expect("it is required").scatter_add_rows(&rows, count)?])
    }))
}

/// A matrix most of whose entries are 0, a constant. Made of the row, the column and the value of each entry; values of
/// one place are added.
#[pyclass(frozen, module = "bokashi", name = "SparseMatrix")]
pub struct Sparse(Casts<SparseMatrix<f64>>);

impl Sparse {
    /// Of a matrix in double precision.
    pub fn from_matrix(matrix: SparseMatrix<f64>) -> Self {
        Self(Casts::new(matrix))
    }

    /// The matrix of a type of numbers.
    pub fn cast<T: Number>(&self) -> SparseMatrix<T> {
        self.0.get(SparseMatrix::cast)
    }
}

#[pymethods]
impl Sparse {
    #[new]
    fn new(
        shape: (usize, usize),
        rows: Bound<'_, PyAny>,
        columns: Bound<'_, PyAny>,
        values: Array<'_>,
    ) -> PyResult<Self> {
        let (rows, columns) = (row_numbers(&rows)?, row_numbers(&columns)?);
        let (given, values) = values.constant()?;
        if given != [rows.len()] || columns.len() != rows.len() {
            return Err(PyValueError::new_err(format!(
                "a sparse matrix needs a row, a column and a value for each entry, got {} rows, {} columns and values \
                 of shape {given:?}",
                rows.len(),
                columns.len()
            )));
        }
        let entries = rows.into_iter().zip(columns).zip(values);
        let triplets = entries.map(|((row, column), number)| (row, column, number));
        let matrix = SparseMatrix::new(shape.0, shape.1, triplets).map_err(Refusal::from)?;
        Ok(Self::from_matrix(matrix))
    }

    /// The numbers of rows and columns.
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.0.original().rows(), self.0.original().columns())
    }

    /// The rows, columns and values of all entries, `[E]` each, by row and then by column.
    #[getter]
    #[expect(clippy::type_complexity, reason = "three arrays")]
    fn entries<'py>(
        &self,
        py: Python<'py>,
    ) -> (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<f64>>) {
        let triplets = || self.0.original().triplets();
        (
            PyArray1::from_iter(py, triplets().map(|(row, ..)| row)),
            PyArray1::from_iter(py, triplets().map(|(_, column, _)| column)),
            PyArray1::from_iter(py, triplets().map(|(.., value)| value)),
        )
    }

    fn __repr__(&self) -> String {
        let (rows, columns) = self.shape();
        format!("SparseMatrix({rows} x {columns}, {} entries)", self.0.original().entries())
    }
}

#[pyfunction]
pub fn sparse_product<'py>(py: Python<'py>, x: Array<'py>, matrix: &Sparse) -> Recorded<'py> {
    let inputs = [Some(&x)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        Ok(smallvec![matrix.cast::<T>().product(x[0].expect("it is required"))?])
    }))
}
