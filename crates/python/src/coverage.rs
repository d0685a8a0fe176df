//! Which faces cover which pixels.

use std::sync::Arc;

use bokashi_render_ops::{self as ops, Cull, Size};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArrayDyn, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smallvec::SmallVec;

use crate::array::{Array, Number, by_type};
use crate::error::Refusal;
use crate::mesh::Mesh;

/// Which faces cover which pixels of an image.
#[pyclass(frozen, module = "bokashi")]
#[derive(Clone)]
pub struct Coverage(pub Arc<ops::Coverage>);

/// The side that is not drawn.
///
/// # Errors
/// `ValueError` for another word.
pub fn cull(word: &str) -> PyResult<Cull> {
    match word {
        "none" => Ok(Cull::None),
        "back" => Ok(Cull::Back),
        "front" => Ok(Cull::Front),
        _ => Err(PyValueError::new_err(format!(
            "cull needs to be none, back or front, got {word:?}"
        ))),
    }
}

/// Entries of a shape as an array.
fn to_array<'py, T: Number>(
    py: Python<'py>,
    shape: &[usize],
    entries: Vec<T>,
) -> PyResult<Bound<'py, PyAny>> {
    T::to_array(py, bokashi_core::Tensor::new(shape, entries).map_err(Refusal::from)?)
}

impl Coverage {
    /// The runs of fragments at pixel centres: those of pieces come last.
    fn runs_at_centers(&self) -> impl Iterator<Item = ops::PixelRun> + '_ {
        let centers = self.0.centers();
        self.0.runs().take_while(move |run| run.fragments.start < centers)
    }

    /// Rows `[N, ..]` of fragments at pixel centres on the pixels of an image of zeros. Rows of other than `columns`
    /// entries have zeros after them.
    fn scattered<'py, T: Number>(
        &self,
        py: Python<'py>,
        values: &Array<'py>,
        columns: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (shape, values) = values.view::<T>()?;
        let (&[count, ref rest @ ..], Size { height, width }) = (shape, self.0.size()) else {
            return Err(PyValueError::new_err("scatter needs rows of fragments, got a scalar"));
        };
        if count != self.0.count() {
            let expected = self.0.count();
            return Err(PyValueError::new_err(format!(
                "scatter needs {expected} rows, got {count}"
            )));
        }
        let own = rest.iter().product();
        let Some(columns) = columns else {
            let shape: SmallVec<[usize; 4]> =
                [height, width].into_iter().chain(rest.iter().copied()).collect();
            let mut image = vec![T::ZERO; height * width * own];
            self.0.scatter(&values, own, &mut image);
            return to_array(py, &shape, image);
        };
        check_columns("scatter", own, columns, own <= columns)?;
        let mut image = vec![T::ZERO; height * width * columns];
        for run in self.runs_at_centers() {
            let pixels = &mut image[columns * run.pixels.start..columns * run.pixels.end];
            let rows = &values[own * run.fragments.start..own * run.fragments.end];
            copy_columns(rows, own, pixels, columns);
        }
        to_array(py, &[height, width, columns], image)
    }

    /// Rows of fragments at pixel centres from an image: all of their entries, or the first `columns`.
    fn gathered<'py, T: Number>(
        &self,
        py: Python<'py>,
        image: &Array<'py>,
        columns: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (shape, image) = image.view::<T>()?;
        let Size { height, width } = self.0.size();
        let rest = match *shape {
            [h, w, ref rest @ ..] if [h, w] == [height, width] => rest,
            _ => {
                let message = format!(
                    "gather needs an image of shape [{height}, {width}, ..], got {shape:?}"
                );
                return Err(PyValueError::new_err(message));
            }
        };
        let all = rest.iter().product();
        let Some(columns) = columns else {
            let shape: SmallVec<[usize; 4]> =
                std::iter::once(self.0.count()).chain(rest.iter().copied()).collect();
            let mut values = vec![T::ZERO; self.0.count() * all];
            self.0.gather(&image, all, &mut values);
            return to_array(py, &shape, values);
        };
        check_columns("gather", all, columns, columns <= all)?;
        let mut values = vec![T::ZERO; self.0.count() * columns];
        for run in self.runs_at_centers() {
            let pixels = &image[all * run.pixels.start..all * run.pixels.end];
            let rows = &mut values[columns * run.fragments.start..columns * run.fragments.end];
            copy_columns(pixels, all, rows, columns);
        }
        to_array(py, &[self.0.count(), columns], values)
    }
}

