//! Operations with fragments.

use std::sync::Arc;

use bokashi_core::{OutputVars, Var};
use bokashi_render_ops::{
    self as ops, RasterOptions, Sampling, Silhouettes, Size, VertexAttributes,
};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use smallvec::smallvec;

use crate::array::{Array, by_type};
use crate::coverage::{Coverage, cull};
use crate::error::Refusal;
use crate::fragments::{self, Arrays};
use crate::mesh::Mesh;
use crate::pull_back::PullBack;
use crate::step::{Recorded, record};

/// Outputs: the barycentrics, with `exact` the weights, and where they are asked for the depths and the differentials.
/// With `exact`, `creases` are the attributes that will be shown, each with its index buffer, and gradients go to the
/// positions alone. With `behind`, what is seen behind a layer of the same positions.
#[pyfunction]
#[pyo3(signature = (
    clip, mesh, height, width, cull="none", exact=false, creases=vec![], with_depth=false, with_differentials=false,
    behind=None, crease_tolerance=2e-3
))]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn rasterize<'py>(
    py: Python<'py>,
    clip: Array<'py>,
    mesh: &Mesh,
    height: usize,
    width: usize,
    cull: &str,
    exact: bool,
    creases: Vec<(Array<'py>, Option<Py<Mesh>>)>,
    with_depth: bool,
    with_differentials: bool,
    behind: Option<&Coverage>,
    crease_tolerance: f64,
) -> PyResult<(Coverage, Bound<'py, PyTuple>, PullBack)> {
    let sampling = if exact { Sampling::Exact } else { Sampling::Center };
    let options = RasterOptions::new(Size { width, height })
        .cull(self::cull(cull)?)
        .sampling(sampling)
        .crease_tolerance(crease_tolerance);
    let meshes: Vec<_> =
        creases.iter().map(|(_, mesh)| mesh.as_ref().map(|mesh| &mesh.get().0)).collect();
    let inputs: Vec<_> = std::iter::once(Some(&clip))
        .chain(creases.iter().map(|(values, _)| Some(values)))
        .collect();
    let mut coverage = None;
    let (outputs, pull_back) = by_type!(&inputs, T => record::<T>(py, &inputs, |tape, x| {
        let clip = x[0].expect("it is required");
        let fragments = if let Some(Coverage(front)) = behind {
            let front = fragments::from_pixels(tape, front, Some(clip), None);
            ops::rasterize_behind(&front, options)?
        } else {
            let shown: Vec<_> = x[1..]
                .iter()
                .zip(&meshes)
                .filter_map(|(values, &indices)| Some(VertexAttributes { values: (*values)?, indices }))
                .collect();
            ops::rasterize(clip, &mesh.0, options.creases(&shown))?
        };
        coverage = Some(Arc::clone(&fragments.coverage));
        let mut outputs: OutputVars<'_, T> = smallvec![fragments.barycentrics];
        outputs.extend(fragments.weight);
        if with_depth {
            outputs.push(ops::depth(&fragments)?);
        }
        if with_differentials {
            outputs.push(ops::differentials(&fragments)?);
        }
        Ok(outputs)
    })?);
    Ok((Coverage(coverage.expect("it was just found")), outputs, pull_back))
}

#[pyfunction]
#[pyo3(signature = (attributes, barycentrics, clip, weight, coverage, mesh=None))]
pub fn interpolate<'py>(
    py: Python<'py>,
    attributes: Array<'py>,
    barycentrics: Array<'py>,
    clip: Array<'py>,
    weight: Option<Array<'py>>,
    coverage: &Coverage,
    mesh: Option<&Mesh>,
) -> Recorded<'py> {
    let inputs = [Some(&attributes), Some(&barycentrics), Some(&clip), weight.as_ref()];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let fragments = fragments::from_arrays(x, 1, &coverage.0);
        let indices = mesh.map_or(coverage.0.mesh(), |mesh| &mesh.0);
        let attributes = x[0].expect("they are required");
        Ok(smallvec![ops::interpolate_indexed(attributes, indices, &fragments)?])
    }))
}

#[pyfunction]
#[pyo3(signature = (attributes, differentials, barycentrics, clip, weight, coverage, mesh=None))]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn interpolate_differentials<'py>(
    py: Python<'py>,
    attributes: Array<'py>,
    differentials: Array<'py>,
    barycentrics: Array<'py>,
    clip: Array<'py>,
    weight: Option<Array<'py>>,
    coverage: &Coverage,
    mesh: Option<&Mesh>,
) -> Recorded<'py> {
    let inputs = [
        Some(&attributes),
        Some(&differentials),
        Some(&barycentrics),
        Some(&clip),
        weight.as_ref(),
    ];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let fragments = fragments::from_arrays(x, 2, &coverage.0);
        let indices = mesh.map_or(coverage.0.mesh(), |mesh| &mesh.0);
        let [Some(attributes), Some(differentials), ..] = x[..] else { unreachable!("they are required") };
        let values = ops::interpolate_differentials_indexed(attributes, indices, &fragments, differentials)?;
        Ok(smallvec![values])
    }))
}

