//! PLY, binary and little endian: what [`super::read_model`] reads of it.
//!
//! A PLY file indexes all attributes alike. So a vertex is written once for each combination of attributes that
//! corners give it. Colours are 8 bits, encoded by sRGB's curve, as viewers expect it; v is up. Positions are doubles, with what was taken off those of the file, where they lie far
//! from the origin.

use glam::{DVec3, Vec3};

use super::check::check;
use super::colors::encoded;
use super::unweld::{Unwelded, row_or};
use crate::error::SceneError;
use crate::model::Geometry;

/// A PLY file with the geometry. Its name and its material are not in there.
///
/// # Errors
/// [`SceneError::Content`] where a face names what is not there, a number is not finite, or no face is there.
pub fn ply(geometry: &Geometry) -> Result<Vec<u8>, SceneError> {
    check(geometry)?;
    let unwelded = Unwelded::of(geometry);
    let Geometry { positions, offset, colors, coordinates, normals, .. } = geometry;
    let mut header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        unwelded.vertices.len()
    );
    let is_far = *offset != DVec3::ZERO;
    let kind = if is_far { "double" } else { "float" };
    header.push_str(&format!("property {kind} x\nproperty {kind} y\nproperty {kind} z\n"));
    if normals.is_some() {
        header.push_str("property float nx\nproperty float ny\nproperty float nz\n");
    }
    if colors.is_some() {
        header.push_str("property uchar red\nproperty uchar green\nproperty uchar blue\n");
    }
    if coordinates.is_some() {
        header.push_str("property float s\nproperty float t\n");
    }
    header.push_str(&format!("element face {}\n", unwelded.faces.len()));
    header.push_str("property list uchar int vertex_indices\nend_header\n");
    let mut bytes = header.into_bytes();
    for &[position, color, coordinate, normal, _] in &unwelded.vertices {
        let position = positions[position as usize];
        match is_far {
            true => {
                let whole = Vec3::from(position).as_dvec3() + *offset;
                bytes.extend(whole.to_array().iter().flat_map(|number| number.to_le_bytes()));
            }
            false => push(&mut bytes, &position),
        }
        if let Some(normals) = normals {
            push(&mut bytes, &row_or(normals, normal, [0.0; 3]));
        }
        if let Some(colors) = colors {
            bytes.extend(row_or(colors, color, [1.0; 3]).map(encoded));
        }
        if let Some(coordinates) = coordinates {
            let [u, v] = row_or(coordinates, coordinate, [0.0; 2]);
            push(&mut bytes, &[u, 1.0 - v]);
        }
    }
    for face in &unwelded.faces {
        bytes.push(3);
        bytes.extend(face.iter().flat_map(|vertex| vertex.to_le_bytes()));
    }
    Ok(bytes)
}

fn push(bytes: &mut Vec<u8>, numbers: &[f32]) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}
