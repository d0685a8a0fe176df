//! Light on surfaces, and lenses.

use bokashi_render_ops::{
    self as ops, DepthImage, Iris, Lens, LensOptions, Light, Radius, Surface,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use smallvec::smallvec;

use crate::array::{Array, by_type};
use crate::materials::{check_material, material_of};
use crate::mesh::Mesh;
use crate::step::{Recorded, record};

/// A kind, and one array or two.
type GivenLight<'py> = (String, Array<'py>, Option<Array<'py>>);

/// # Errors
/// `ValueError` for another model or kind of light, and where either has other arrays than it needs.
fn check(model: &str, material: &[Array<'_>], lights: &[GivenLight<'_>]) -> PyResult<()> {
    check_material(model, material.len())?;
    for (kind, _, second) in lights {
        let expected = match &**kind {
            "directional" | "point" => true,
            "ambient" => false,
            _ => {
                let message =
                    format!("a light needs to be directional, point or ambient, got {kind:?}");
                return Err(PyValueError::new_err(message));
            }
        };
        if second.is_some() != expected {
            let count = if expected { "two arrays" } else { "one array" };
            return Err(PyValueError::new_err(format!("a light of kind {kind} needs {count}")));
        }
    }
    Ok(())
}

/// Inputs: normals, views, positions, three of the material, then two of each light, of which an ambient one has none.
#[pyfunction]
#[pyo3(signature = (normals, views, positions, material, model, lights, conserves_energy=false))]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn shade<'py>(
    py: Python<'py>,
    normals: Array<'py>,
    views: Array<'py>,
    positions: Option<Array<'py>>,
    material: Vec<Array<'py>>,
    model: &str,
    lights: Vec<GivenLight<'py>>,
    conserves_energy: bool,
) -> Recorded<'py> {
    check(model, &material, &lights)?;
    let kinds: Vec<&str> = lights.iter().map(|(kind, ..)| &**kind).collect();
    let mut inputs = vec![Some(&normals), Some(&views), positions.as_ref()];
    inputs.extend((0..3).map(|k| material.get(k)));
    inputs.extend(lights.iter().flat_map(|(_, first, second)| [Some(first), second.as_ref()]));
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(normals), Some(views), positions, Some(color), second, third, ..] = x[..] else {
            unreachable!("they are required")
        };
        let material = material_of(model, [Some(color), second, third], conserves_energy);
        let counted = |number: Option<_>| number.expect("it was counted");
        let of_lights = kinds.iter().zip(x[6..].chunks(2)).map(|(&kind, numbers)| {
            let first = counted(numbers[0]);
            match kind {
                "directional" => Light::Directional { direction: first, irradiance: counted(numbers[1]) },
                "point" => Light::Point { position: first, intensity: counted(numbers[1]) },
                _ => Light::Ambient { radiance: first },
            }
        });
        let lights: Vec<_> = of_lights.collect();
        Ok(smallvec![ops::shade(&Surface { normals, views, positions }, &material, &lights)?])
    }))
}

/// Inputs: image, distances, aperture, focus.
#[pyfunction]
#[pyo3(signature = (image, distances, aperture, focus, largest_sigma=32.0, tolerance=1e-3, blades=None, rotation=0.0))]
#[expect(clippy::too_many_arguments, reason = "Python has names for them")]
pub fn depth_of_field<'py>(
    py: Python<'py>,
    image: Array<'py>,
    distances: Array<'py>,
    aperture: Array<'py>,
    focus: Array<'py>,
    largest_sigma: f64,
    tolerance: f64,
    blades: Option<usize>,
    rotation: f64,
) -> Recorded<'py> {
    let iris = blades.map(|blades| match blades {
        0 => Iris::Disc,
        blades => Iris::Polygon { blades, rotation },
    });
    let options = LensOptions { radius: Radius::Tolerance(tolerance), largest_sigma, iris };
    let inputs = [Some(&image), Some(&distances), Some(&aperture), Some(&focus)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(image), Some(distances), Some(aperture), Some(focus)] = x[..] else {
            unreachable!("they are required")
        };
        let distances = DepthImage::from_distances(distances);
        Ok(smallvec![ops::depth_of_field(image, distances, Lens { aperture, focus }, &options)?.image])
    }))
}

/// Inputs: positions, normals, coordinates.
#[pyfunction]
#[pyo3(signature = (positions, normals, coordinates, mesh, coordinates_mesh=None))]
pub fn tangents<'py>(
    py: Python<'py>,
    positions: Array<'py>,
    normals: Array<'py>,
    coordinates: Array<'py>,
    mesh: &Mesh,
    coordinates_mesh: Option<&Mesh>,
) -> Recorded<'py> {
    let inputs = [Some(&positions), Some(&normals), Some(&coordinates)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let [Some(positions), Some(normals), Some(coordinates)] = x[..] else {
            unreachable!("they are required")
        };
        let indices = coordinates_mesh.map_or(&mesh.0, |mesh| &mesh.0);
        Ok(smallvec![ops::tangents(positions, normals, coordinates, indices, &mesh.0)?])
    }))
}
