//! Losses of images, masks and depths, and regularizers.

use bokashi_core::Mask;
use bokashi_fit::{self as fit, DepthAlignment, Penalty, RigidWeights};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use smallvec::smallvec;

use crate::array::{Array, by_type};
use crate::error::Refusal;
use crate::mesh::Mesh;
use crate::step::{Recorded, record};
use crate::tensors::Sparse;

/// A penalty by its name, and its number, where it has one.
///
/// # Errors
/// `ValueError` for another name, and where the number is missing or too much.
fn penalty(word: &str, number: Option<f64>) -> PyResult<Penalty> {
    match (word, number) {
        ("squared", None) => Ok(Penalty::Squared),
        ("absolute", None) => Ok(Penalty::Absolute),
        ("huber", Some(delta)) => Ok(Penalty::Huber { delta }),
        ("charbonnier", Some(scale)) => Ok(Penalty::Charbonnier { scale }),
        ("relative", Some(epsilon)) => Ok(Penalty::Relative { epsilon }),
        ("squared" | "absolute", Some(number)) => {
            Err(PyValueError::new_err(format!("penalty {word} has no scale, got {number}")))
        }
        ("huber" | "charbonnier" | "relative", None) => {
            Err(PyValueError::new_err(format!("penalty {word} needs a scale, got None")))
        }
        _ => Err(PyValueError::new_err(format!(
            "penalty needs to be squared, absolute, huber, charbonnier or relative, got {word:?}"
        ))),
    }
}

/// # Errors
/// `TypeError` for another array than one of bools.
fn mask_of(mask: &Bound<'_, PyAny>) -> PyResult<Mask> {
    let Ok(array) = mask.extract::<PyReadonlyArrayDyn<'_, bool>>() else {
        let given = mask.getattr("dtype").unwrap_or(mask.get_type().into_any());
        return Err(PyTypeError::new_err(format!(
            "a mask needs to be a numpy array of bool, got {given}"
        )));
    };
    let truth: Vec<bool> = array.as_array().iter().copied().collect();
    Ok(Mask::new(array.shape(), truth).map_err(Refusal::from)?)
}

/// Inputs: image, reference, weights.
#[pyfunction]
#[pyo3(signature = (image, reference, weights=None, penalty="squared", scale=None, mask=None))]
pub fn mean_error<'py>(
    py: Python<'py>,
    image: Array<'py>,
    reference: Array<'py>,
    weights: Option<Array<'py>>,
    penalty: &str,
    scale: Option<f64>,
    mask: Option<Bound<'py, PyAny>>,
) -> Recorded<'py> {
    let penalty = self::penalty(penalty, scale)?;
    let mask = mask.as_ref().map(mask_of).transpose()?;
    if mask.is_some() && weights.is_some() {
        return Err(PyValueError::new_err("a mean has weights or a mask, got both"));
    }
    let inputs = [Some(&image), Some(&reference), weights.as_ref()];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(image), Some(reference), weights] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![match (&mask, weights) {
            (Some(mask), _) => fit::masked_error(image, reference, mask, penalty)?,
            (None, Some(weights)) => fit::weighted_error(image, reference, weights, penalty)?,
            (None, None) => fit::mean_error(image, reference, penalty)?,
        }])
    }))
}

#[pyfunction]
#[pyo3(signature = (image, reference, peak=1.0))]
pub fn ssim_error<'py>(
    py: Python<'py>,
    image: Array<'py>,
    reference: Array<'py>,
    peak: f64,
) -> Recorded<'py> {
    let inputs = [Some(&image), Some(&reference)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(image), Some(reference)] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![fit::ssim_error(image, reference, peak)?])
    }))
}

#[pyfunction]
#[pyo3(signature = (image, reference, peak=1.0, levels=None))]
pub fn multiscale_ssim_error<'py>(
    py: Python<'py>,
    image: Array<'py>,
    reference: Array<'py>,
    peak: f64,
    levels: Option<usize>,
) -> Recorded<'py> {
    let inputs = [Some(&image), Some(&reference)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(image), Some(reference)] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![fit::multiscale_ssim_error(image, reference, peak, levels)?])
    }))
}

#[pyfunction]
pub fn silhouette_error<'py>(
    py: Python<'py>,
    mask: Array<'py>,
    reference: Array<'py>,
) -> Recorded<'py> {
    let inputs = [Some(&mask), Some(&reference)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(mask), Some(reference)] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![fit::silhouette_error(mask, reference)?])
    }))
}