/// Operations on fragments alone.
macro_rules! of_fragments {
    ($($name:ident => $call:expr;)+) => {$(
        #[pyfunction]
        #[pyo3(signature = (barycentrics, clip, weight, coverage))]
        pub fn $name<'py>(
            py: Python<'py>,
            barycentrics: Array<'py>,
            clip: Array<'py>,
            weight: Option<Array<'py>>,
            coverage: &Coverage,
        ) -> Recorded<'py> {
            let inputs: Arrays<'_, 'py> = [Some(&barycentrics), Some(&clip), weight.as_ref()];
            by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
                let call: for<'t> fn(&ops::Fragments<'t, T>) -> Result<Var<'t, T>, ops::RenderError> = $call;
                Ok(smallvec![call(&fragments::from_arrays(x, 0, &coverage.0))?])
            }))
        }
    )+};
}

of_fragments! {
    depth => ops::depth;
    differentials => ops::differentials;
    eye_depth => |fragments| Ok(ops::eye_depth(fragments)?.values());
    eye_depth_slope => ops::eye_depth_slope;
}

/// Inputs: values, background, barycentrics, clip, weight. With a reference, a loss.
#[pyfunction]
#[pyo3(signature = (values, background, barycentrics, clip, weight, coverage, antialias=true, reference=None))]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn picture<'py>(
    py: Python<'py>,
    values: Array<'py>,
    background: Option<Array<'py>>,
    barycentrics: Array<'py>,
    clip: Array<'py>,
    weight: Option<Array<'py>>,
    coverage: &Coverage,
    antialias: bool,
    reference: Option<Array<'py>>,
) -> Recorded<'py> {
    let inputs = [
        Some(&values),
        background.as_ref(),
        Some(&barycentrics),
        Some(&clip),
        weight.as_ref(),
        reference.as_ref(),
    ];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let fragments = fragments::from_arrays(x, 2, &coverage.0);
        let values = x[0].expect("they are required");
        let composite = ops::composite(values, &fragments, fragments::background(x[1]))?;
        let picture = if antialias && x[4].is_none() { ops::antialias(composite)? } else { composite.into() };
        fragments::finish("picture", &picture, x[5].map(Var::detach))
    }))
}

#[pyfunction]
#[pyo3(signature = (image, barycentrics, clip, coverage))]
pub fn antialias_image<'py>(
    py: Python<'py>,
    image: Array<'py>,
    barycentrics: Array<'py>,
    clip: Array<'py>,
    coverage: &Coverage,
) -> Recorded<'py> {
    let inputs = [Some(&image), Some(&barycentrics), Some(&clip), None];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let image = x[0].expect("it is required");
        Ok(smallvec![ops::antialias_image(image, &fragments::from_arrays(x, 1, &coverage.0))?])
    }))
}

/// A whole step: positions and a camera, colours at vertices, a background. With a reference, a loss.
#[pyfunction]
#[pyo3(signature = (
    positions, camera, colors, background, mesh, height, width, color_mesh=None, cull="none", silhouettes="exact",
    reference=None, crease_tolerance=2e-3
))]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn render<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    camera: Option<Array<'py>>,
    colors: Array<'py>,
    background: Option<Array<'py>>,
    mesh: &Mesh,
    height: usize,
    width: usize,
    color_mesh: Option<&Mesh>,
    cull: &str,
    silhouettes: &str,
    reference: Option<Array<'py>>,
    crease_tolerance: f64,
) -> Recorded<'py> {
    let silhouettes: Silhouettes = silhouettes.parse().map_err(Refusal::from)?;
    let options = RasterOptions::new(Size { width, height })
        .cull(self::cull(cull)?)
        .silhouettes(silhouettes)
        .crease_tolerance(crease_tolerance);
    let inputs =
        [Some(&positions), camera.as_ref(), Some(&colors), background.as_ref(), reference.as_ref()];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(positions), camera, Some(values), behind, reference] = x[..] else {
            unreachable!("they are required")
        };
        let clip = camera.map_or(Ok(positions), |camera| ops::project(positions, camera, None))?;
        let colors = VertexAttributes { values, indices: color_mesh.map(|mesh| &mesh.0) };
        let picture = ops::render(clip, &mesh.0, colors, options, fragments::background(behind))?;
        fragments::finish("render", &picture, reference.map(Var::detach))
    }))
}
