//! Rows of a PLY file, as the library gives them: a property at a time, by its name.

use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyAccessResult};

use super::srgb::decoded;

/// The names of a vertex' properties, by what they are and in the order of their numbers.
const POSITION: [&[&str]; 3] = [&["x"], &["y"], &["z"]];
const NORMAL: [&[&str]; 3] = [&["nx"], &["ny"], &["nz"]];
const COLOR: [&[&str]; 3] =
    [&["red", "diffuse_red"], &["green", "diffuse_green"], &["blue", "diffuse_blue"]];
const COORDINATE: [&[&str]; 2] =
    [&["s", "u", "texture_u", "texture_s"], &["t", "v", "texture_v", "texture_t"]];

/// A vertex.
#[derive(Debug, Default)]
pub(super) struct Vertex {
    pub(super) position: [f32; 3],
    pub(super) normal: [f32; 3],
    /// Linear.
    pub(super) color: [f32; 3],
    /// As the file has it: v up.
    pub(super) coordinate: [f32; 2],
}

/// A polygon.
#[derive(Debug, Default)]
pub(super) struct Face {
    pub(super) vertices: Vec<u32>,
    pub(super) coordinates: Vec<f32>,
}

/// A row that is read over.
#[derive(Debug)]
pub(super) struct Skipped;

/// Whether vertices have positions, normals, colours and coordinates.
pub(super) fn groups(element: &ElementDef) -> [bool; 4] {
    let has = |names: &&[&str]| names.iter().any(|name| element.properties.contains_key(*name));
    [
        POSITION.iter().all(has),
        NORMAL.iter().all(has),
        COLOR.iter().all(has),
        COORDINATE.iter().all(has),
    ]
}

/// Where among `slots` a property belongs.
fn slot<'s, const N: usize>(
    slots: &'s mut [f32; N],
    names: [&[&str]; N],
    name: &str,
) -> Option<&'s mut f32> {
    let number = names.iter().position(|names| names.contains(&name))?;
    Some(&mut slots[number])
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(number) = property.to_f32_lossy() else { return PropertyAccessResult::Ignored };
        let Self { position, normal, color, coordinate } = self;
        if let Some(slot) = slot(position, POSITION, name)
            .or_else(|| slot(normal, NORMAL, name))
            .or_else(|| slot(coordinate, COORDINATE, name))
        {
            *slot = number;
        } else if let Some(slot) = slot(color, COLOR, name) {
            *slot = match property {
                Property::UChar(number) => decoded(f64::from(number) / 255.0),
                Property::UShort(number) => decoded(f64::from(number) / 65535.0),
                Property::Float(_) | Property::Double(_) => number,
                _ => return PropertyAccessResult::UnsupportedType,
            };
        } else {
            return PropertyAccessResult::Ignored;
        }
        PropertyAccessResult::Set
    }

    fn set_float(&mut self, name: &str, number: f32) -> PropertyAccessResult {
        self.set_property(name, Property::Float(number))
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        match name {
            "vertex_indices" | "vertex_index" => match property.to_u32_list() {
                Some(vertices) => self.vertices = vertices,
                None => return PropertyAccessResult::UnsupportedType,
            },
            "texcoord" => match property {
                Property::ListFloat(numbers) => self.coordinates = numbers,
                Property::ListDouble(numbers) => {
                    self.coordinates = numbers.into_iter().map(|number| number as f32).collect();
                }
                _ => return PropertyAccessResult::UnsupportedType,
            },
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
