//! PLY, ascii and binary.
//!
//! # What is read
//! - Of the element `vertex`: `x`, `y`, `z`; `nx`, `ny`, `nz`; `red`, `green`, `blue`, also with
//!   `diffuse_` before; `s`, `t`, or `u`, `v`, or `texture_u`, `texture_v`, or `texture_s`, `texture_t`.
//! - Of the element `face`: the list `vertex_indices` or `vertex_index`, and the list `texcoord` with two
//!   numbers for each corner, which comes before coordinates at vertices. A polygon becomes a fan of triangles
//!   around its first corner, which covers it where it is convex.
//! - The comment `TextureFile` with the path of an image, as MeshLab writes it: the base colour.
//!
//! Colours of type `uchar` or `ushort` are encoded by sRGB's curve, from 0 to 255 or 65535; colours of type
//! `float` are linear. Texture coordinates have v **up**, as in OBJ: 1 - v is the coordinate here.
//!
//! Opacities, colours of faces, further images, triangle strips and other elements are left out, most with a
//! note. Numbers of an ascii file have a digit before and after the point, and are finite: so the library
//! has it.
//!
//! # Source
//! Greg Turk, The PLY Polygon File Format.

mod header;
mod rows;
mod srgb;

use std::borrow::Cow;

use glam::DMat4;
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{ElementDef, Encoding, PropertyAccess};

use self::header::{Opened, message};
use self::rows::{Face, Skipped, Vertex};
pub(super) use self::srgb::encoded;
use crate::error::SceneError;
use crate::mesh::beside::Beside;
use crate::mesh::notes::name;
use crate::mesh::weld::{Corners, Raw, Welder};
use crate::model::{MaterialFile, Model, Placed, Submesh};

/// The vertices and faces of a file.
#[derive(Debug, Default)]
struct Contents {
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[f32; 3]>,
    coordinates: Vec<[f32; 2]>,
    faces: Vec<[u32; 3]>,
    /// The coordinates at the corners of faces: a row for each corner of a polygon.
    corner_coordinates: Vec<[f32; 2]>,
    corner_faces: Vec<[u32; 3]>,
    /// Whether a face has no coordinates at its corners.
    has_bare_faces: bool,
}

/// The model of a PLY file with these bytes.
pub(super) fn read(bytes: &[u8], beside: &mut Beside<'_>) -> Result<Model, SceneError> {
    let mut opened = Opened::new(bytes, beside)?;
    let definitions: Vec<ElementDef> = opened.header.elements.values().cloned().collect();
    let found = match definitions.iter().find(|element| element.name == "face") {
        None => Some("a mesh has the element face, and this has none: it is a cloud of points"),
        Some(faces) if faces.count == 0 => Some("a mesh has faces, and this has 0"),
        Some(_) => None,
    };
    if let Some(found) = found {
        return Err(SceneError::content(beside.place(), found));
    }
    let mut contents = Contents::default();
    for element in &definitions {
        match &*element.name {
            "vertex" => contents.read_vertices(element, &mut opened, beside)?,
            "face" => contents.read_faces(element, &mut opened, beside)?,
            other => {
                opened.rows::<Skipped>(element, beside, |_, _| Ok(()))?;
                beside.notes.add(format!("the element {:?} was left out", name(other)));
            }
        }
    }
    contents.check(beside)?;
    let mut model = Model::default();
    let material = material(&opened, &mut model, beside)?;
    let geometry =
        Welder::default().weld(contents.raw(material), &beside.place(), &mut beside.notes)?;
    model.geometries.extend(geometry);
    let (name, transform) = (String::new(), DMat4::IDENTITY);
    model.placed.push(Placed { name, geometry: 0, transform });
    model.images = std::mem::take(&mut beside.images);
    model.notes = std::mem::take(&mut beside.notes).finish();
    Ok(model)
}

/// The number of the material with the image that the header names.
fn material(
    opened: &Opened<'_>,
    model: &mut Model,
    beside: &mut Beside<'_>,
) -> Result<Option<usize>, SceneError> {
    let mut files =
        opened.header.comments.iter().filter_map(|c| c.trim().strip_prefix("TextureFile"));
    let Some(file) = files.next() else { return Ok(None) };
    if files.next().is_some() {
        beside.notes.add("images after the first one were left out");
    }
    let base_color_image = beside.image(file.trim())?;
    model.materials.push(MaterialFile { base_color_image, metallic: 0.0, ..Default::default() });
    Ok(Some(0))
}

impl Contents {
    fn read_vertices(
        &mut self,
        element: &ElementDef,
        opened: &mut Opened<'_>,
        beside: &mut Beside<'_>,
    ) -> Result<(), SceneError> {
        let [has_positions, has_normals, has_colors, has_coordinates] = rows::groups(element);
        if !has_positions {
            let found = "a vertex has the properties x, y and z, and these lack some";
            return Err(SceneError::content(beside.place(), found));
        }
        if element.properties.contains_key("alpha") {
            beside.notes.add("opacities of vertices were left out");
        }
        opened.rows::<Vertex>(element, beside, |vertex, _| {
            self.positions.push(vertex.position);
            if has_normals {
                self.normals.push(vertex.normal);
            }
            if has_colors {
                self.colors.push(vertex.color);
            }
            if has_coordinates {
                self.coordinates.push([vertex.coordinate[0], 1.0 - vertex.coordinate[1]]);
            }
            Ok(())
        })
    }

