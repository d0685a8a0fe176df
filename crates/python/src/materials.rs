//! Materials by their names.

use bokashi_core::{Scalar, Var};
use bokashi_render_ops::Material;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// # Errors
/// `ValueError` for another model, and unless it has as many arrays as it needs.
pub fn check_material(model: &str, arrays: usize) -> PyResult<()> {
    let numbers = if model == "lambert" { 1 } else { 3 };
    if arrays != numbers {
        return Err(PyValueError::new_err(format!(
            "material {model} needs {numbers} arrays, got {arrays}"
        )));
    }
    if !["metallic-roughness", "lambert", "phong", "blinn-phong"].contains(&model) {
        return Err(PyValueError::new_err(format!(
            "a material needs to be metallic-roughness, lambert, phong or blinn-phong, got {model:?}"
        )));
    }
    Ok(())
}

/// The material of a model that was checked, from its arrays.
pub fn material_of<'t, T: Scalar>(
    model: &str,
    [color, second, third]: [Option<Var<'t, T>>; 3],
    conserves_energy: bool,
) -> Material<'t, T> {
    let counted = |array: Option<_>| array.expect("it was counted");
    let color = counted(color);
    match model {
        "lambert" => Material::Lambert { color },
        "phong" => Material::Phong { color, specular: counted(second), exponent: counted(third) },
        "blinn-phong" => {
            Material::BlinnPhong { color, specular: counted(second), exponent: counted(third) }
        }
        _ => Material::MetallicRoughness {
            base_color: color,
            roughness: counted(second),
            metallic: counted(third),
            conserves_energy,
        },
    }
}
