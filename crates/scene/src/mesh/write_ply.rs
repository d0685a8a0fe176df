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
    let Materials { used, numbers, files } = Materials::new(geometry, materials, image)?;
    let mut bytes = header(geometry, &unwelded, used.len(), &files).into_bytes();
    let is_far = *offset != DVec3::ZERO;
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

/// The materials of faces.
struct Materials<'m> {
    /// Each with the number of its image, or -1.
    used: Vec<(&'m MaterialFile, i32)>,
    /// The place of each material of the model among `used`, or -1.
    numbers: Vec<i32>,
    /// Those of images.
    files: Vec<String>,
}

impl<'m> Materials<'m> {
    fn new(
        geometry: &Geometry,
        materials: &'m [MaterialFile],
        image: impl Fn(usize) -> Option<String>,
    ) -> Result<Self, SceneError> {
        let (mut used, mut files) = (Vec::new(), Vec::new());
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
            used.push((material, if file.is_some() { files.len() as i32 } else { -1 }));
            files.extend(file);
        }
        Ok(Self { used, numbers, files })
    }
}

/// The header of a file with so many `materials`, whose images are in these files.
fn header(geometry: &Geometry, unwelded: &Unwelded, materials: usize, files: &[String]) -> String {
    let Geometry { offset, colors, coordinates, normals, .. } = geometry;
    let kind = if *offset == DVec3::ZERO { "float" } else { "double" };
    let properties = |kind: &str, names: &str| -> String {
        names.split(' ').map(|name| format!("property {kind} {name}\n")).collect()
    };
    let mut header = "ply\nformat binary_little_endian 1.0\n".to_owned();
    header.extend(files.iter().map(|file| format!("comment TextureFile {file}\n")));
    header += &format!("element vertex {}\n", unwelded.vertices.len());
    header += &properties(kind, "x y z");
    if normals.is_some() {
        header += &properties("float", "nx ny nz");
    }
    if colors.is_some() {
        header += &properties("uchar", "red green blue");
    }
    if coordinates.is_some() {
        header += &properties("float", "s t");
    }
    if materials > 0 {
        header += &format!("element material {materials}\n");
        header += &properties("uchar", "diffuse_red diffuse_green diffuse_blue");
        header += &properties("float", "roughness metallic");
        header += &properties("int", "texnumber");
    }
    header += &format!("element face {}\n", unwelded.faces.len());
    header += &properties("list uchar int", "vertex_indices");
    if materials > 0 {
        header += &properties("int", "material_index");
    }
    header + "end_header\n"
}

fn push(bytes: &mut Vec<u8>, numbers: &[f32]) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}
