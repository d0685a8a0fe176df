//! Surfaces one behind another, and what a lens sees of them.

use std::sync::Arc;

use bokashi_core::{OutputVars, Scalar, Var};
use bokashi_render_ops::{self as ops, Iris, RasterOptions, Size, ThinLens, ThinLensOptions};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use smallvec::smallvec;

use crate::array::{Array, by_type};
use crate::coverage::{Coverage, cull};
use crate::fragments::{self, from_pixels};
use crate::mesh::Mesh;
use crate::pull_back::PullBack;
use crate::step::{Recorded, record};

/// Outputs: the barycentrics of each layer.
#[pyfunction]
#[pyo3(signature = (clip, mesh, height, width, cull="none", most=None))]
pub fn depth_layers<'py>(
    py: Python<'py>,
    clip: Array<'py>,
    mesh: &Mesh,
    height: usize,
    width: usize,
    cull: &str,
    most: Option<usize>,
) -> PyResult<(Vec<Coverage>, Bound<'py, PyTuple>, PullBack)> {
    let options = RasterOptions::new(Size { width, height }).cull(self::cull(cull)?);
    let inputs = [Some(&clip)];
    let mut coverages = Vec::new();
    let (outputs, pull_back) = by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let layers = ops::depth_layers(x[0].expect("it is required"), &mesh.0, options, most)?;
        coverages = layers.iter().map(|layer| Coverage(Arc::clone(&layer.coverage))).collect();
        Ok(layers.iter().map(|layer| layer.barycentrics).collect())
    })?);
    Ok((coverages, outputs, pull_back))
}

/// Inputs: background, clip, colours and alpha of each layer, reference.
#[pyfunction]
#[pyo3(signature = (background, clip, layers, coverages, antialias=true, reference=None))]
pub fn composite_layers<'py>(
    py: Python<'py>,
    background: Option<Array<'py>>,
    clip: Array<'py>,
    layers: Vec<(Array<'py>, Array<'py>)>,
    coverages: Vec<Py<Coverage>>,
    antialias: bool,
    reference: Option<Array<'py>>,
) -> Recorded<'py> {
    check_counts(layers.len(), coverages.len())?;
    let mut inputs = vec![background.as_ref(), Some(&clip)];
    inputs.extend(layers.iter().flat_map(|(values, alpha)| [Some(values), Some(alpha)]));
    inputs.push(reference.as_ref());
    by_type!(&inputs, T => record::<T>(py, &inputs, |tape, x| {
        let drawn: Vec<_> =
            coverages.iter().map(|coverage| from_pixels(tape, &coverage.get().0, x[1], None)).collect();
        let pairs = drawn.iter().zip(x[2..].as_chunks::<2>().0);
        let layers: Vec<_> = pairs
            .map(|(fragments, &[premultiplied, alpha])| ops::Layer {
                fragments,
                premultiplied: premultiplied.expect("they are required"),
                alpha: alpha.expect("they are required"),
            })
            .collect();
        let composite = ops::composite_layers(&layers, fragments::background(x[0]))?;
        let picture = if antialias { ops::antialias(composite)? } else { composite.into() };
        fragments::finish("composite_layers", &picture, x[x.len() - 1].map(Var::detach))
    }))
}

/// # Errors
/// `ValueError` unless each layer has a coverage.
fn check_counts(layers: usize, coverages: usize) -> PyResult<()> {
    if layers == coverages {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("{layers} layers need a coverage each, got {coverages}")))
}

/// Colours, alphas or none for opaque ones, distances, and perhaps slopes.
type GivenLayer<'py> = (Array<'py>, Option<Array<'py>>, Array<'py>, Option<Array<'py>>);

/// The layer of four inputs.
fn lens_layer<'a, 't, T: Scalar>(
    fragments: &'a ops::Fragments<'t, T>,
    inputs: &[Option<Var<'t, T>>; 4],
) -> ops::LensLayer<'a, 't, T> {
    let [Some(premultiplied), alpha, Some(distance), slope] = *inputs else {
        unreachable!("they are required")
    };
    let tape = premultiplied.tape();
    let opaque = || tape.constant_full([fragments.coverage.count()], T::ONE);
    let alpha = alpha.unwrap_or_else(opaque);
    ops::LensLayer { fragments, premultiplied, alpha, distance, slope }
}

/// Inputs: background, aperture, focus, weights of the first layer's pieces, then colours, alphas, distances and slopes
/// of each layer.
#[pyfunction]
#[pyo3(signature = (
    background, aperture, focus, weight, layers, coverages, far=f64::INFINITY, margin=0, largest_radius=64.0, blades=0,
    rotation=0.0
))]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn lens_picture<'py>(
    py: Python<'py>,
    background: Option<Array<'py>>,
    aperture: Array<'py>,
    focus: Array<'py>,
    weight: Option<Array<'py>>,
    layers: Vec<GivenLayer<'py>>,
    coverages: Vec<Py<Coverage>>,
    far: f64,
    margin: usize,
    largest_radius: f64,
    blades: usize,
    rotation: f64,
) -> Recorded<'py> {
    check_counts(layers.len(), coverages.len())?;
    if layers.is_empty() {
        return Err(PyValueError::new_err("lens_picture needs at least one layer, got none"));
    }
    let iris = if blades == 0 { Iris::Disc } else { Iris::Polygon { blades, rotation } };
    let options = ThinLensOptions { margin, largest_radius, iris, ..ThinLensOptions::default() };
    let mut inputs = vec![background.as_ref(), Some(&aperture), Some(&focus), weight.as_ref()];
    inputs.extend(layers.iter().flat_map(|(values, alpha, distance, slope)| {
        [Some(values), alpha.as_ref(), Some(distance), slope.as_ref()]
    }));
    by_type!(&inputs, T => record::<T>(py, &inputs, |tape, x| {
        let [_, Some(aperture), Some(focus), weight, ..] = x[..] else { unreachable!("they are required") };
        let weights = std::iter::once(weight).chain(std::iter::repeat(None));
        let drawn: Vec<_> = coverages
            .iter()
            .zip(weights)
            .map(|(coverage, weight)| from_pixels(tape, &coverage.get().0, None, weight))
            .collect();
        let layers = drawn.iter().zip(x[4..].as_chunks::<4>().0);
        let layers: Vec<_> = layers.map(|(fragments, inputs)| lens_layer(fragments, inputs)).collect();
        let (lens, background) = (ThinLens { aperture, focus }, fragments::background(x[0]));
        let picture = ops::lens_picture(layers[0], &layers[1..], background, far, lens, &options)?;
        let outputs: OutputVars<'_, T> = smallvec![picture.image];
        Ok(outputs)
    }))
}