/// Refuses `columns` unless they `fit` to rows of `own` entries.
fn check_columns(name: &str, own: usize, columns: usize, fit: bool) -> PyResult<()> {
    if fit && own > 0 && columns > 0 {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{name} has no {columns} columns of rows of {own} entries")))
}

/// Copies the first entries of rows of `from` entries to those of rows of `to` entries: as many as both have.
fn copy_columns<T: Copy>(rows: &[T], from: usize, others: &mut [T], to: usize) {
    // Two of four are u and v of a dense image: loops whose lengths are known.
    match (from, to) {
        (2, 4) => {
            let others = others.as_chunks_mut::<4>().0;
            for ([u, v, ..], &row) in others.iter_mut().zip(rows.as_chunks::<2>().0) {
                [*u, *v] = row;
            }
        }
        (4, 2) => {
            let others = others.as_chunks_mut::<2>().0;
            for (other, &[u, v, ..]) in others.iter_mut().zip(rows.as_chunks::<4>().0) {
                *other = [u, v];
            }
        }
        _ => {
            for (other, row) in others.chunks_exact_mut(to).zip(rows.chunks_exact(from)) {
                other.iter_mut().zip(row).for_each(|(other, &entry)| *other = entry);
            }
        }
    }
}

/// The columns of a dense image of fragments: u, v, depth and triangle id.
const COLUMNS: usize = 4;

impl Coverage {
    /// Per pixel u, v, z / w and the id of the face, or zeros.
    fn densely<'py, T: Number>(
        &self,
        py: Python<'py>,
        barycentrics: &Array<'py>,
        depths: &Array<'py>,
        first_face: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (uv, depths) = (barycentrics.view::<T>()?.1, depths.view::<T>()?.1);
        let count = self.0.count();
        if [uv.len(), depths.len()] != [2 * count, count] {
            return Err(PyValueError::new_err(format!(
                "dense needs {count} barycentrics and depths"
            )));
        }
        let Size { height, width } = self.0.size();
        let mut image = vec![T::ZERO; COLUMNS * height * width];
        for run in self.runs_at_centers() {
            let id = T::from_f64((first_face + run.face + 1) as f64);
            let pixels = image[COLUMNS * run.pixels.start..COLUMNS * run.pixels.end]
                .as_chunks_mut::<COLUMNS>()
                .0;
            let uv = uv[2 * run.fragments.start..2 * run.fragments.end].as_chunks::<2>().0;
            for ((pixel, &[u, v]), &depth) in pixels.iter_mut().zip(uv).zip(&depths[run.fragments])
            {
                *pixel = [u, v, depth, id];
            }
        }
        to_array(py, &[height, width, COLUMNS], image)
    }
}

