//! PLY, binary and little endian: what [`super::read_model`] reads of it.
//!
//! A PLY file indexes all attributes alike. So a vertex is written once for each combination of attributes that
//! corners give it. Colours are 8 bits, encoded by sRGB's curve, as viewers expect it; v is up. Positions are
//! those in the world, once for each place of the geometry, and doubles where one of them is far from the origin:
//! floats would lose bits. Materials are the element `material` and the comments `TextureFile`: base colours with
//! their images, roughness and metallic. Other images, wrap modes and tangents are left out.

use glam::{DMat4, DVec3};

use super::check::{check, check_number, location};
use super::colors::encoded;
use super::in_world::{NormalTurn, corner_order, points};
use super::unweld::{Unwelded, row_or};
use crate::error::SceneError;
use crate::model::{Geometry, MaterialFile, Submesh, is_far};

/// The most vertices of a file: faces name them by numbers of 32 bits with a sign.
const MOST_VERTICES: usize = i32::MAX as usize;

/// A PLY file with the geometry in the world, once for each of its `places`, and with those of its model's
/// `materials` that its faces have. Without `materials` faces have none. The file holds no names of meshes or
/// materials. `image` gives the file of a base colour's image, by its number in the model, where there is one.
///
/// With `[DMat4::from_translation(geometry.offset)]` as places it has the coordinates of the file that the geometry
/// was read from.
///
/// # Errors
/// [`SceneError::Content`] where a face names what is not there, a number is not finite, here or in the world, no face
/// or no place is there, or vertices are more than 2^31 - 1.
pub fn ply(
    geometry: &Geometry,
    places: &[DMat4],
    materials: &[MaterialFile],
    image: impl Fn(usize) -> Option<String>,
) -> Result<Vec<u8>, SceneError> {
    check(geometry)?;
    let unwelded = Unwelded::new(geometry);
    let vertices = unwelded.vertices.len().saturating_mul(places.len());
    if !(1..=MOST_VERTICES).contains(&vertices) {
        let rule = "has from 1 to 2147483647 vertices in all of its places";
        let message = format!("the mesh {:?} {rule}, and these are {vertices}", geometry.name);
        return Err(SceneError::content(location(), message));
    }
    let in_world = places.iter().map(|place| points(geometry, place));
    let in_world = in_world.collect::<Result<Vec<_>, _>>()?;
    let is_double = in_world.iter().any(|points| is_coarse(points, &unwelded));
    let Materials { used, numbers, files } = Materials::new(geometry, materials, image)?;
    let counts = [unwelded.vertices.len(), unwelded.faces.len()].map(|count| count * places.len());
    let mut bytes = header(geometry, is_double, counts, used.len(), &files).into_bytes();
    for (place, points) in places.iter().zip(&in_world) {
        push_vertices(&mut bytes, geometry, &unwelded, (place, points), is_double);
    }
    for &(material, image) in &used {
        let [red, green, blue, _] = material.base_color;
        bytes.extend([red, green, blue].map(encoded));
        push(&mut bytes, &[material.roughness, material.metallic].map(|x| x.clamp(0.0, 1.0)));
        bytes.extend(i32::to_le_bytes(image));
    }
    for (k, place) in places.iter().enumerate() {
        let first = (k * unwelded.vertices.len()) as u32;
        let corners = corner_order(place);
        for Submesh { material, faces } in &geometry.submeshes {
            let number = material.and_then(|material| numbers.get(material)).unwrap_or(&-1);
            for face in &unwelded.faces[faces.clone()] {
                bytes.push(3);
                bytes.extend(corners.iter().flat_map(|&k| (first + face[k]).to_le_bytes()));
                if !used.is_empty() {
                    bytes.extend(number.to_le_bytes());
                }
            }
        }
    }
    Ok(bytes)
}

/// Whether floats are too coarse for points: those that faces name are far from the origin, or beyond all floats.
fn is_coarse(points: &[DVec3], unwelded: &Unwelded) -> bool {
    let named = unwelded.vertices.iter().map(|&[vertex, ..]| points[vertex as usize]);
    let bounds = named.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[least, most], point| {
        [least.min(point), most.max(point)]
    });
    is_far(bounds) || bounds.iter().any(|bound| !bound.as_vec3().is_finite())
}

/// Adds the vertices of a geometry in one place.
fn push_vertices(
    bytes: &mut Vec<u8>,
    geometry: &Geometry,
    unwelded: &Unwelded,
    (place, points): (&DMat4, &[DVec3]),
    is_double: bool,
) {
    let Geometry { colors, coordinates, normals, .. } = geometry;
    let turn = NormalTurn::new(place);
    for &[position, color, coordinate, normal, _] in &unwelded.vertices {
        let position = points[position as usize];
        match is_double {
            true => bytes.extend(position.to_array().iter().flat_map(|x| x.to_le_bytes())),
            false => push(bytes, &position.as_vec3().to_array()),
        }
        if let Some(normals) = normals {
            let normal = row_or(normals, normal, [0.0; 3]);
            push(bytes, &turn.turned(normal).map(|x| x as f32));
        }
        if let Some(colors) = colors {
            bytes.extend(row_or(colors, color, [1.0; 3]).map(encoded));
        }
        if let Some(coordinates) = coordinates {
            let [u, v] = row_or(coordinates, coordinate, [0.0; 2]);
            push(bytes, &[u, 1.0 - v]);
        }
    }
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

/// The header of a file with so many vertices, faces and `materials`, whose images are in these files.
fn header(
    geometry: &Geometry,
    is_double: bool,
    [vertices, faces]: [usize; 2],
    materials: usize,
    files: &[String],
) -> String {
    let Geometry { colors, coordinates, normals, .. } = geometry;
    let kind = if is_double { "double" } else { "float" };
    let properties = |kind: &str, names: &str| -> String {
        names.split(' ').map(|name| format!("property {kind} {name}\n")).collect()
    };
    let mut header = "ply\nformat binary_little_endian 1.0\n".to_owned();
    header.extend(files.iter().map(|file| format!("comment TextureFile {file}\n")));
    header += &format!("element vertex {vertices}\n");
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
    header += &format!("element face {faces}\n");
    header += &properties("list uchar int", "vertex_indices");
    if materials > 0 {
        header += &properties("int", "material_index");
    }
    header + "end_header\n"
}

fn push(bytes: &mut Vec<u8>, numbers: &[f32]) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}
