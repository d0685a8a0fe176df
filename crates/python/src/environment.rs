//! Light from all sides.

use bokashi_core::OutputVars;
use bokashi_render_ops::{self as ops, CubeMap, Material, Surface};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smallvec::smallvec;

use crate::array::{Array, Number, by_type};
use crate::casts::Casts;
use crate::error::Refusal;
use crate::materials::{check_material, material_of};
use crate::step::{Recorded, record};

/// The weights by which surfaces see a cube map of `extent` x `extent` texels a face, in `levels` of roughness from 0
/// to 1. They depend on its size alone: make them once. `extent` is a power of two up to 256. For 64, with three or four
/// levels, the weights take 50 MB in a type of numbers.
#[pyclass(frozen, module = "bokashi")]
pub struct Prefilter {
    weights: Casts<ops::Prefilter<f64>>,
    #[pyo3(get)]
    extent: usize,
    #[pyo3(get)]
    levels: usize,
}

impl Prefilter {
    fn cast<T: Number>(&self) -> ops::Prefilter<T> {
        self.weights.get(ops::Prefilter::cast)
    }
}

#[pymethods]
impl Prefilter {
    #[new]
    fn new(py: Python<'_>, extent: usize, levels: usize) -> PyResult<Self> {
        let weights = crate::threads::released(py, || ops::Prefilter::new(extent, levels));
        let weights = Casts::new(weights.map_err(Refusal::from)?);
        Ok(Self { weights, extent, levels })
    }

    fn __repr__(&self) -> String {
        format!("Prefilter({}, {} levels)", self.extent, self.levels)
    }
}

/// Outputs: harmonics, then the levels of the mirror images but the first, which are the texels.
#[pyfunction]
pub fn prefiltered<'py>(
    py: Python<'py>,
    texels: Array<'py>,
    prefilter: &Prefilter,
) -> Recorded<'py> {
    let inputs = [Some(&texels)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let texels = x[0].expect("they are required");
        let environment = ops::Environment::from_texels(texels, &prefilter.cast::<T>())?;
        let mut outputs: OutputVars<'_, T> = smallvec![environment.harmonics];
        outputs.extend(environment.reflections.levels().iter().skip(1).copied());
        Ok(outputs)
    }))
}

#[pyfunction]
pub fn irradiance<'py>(
    py: Python<'py>,
    harmonics: Array<'py>,
    normals: Array<'py>,
) -> Recorded<'py> {
    let inputs = [Some(&harmonics), Some(&normals)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(harmonics), Some(normals)] = x[..] else { unreachable!("they are required") };
        Ok(smallvec![ops::irradiance(harmonics, normals)?])
    }))
}

/// Inputs: normals, views, three of the material, harmonics, then the levels of the mirror images.
#[pyfunction]
#[pyo3(signature = (normals, views, material, harmonics, levels, model="metallic-roughness", conserves_energy=false))]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn shade_in_environment<'py>(
    py: Python<'py>,
    normals: Array<'py>,
    views: Array<'py>,
    material: Vec<Array<'py>>,
    harmonics: Array<'py>,
    levels: Vec<Array<'py>>,
    model: &str,
    conserves_energy: bool,
) -> Recorded<'py> {
    check_material(model, material.len())?;
    if levels.is_empty() {
        return Err(PyValueError::new_err("an environment needs at least one level, got none"));
    }
    let mut inputs = vec![Some(&normals), Some(&views)];
    inputs.extend((0..3).map(|k| material.get(k)));
    inputs.push(Some(&harmonics));
    inputs.extend(levels.iter().map(Some));
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(normals), Some(views), color, second, third, Some(harmonics), ..] = x[..] else {
            unreachable!("they are required")
        };
        let material: Material<'_, T> = material_of(model, [color, second, third], conserves_energy);
        let levels: Vec<_> = x[6..].iter().copied().flatten().collect();
        let environment = ops::Environment { harmonics, reflections: CubeMap::from_levels(&levels)? };
        let surface = Surface { normals, views, positions: None };
        Ok(smallvec![environment.shade(&surface, &material)?])
    }))
}