#[pymethods]
impl Coverage {
    /// An image `[H, W, 4]` of u, v, z / w and the id of the face, its index plus 1 plus `first_face`. Zeros stand where
    /// nothing is seen. From barycentrics `[N, 2]` and depths `[N]`.
    #[pyo3(signature = (barycentrics, depths, first_face=0))]
    fn dense<'py>(
        &self,
        py: Python<'py>,
        barycentrics: Array<'py>,
        depths: Array<'py>,
        first_face: usize,
    ) -> PyResult<Bound<'py, PyAny>> {
        by_type!(&[Some(&barycentrics), Some(&depths)], T => self.densely::<T>(py, &barycentrics, &depths, first_face))
    }

    /// The coverage of an image `[H, W]` of triangle ids: the index of the face that a pixel sees plus 1, or 0. With clip
    /// positions `[V, 4]`, or with `orientations` of another coverage, it knows silhouettes.
    #[staticmethod]
    #[pyo3(signature = (mesh, ids, clip=None, cull="none", orientations=None))]
    fn from_ids(
        mesh: &Mesh,
        ids: PyReadonlyArrayDyn<'_, u32>,
        clip: Option<Array<'_>>,
        cull: &str,
        orientations: Option<PyReadonlyArray1<'_, i8>>,
    ) -> PyResult<Self> {
        let &[height, width] = ids.shape() else {
            return Err(PyValueError::new_err(format!(
                "ids need shape [H, W], got {:?}",
                ids.shape()
            )));
        };
        let cull = self::cull(cull)?;
        let read = ops::Coverage::from_ids(&mesh.0, Size { width, height }, ids.as_slice()?);
        let mut coverage = read.map_err(Refusal::from)?;
        if let Some(clip) = clip {
            coverage = by_type!(&[Some(&clip)], T => {
                let (shape, entries) = clip.view::<T>()?;
                let clip = bokashi_core::Tensor::new(shape, entries.to_vec()).map_err(Refusal::from)?;
                coverage.with_orientations(&clip, cull).map_err(Refusal::from)?
            });
        }
        if let Some(orientations) = orientations {
            let known = orientations.as_slice()?;
            coverage = coverage.with_known_orientations(known).map_err(Refusal::from)?;
        }
        Ok(Self(Arc::new(coverage)))
    }

    /// Which way each face turns as it is seen, `[F]`, `int8`: 1 for counter-clockwise, -1 for clockwise. It is 0 for
    /// neither, or for a side that is not drawn. `None` where nobody knows.
    #[getter]
    fn orientations<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<i8>>> {
        self.0.orientations().map(|known| PyArray1::from_slice(py, known))
    }

    /// It stays as it is: the same.
    fn __copy__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    /// It stays as it is: the same.
    fn __deepcopy__<'py>(slf: Bound<'py, Self>, _known: Bound<'py, PyAny>) -> Bound<'py, Self> {
        slf
    }

    /// The number of fragments.
    fn __len__(&self) -> usize {
        self.0.count()
    }

    /// The number of fragments at pixel centres, which come before the pieces of exact coverage.
    #[getter]
    fn centers(&self) -> usize {
        self.0.centers()
    }

    /// The image's height and width.
    #[getter]
    fn size(&self) -> (usize, usize) {
        let Size { width, height } = self.0.size();
        (height, width)
    }

    /// The mesh.
    #[getter]
    fn mesh(&self) -> Mesh {
        Mesh(self.0.mesh().clone())
    }

    /// The face of each fragment, `[N]`, `uint32`.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_iter(py, self.0.faces().map(|face| face as u32))
    }

    /// The pixel of each fragment, `[N]`, `uint32`: row times width plus column.
    #[getter]
    fn pixels<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_iter(py, self.0.pixels().map(|pixel| pixel as u32))
    }

    /// Per pixel the index of the face that it sees plus 1, or 0, `[H, W]`, `uint32`.
    fn triangle_ids<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let Size { width, height } = self.0.size();
        PyArray1::from_vec(py, self.0.triangle_ids()).reshape([height, width])
    }

    /// An image `[H, W, ..]` with the rows `[N, ..]` of fragments at pixel centres, and zeros. With `columns` an image
    /// `[H, W, columns]` whose last ones are zeros.
    #[pyo3(signature = (values, columns=None))]
    fn scatter<'py>(
        &self,
        py: Python<'py>,
        values: Array<'py>,
        columns: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        by_type!(&[Some(&values)], T => self.scattered::<T>(py, &values, columns))
    }

    /// The rows `[N, ..]` of fragments at pixel centres from an image `[H, W, ..]`; zeros for pieces. With `columns` the
    /// first ones `[N, columns]` alone.
    #[pyo3(signature = (image, columns=None))]
    fn gather<'py>(
        &self,
        py: Python<'py>,
        image: Array<'py>,
        columns: Option<usize>,
    ) -> PyResult<Bound<'py, PyAny>> {
        by_type!(&[Some(&image)], T => self.gathered::<T>(py, &image, columns))
    }

    fn __repr__(&self) -> String {
        format!("Coverage({} fragments in {} pixels)", self.0.count(), self.0.size())
    }
}
