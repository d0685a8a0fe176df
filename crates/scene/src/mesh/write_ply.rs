//! PLY, binary and little endian: what [`super::read_model`] reads of it.
//!
//! A PLY file indexes all attributes alike. So a vertex is written once for each combination of attributes that
//! corners give it. Colours are 8 bits, encoded by sRGB's curve, as viewers expect it; v is up. Positions are
//! doubles where they lie far from the origin, and have what was taken off those of the file. Materials are the
//! element `material` and the comments `TextureFile`: base colours with their images, roughness and metallic.
//! Other images, wrap modes and tangents are left out.

use glam::{DVec3, Vec3};

use super::check::{check, check_number};
use super::colors::encoded;
use super::unweld::{Unwelded, row_or};
use crate::error::SceneError;
use crate::model::{Geometry, MaterialFile, Submesh};

/// A PLY file with the geometry, and with those of its model's `materials` that its faces have. Without
/// `materials` faces have none. The file holds no names of meshes or materials. `image` gives the file of a base
/// colour's image, by its number in the model, where there is one.
///
/// # Errors
/// [`SceneError::Content`] where a face names what is not there, a number is not finite, or no face is there.
pub fn ply(
    geometry: &Geometry,
    materials: &[MaterialFile],
    image: impl Fn(usize) -> Option<String>,
) -> Result<Vec<u8>, SceneError> {
    check(geometry)?;
    let unwelded = Unwelded::new(geometry);
    let Geometry { positions, offset, colors, coordinates, normals, submeshes, .. } = geometry;
    let mut header = "ply\nformat binary_little_endian 1.0\n".to_owned();
    // The materials of its faces, each with the number of its image.
    let (mut used, mut count) = (Vec::new(), 0);
    let mut numbers = vec![-1; materials.len()];
    for number in geometry.materials().flatten().filter(|_| !materials.is_empty()) {
        check_number("material", number, materials.len())?;
        if numbers[number] >= 0 {
            continue;
        }
        numbers[number] = used.len() as i32;
        let material = &materials[number];
        let file = material.base_color_map.image.and_then(&image);
        // A line feed would begin another line of the header.
        let file = file.filter(|file| !file.contains(char::is_control));
        used.push((material, if file.is_some() { count } else { -1 }));
        if let Some(file) = file {
            header.push_str(&format!("comment TextureFile {file}\n"));
            count += 1;
        }
    }
    header.push_str(&format!("element vertex {}\n", unwelded.vertices.len()));
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
    if !used.is_empty() {
        header.push_str(&format!("element material {}\n", used.len()));
        header.push_str(
            "property uchar diffuse_red\nproperty uchar diffuse_green\nproperty uchar diffuse_blue\n\
             property float roughness\nproperty float metallic\nproperty int texnumber\n",
        );
    }
    header.push_str(&format!("element face {}\n", unwelded.faces.len()));
    header.push_str("property list uchar int vertex_indices\n");
    if !used.is_empty() {
        header.push_str("property int material_index\n");
    }
    header.push_str("end_header\n");
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
    for &(material, image) in &used {
        let [red, green, blue, _] = material.base_color;
        bytes.extend([red, green, blue].map(encoded));
        push(&mut bytes, &[material.roughness, material.metallic].map(|x| x.clamp(0.0, 1.0)));
        bytes.extend(i32::to_le_bytes(image));
    }
    for Submesh { material, faces } in submeshes {
        let number = material.and_then(|material| numbers.get(material)).unwrap_or(&-1);
        for face in &unwelded.faces[faces.clone()] {
            bytes.push(3);
            bytes.extend(face.iter().flat_map(|vertex| vertex.to_le_bytes()));
            if !used.is_empty() {
                bytes.extend(number.to_le_bytes());
            }
        }
    }
    Ok(bytes)
}

fn push(bytes: &mut Vec<u8>, numbers: &[f32]) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}
