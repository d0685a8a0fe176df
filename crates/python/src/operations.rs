//! Operations on arrays alone.

use bokashi_render_ops::{self as ops, Blur, Border, Filter, Kernel, Pose, Radius, Weighting};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smallvec::smallvec;

use crate::array::{Array, by_type};
use crate::error::Refusal;
use crate::mesh::Mesh;
use crate::step::{Recorded, record};

/// What lies beyond an image.
fn border(word: &str) -> PyResult<Border> {
    match word {
        "mirror" => Ok(Border::Mirror),
        "clamp" => Ok(Border::Clamp),
        "zero" => Ok(Border::Zero),
        _ => Err(PyValueError::new_err(format!(
            "border needs to be mirror, clamp or zero, got {word:?}"
        ))),
    }
}

#[pyfunction]
#[pyo3(signature = (positions, camera, rotation=None, translation=None))]
pub fn project<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    camera: Array<'py>,
    rotation: Option<Array<'py>>,
    translation: Option<Array<'py>>,
) -> Recorded<'py> {
    let inputs = [Some(&positions), Some(&camera), rotation.as_ref(), translation.as_ref()];
    by_type!(&inputs, T => record::<T>(py, &inputs, |tape, x| {
        let zero = || bokashi_core::Tensor::zeros([3]);
        let unit = || bokashi_core::Tensor::from([0.0, 0.0, 0.0, 1.0]).cast::<T>();
        let pose = (x[2].is_some() || x[3].is_some()).then(|| Pose {
            rotation: x[2].unwrap_or_else(|| tape.constant(&unit())),
            translation: x[3].unwrap_or_else(|| tape.constant(&zero())),
        });
        let [Some(positions), Some(camera), ..] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![ops::project(positions, camera, pose)?])
    }))
}

#[pyfunction]
#[pyo3(signature = (image, sigma, kernel="sampled", border="mirror", tolerance=1e-6, radius=None))]
pub fn gaussian_blur<'py>(
    py: Python<'py>,
    image: Array<'py>,
    sigma: Array<'py>,
    kernel: &str,
    border: &str,
    tolerance: f64,
    radius: Option<usize>,
) -> Recorded<'py> {
    let kernel: Kernel = kernel.parse().map_err(Refusal::from)?;
    let radius = radius.map_or(Radius::Tolerance(tolerance), Radius::Fixed);
    let blur = Blur { kernel, border: self::border(border)?, radius };
    let inputs = [Some(&image), Some(&sigma)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(image), Some(sigma)] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![ops::gaussian_blur(image, sigma, &blur)?])
    }))
}

#[pyfunction]
pub fn downsample<'py>(py: Python<'py>, image: Array<'py>, factor: usize) -> Recorded<'py> {
    let inputs = [Some(&image)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(image)] = x[..] else { unreachable!("it is required") };
        Ok(smallvec![ops::downsample(image, factor, &Filter::Box, Border::Mirror)?])
    }))
}

#[pyfunction]
pub fn face_normals<'py>(py: Python<'py>, positions: Array<'py>, mesh: &Mesh) -> Recorded<'py> {
    let inputs = [Some(&positions)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(positions)] = x[..] else { unreachable!("it is required") };
        Ok(smallvec![ops::face_normals(positions, &mesh.0)?])
    }))
}

#[pyfunction]
#[pyo3(signature = (positions, mesh, weighting="angle"))]
pub fn vertex_normals<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    mesh: &Mesh,
    weighting: &str,
) -> Recorded<'py> {
    let weighting = match weighting {
        "angle" => Weighting::Angle,
        "area" => Weighting::Area,
        _ => {
            let message = format!("weighting needs to be angle or area, got {weighting:?}");
            return Err(PyValueError::new_err(message));
        }
    };
    let inputs = [Some(&positions)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(positions)] = x[..] else { unreachable!("it is required") };
        Ok(smallvec![ops::vertex_normals(positions, &mesh.0, weighting)?])
    }))
}

/// Operations whose inputs are arrays, and whose output is one.
macro_rules! array_operations {
    ($($name:ident($($input:ident),+);)+) => {$(
        #[pyfunction]
        pub fn $name<'py>(py: Python<'py>, $($input: Array<'py>),+) -> Recorded<'py> {
            let inputs = [$(Some(&$input)),+];
            by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
                let [$(Some($input)),+] = x[..] else { unreachable!("they are required") };
                Ok(smallvec![ops::$name($($input),+)?])
            }))
        }
    )+};
}

array_operations! {
    affine_inverse(matrix);
    rigid(rotation, translation);
    distort(points, coefficients);
    fisheye(points, coefficients);
    transform_points(points, matrix);
    transform_normals(normals, matrix);
    project_instances(positions, matrices, camera);
    perturbed_normals(normals, tangents, values);
    reflect(directions, normals);
    over(front, behind);
    exposure(image, stops);
    srgb_encode(x);
    srgb_decode(y);
}