    fn read_faces(
        &mut self,
        element: &ElementDef,
        opened: &mut Opened<'_>,
        beside: &mut Beside<'_>,
    ) -> Result<(), SceneError> {
        let has = |name| element.properties.contains_key(name);
        if !has("vertex_indices") && !has("vertex_index") {
            let found = "a face has the property vertex_indices, and these have none";
            return Err(SceneError::content(beside.place(), found));
        }
        if has("red") {
            beside.notes.add("colours of faces were left out");
        }
        if has("texnumber") {
            beside.notes.add("all faces have the first image: others were left out");
        }
        let mut left_out = 0;
        opened.rows::<Face>(element, beside, |face, number| {
            let Face { vertices, coordinates } = face;
            if vertices.len() < 3 {
                left_out += 1;
                return Ok(());
            }
            for pair in vertices[1..].windows(2) {
                self.faces.push([vertices[0], pair[0], pair[1]]);
            }
            if coordinates.is_empty() {
                self.has_bare_faces = true;
            } else if coordinates.len() != 2 * vertices.len() {
                let corners = vertices.len();
                let rule =
                    format!("face {number} has two coordinates at each of {corners} corners");
                return Err(format!("{rule}, and these are {}", coordinates.len()));
            } else {
                let row = self.corner_coordinates.len() as u32;
                let rows = coordinates.chunks_exact(2).map(|pair| [pair[0], 1.0 - pair[1]]);
                self.corner_coordinates.extend(rows);
                for k in 1..vertices.len() as u32 - 1 {
                    self.corner_faces.push([row, row + k, row + k + 1]);
                }
            }
            Ok(())
        })?;
        if self.has_bare_faces && !self.corner_coordinates.is_empty() {
            beside.notes.add("coordinates at corners were left out: not all faces have some");
        }
        beside.notes.count("a face with fewer than three corners was left out", left_out);
        Ok(())
    }

    /// Refuses faces that name vertices beyond the last.
    fn check(&self, beside: &Beside<'_>) -> Result<(), SceneError> {
        let count = self.positions.len();
        match self.faces.iter().flatten().find(|&&vertex| vertex as usize >= count) {
            Some(vertex) => {
                let found =
                    format!("the file has {count} vertices, and a face names vertex {vertex}");
                Err(SceneError::content(beside.place(), found))
            }
            None => Ok(()),
        }
    }

    fn raw(&self, material: Option<usize>) -> Raw<'_> {
        let faces = || Cow::Borrowed(self.faces.as_slice());
        let at_vertices = Corners { rows: &self.coordinates, faces: faces() };
        let corner_faces = Cow::Borrowed(self.corner_faces.as_slice());
        let at_corners = Corners { rows: &self.corner_coordinates, faces: corner_faces };
        let coordinates = match self.corner_coordinates.is_empty() || self.has_bare_faces {
            true => Some(at_vertices).filter(|_| !self.coordinates.is_empty()),
            false => Some(at_corners),
        };
        let vectors = |rows| Corners { rows, faces: faces() };
        Raw {
            name: String::new(),
            submeshes: vec![Submesh { material, faces: 0..self.faces.len() }],
            is_welded: true,
            positions: vectors(&self.positions),
            colors: (!self.colors.is_empty()).then(|| vectors(&self.colors)),
            coordinates,
            normals: (!self.normals.is_empty()).then(|| vectors(&self.normals)),
            tangents: None,
        }
    }
}

impl Opened<'_> {
    /// Gives each row of an element, which are the next in the file, to `take` with its number.
    fn rows<E: PropertyAccess>(
        &mut self,
        element: &ElementDef,
        beside: &Beside<'_>,
        mut take: impl FnMut(E, usize) -> Result<(), String>,
    ) -> Result<(), SceneError> {
        let parser = Parser::<E>::new();
        let (kind, mut line) = (name(&element.name), String::new());
        for number in 0..element.count {
            let row = match self.header.encoding {
                Encoding::Ascii => {
                    let text = self.next_line();
                    line.clear();
                    line.push_str(&String::from_utf8_lossy(text));
                    parser.read_ascii_element(&line, element)
                }
                Encoding::BinaryLittleEndian => {
                    parser.read_little_endian_element(&mut self.left, element)
                }
                Encoding::BinaryBigEndian => {
                    parser.read_big_endian_element(&mut self.left, element)
                }
            };
            let place = || match self.header.encoding {
                Encoding::Ascii => beside.line(self.line),
                _ => beside.place(),
            };
            let row = row.map_err(|error| {
                let found = format!("{kind} {number} has the properties of the header");
                SceneError::content(place(), format!("{found}, and: {}", message(&error)))
            })?;
            take(row, number).map_err(|found| SceneError::content(place(), found))?;
        }
        Ok(())
    }
}