#[pyfunction]
#[pyo3(signature = (depths, reference, mask=None, alignment="none"))]
pub fn depth_error<'py>(
    py: Python<'py>,
    depths: Array<'py>,
    reference: Array<'py>,
    mask: Option<Bound<'py, PyAny>>,
    alignment: &str,
) -> Recorded<'py> {
    let alignment = match alignment {
        "none" => DepthAlignment::None,
        "scale" => DepthAlignment::Scale,
        "scale-and-shift" => DepthAlignment::ScaleAndShift,
        _ => {
            return Err(PyValueError::new_err(format!(
                "alignment needs to be none, scale or scale-and-shift, got {alignment:?}"
            )));
        }
    };
    let mask = mask.as_ref().map(mask_of).transpose()?;
    let inputs = [Some(&depths), Some(&reference)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(depths), Some(reference)] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![fit::depth_error(depths, reference, mask.as_ref(), alignment)?])
    }))
}

#[pyfunction]
pub fn halved<'py>(py: Python<'py>, image: Array<'py>) -> Recorded<'py> {
    let inputs = [Some(&image)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        Ok(smallvec![fit::halved(x[0].expect("it is required"))?])
    }))
}

#[pyfunction]
#[pyo3(signature = (image, penalty="squared", scale=None))]
pub fn total_variation<'py>(
    py: Python<'py>,
    image: Array<'py>,
    penalty: &str,
    scale: Option<f64>,
) -> Recorded<'py> {
    let penalty = self::penalty(penalty, scale)?;
    let inputs = [Some(&image)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        Ok(smallvec![fit::total_variation(x[0].expect("it is required"), penalty)?])
    }))
}

/// The edges of a mesh: which vertices are neighbours, and which faces.
#[pyclass(frozen, module = "bokashi")]
pub struct Topology(pub fit::Topology);

#[pymethods]
impl Topology {
    #[new]
    fn new(mesh: &Mesh) -> PyResult<Self> {
        let made = fit::Topology::new(mesh.0.faces(), mesh.0.vertex_count());
        Ok(Self(made.map_err(Refusal::from)?))
    }

    /// The vertices of each edge, `[E, 2]`, `uint32`: the lower first, sorted.
    #[getter]
    fn edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let edges = self.0.edges();
        PyArray1::from_slice(py, edges.as_flattened()).reshape([edges.len(), 2])
    }

    /// The number of vertices.
    #[getter]
    fn vertex_count(&self) -> usize {
        self.0.vertex_count()
    }

    /// `(L v)_i` is how far vertex i is from the mean of its neighbours: `[V, V]`.
    fn uniform_laplacian(&self) -> Sparse {
        Sparse::from_matrix(self.0.uniform_laplacian())
    }

    /// The Laplacian with the cotangents of `positions` `[V, 3]`, which stay as they are: `[V, V]`.
    fn cotangent_laplacian(&self, positions: Array<'_>) -> PyResult<Sparse> {
        let matrix = self.0.cotangent_laplacian(&positions.constant_tensor()?);
        Ok(Sparse::from_matrix(matrix.map_err(Refusal::from)?))
    }

    fn __repr__(&self) -> String {
        format!("Topology({} edges, {} vertices)", self.0.edges().len(), self.0.vertex_count())
    }
}

/// A mesh at rest, whose edges want to keep their lengths and the angles between them.
#[pyclass(frozen, module = "bokashi")]
pub struct Rigidity(fit::Rigidity);

#[pymethods]
impl Rigidity {
    #[new]
    #[pyo3(signature = (topology, rest, weights="cotangent"))]
    fn new(topology: &Topology, rest: Array<'_>, weights: &str) -> PyResult<Self> {
        let weights = match weights {
            "cotangent" => RigidWeights::Cotangent,
            "uniform" => RigidWeights::Uniform,
            _ => {
                return Err(PyValueError::new_err(format!(
                    "weights need to be cotangent or uniform, got {weights:?}"
                )));
            }
        };
        let made = fit::Rigidity::new(&topology.0, &rest.constant_tensor()?, weights);
        Ok(Self(made.map_err(Refusal::from)?))
    }
}

/// Regularizers of positions, beside a constant.
macro_rules! regularizers {
    ($($name:ident($constant:ident: &$type:ty $(, $number:ident: f64)?) => $call:expr;)+) => {$(
        #[pyfunction]
        pub fn $name<'py>(
            py: Python<'py>,
            positions: Array<'py>,
            $constant: &$type,
            $($number: f64,)?
        ) -> Recorded<'py> {
            let inputs = [Some(&positions)];
            by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
                let positions = x[0].expect("they are required");
                Ok(smallvec![$call(positions, $constant $(, $number)?)?])
            }))
        }
    )+};
}

regularizers! {
    laplacian_error(laplacian: &Sparse) => |x, matrix: &Sparse| fit::laplacian_error(x, &matrix.cast());
    edge_length_error(topology: &Topology, target: f64) =>
        |x, topology: &Topology, target| fit::edge_length_error(x, &topology.0, target);
    normal_error(topology: &Topology) => |x, topology: &Topology| fit::normal_error(x, &topology.0);
    rigid_error(rigidity: &Rigidity) => |x, rigidity: &Rigidity| rigidity.0.error(x);
}
