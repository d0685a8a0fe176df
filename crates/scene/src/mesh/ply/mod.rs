//! PLY, ascii and binary.
//!
//! # What is read
//! - Of the element `vertex`: `x`, `y`, `z`; `nx`, `ny`, `nz`; colours, which are `red`, `green`, `blue`,
//!   also with `diffuse_` before, or `r`, `g`, `b`; `s`, `t`, or `u`, `v`, or `texture_u`, `texture_v`, or
//!   `texture_s`, `texture_t`.
//! - Of the element `face`: the list `vertex_indices` or `vertex_index`, and the list `texcoord` with two
//!   numbers for each corner, which comes before coordinates at vertices. Colours of faces are read where
//!   vertices have none. A polygon becomes triangles as in [`polygons`](crate::mesh::polygons).
//! - The element `tristrips`: a list of vertices in which -1 ends a strip. Of two neighbouring triangles of
//!   a strip one is turned.
//! - The comments `TextureFile`, the element `material`, and `material_index` or `texnumber` of faces: see
//!   [`materials`].
//!
//! Numbers are of any type; in an ascii file also `2.`, `.5`, `nan` and `inf`. Colours become light as in
//! [`colors`]. Texture coordinates have v **up**, as in OBJ: 1 - v is the coordinate here.
//!
//! Opacities, `alpha`, are left out: a note says so where one is not full. A note names all other elements and
//! properties.
//!
//! # Why no library reads it
//! ply-rs-bw 4.0 refuses `2.`, `.5` and `nan` in ascii files, names no word that it can't read, and reads
//! numbers where types must fit the program's. The tests compare with it.
//!
//! # Source
//! Greg Turk, The PLY Polygon File Format.

mod header;
mod materials;
mod rows;

use std::borrow::Cow;
use std::mem;

use glam::DMat4;

use self::header::{Element, Header, Number};
use self::materials::{Materials, NO_MATERIAL, NUMBERS, submeshes};
use self::rows::{Named, Row, Rows};
use crate::error::SceneError;
use crate::mesh::colors::{self, Written};
use crate::mesh::context::MeshContext;
use crate::mesh::far::Near;
use crate::mesh::notes::name;
use crate::mesh::polygons::Polygons;
use crate::mesh::weld::{Corners, Raw, Welder};
use crate::model::{Geometry, Model, Placed, Submesh};
use crate::picture::ColorSpace;

/// The names of texture coordinates.
const COORDINATES: [[&str; 2]; 4] =
    [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texture_s", "texture_t"]];
/// The names of opacities.
const OPACITIES: [[&str; 1]; 3] = [["alpha"], ["diffuse_alpha"], ["a"]];
/// The names of the vertices of a face or a strip.
const VERTICES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// Colours as a file has them, and how.
type Colors = Option<(Written, Vec<[f32; 3]>)>;

/// The vertices and faces of a file.
#[derive(Debug, Default)]
struct Contents {
    positions: Vec<[f64; 3]>,
    near: Near,
    normals: Vec<[f32; 3]>,
    /// At vertices.
    colors: Colors,
    coordinates: Vec<[f32; 2]>,
    faces: Vec<[u32; 3]>,
    /// The polygon that each face is of.
    polygon_faces: Vec<[u32; 3]>,
    polygon_colors: Colors,
    /// The coordinates at the corners of faces: a row for each corner of a polygon.
    corner_coordinates: Vec<[f32; 2]>,
    corner_faces: Vec<[u32; 3]>,
    /// Whether a face has no coordinates at its corners.
    has_bare_faces: bool,
    /// The number of each face's material; empty where no face names one.
    materials: Vec<u32>,
    polygons: Polygons,
}

/// The model of a PLY file with these bytes.
pub(super) fn read(bytes: &[u8], context: &mut MeshContext<'_>) -> Result<Model, SceneError> {
    let header = Header::read(bytes, context)?;
    let is_surface = |element: &&Element| matches!(&*element.name, "face" | "tristrips");
    let fault = match header.elements.iter().filter(is_surface).map(|element| element.count).max() {
        None => Some("a mesh has the element face, and this has none: it is a cloud of points"),
        Some(0) => Some("a mesh has faces, and this has 0"),
        Some(_) => None,
    };
    if let Some(fault) = fault {
        return Err(context.error(fault));
    }
    let (mut contents, mut rows) = (Contents::default(), Rows::after(&header, bytes));
    let mut materials = Materials::default();
    for element in &header.elements {
        match &*element.name {
            "vertex" => contents.read_vertices(element, &mut rows, context)?,
            "face" => contents.read_faces(element, &mut rows, context)?,
            "tristrips" => contents.read_strips(element, &mut rows, context)?,
            "material" => materials.read(element, &mut rows, context)?,
            other => {
                rows.read(element, context, |_, _| Ok(()))?;
                context.notes.add(format!("the element {:?} was left out", name(other)));
            }
        }
    }
    contents.finish(context)?;
    let materials = materials.finish(&header, context)?;
    let mut model = Model { materials, ..Model::default() };
    if model.materials.is_empty() {
        // Number 0 alone tells nothing apart.
        if contents.materials.iter().any(|&material| material != NO_MATERIAL && material > 0) {
            context.notes.add("faces name materials or images, and the file has none");
        }
        contents.materials.clear();
    }
    let submeshes = contents.submeshes(model.materials.len());
    let submeshes = submeshes.map_err(|message| context.error(message))?;
    let raw = contents.raw(submeshes, context.options.weld.unwrap_or(true));
    let geometry = Welder::default().weld(raw, &context.location(), &mut context.notes)?;
    let offset = contents.near.offset;
    model.geometries.extend(geometry.map(|geometry| Geometry { offset, ..geometry }));
    let (name, transform) = (String::new(), DMat4::from_translation(offset));
    model.placed.push(Placed { name, geometry: 0, transform });
    model.images = mem::take(&mut context.images);
    model.notes = mem::take(&mut context.notes).finish();
    Ok(model)
}

/// Opacities, which nobody uses: they say something where one is not full.
struct Opacity {
    property: Option<[usize; 1]>,
    /// What stands for full opacity.
    full: [f64; 2],
    is_full: bool,
}

impl Opacity {
    fn new(named: &mut Named<'_>) -> Self {
        let property = named.scalars(&OPACITIES);
        let full = match property.map(|[property]| named.number(property)) {
            Some(Number::F32 | Number::F64) => [1.0, 255.0],
            _ => [255.0, 65535.0],
        };
        Self { property, full, is_full: true }
    }

    fn see(&mut self, row: &Row) {
        self.is_full &=
            self.property.is_none_or(|property| self.full.contains(&row.scalars(property)[0]));
    }

    fn note(self, whose: &str, context: &mut MeshContext<'_>) {
        if !self.is_full {
            context.notes.add(format!("opacities of {whose} were left out"));
        }
    }
}

/// The number of a vertex.
fn vertex(number: f64, what: &str, row: usize) -> Result<u32, String> {
    match number.fract() == 0.0 && number >= 0.0 && number < f64::from(u32::MAX) {
        true => Ok(number as u32),
        false => {
            let rule = format!("{what} {row} has vertices that are whole numbers from 0 on");
            Err(format!("{rule}, and this is {number}"))
        }
    }
}

impl Contents {
    fn read_vertices(
        &mut self,
        element: &Element,
        rows: &mut Rows<'_>,
        context: &mut MeshContext<'_>,
    ) -> Result<(), SceneError> {
        let mut named = Named::new(element);
        let Some(position) = named.scalars(&[["x", "y", "z"]]) else {
            let message = "a vertex has the properties x, y and z, and these lack some";
            return Err(context.error(message));
        };
        let normal = named.scalars(&[["nx", "ny", "nz"]]);
        let color = named.colors(context);
        let coordinate = named.scalars(&COORDINATES);
        let mut opacity = Opacity::new(&mut named);
        named.note_others(context);
        let mut colors = Vec::new();
        rows.read(element, context, |row, _| {
            self.positions.push(row.scalars(position));
            opacity.see(row);
            if let Some(normal) = normal {
                self.normals.push(row.scalars(normal).map(|x| x as f32));
            }
            if let Some((color, _)) = color {
                colors.push(row.scalars(color).map(|x| x as f32));
            }
            if let Some(coordinate) = coordinate {
                let [u, v] = row.scalars(coordinate).map(|x| x as f32);
                self.coordinates.push([u, 1.0 - v]);
            }
            Ok(())
        })?;
        self.colors = color.map(|(_, written)| (written, colors));
        opacity.note("vertices", context);
        Ok(())
    }

    fn read_faces(
        &mut self,
        element: &Element,
        rows: &mut Rows<'_>,
        context: &mut MeshContext<'_>,
    ) -> Result<(), SceneError> {
        let mut named = Named::new(element);
        let Some(vertices) = named.list(&VERTICES) else {
            let message = "a face has the property vertex_indices, and these have none";
            return Err(context.error(message));
        };
        let coordinates = named.list(&["texcoord"]);
        let material = named.scalars(&NUMBERS);
        let color = named.colors(context);
        let mut opacity = Opacity::new(&mut named);
        named.note_others(context);
        let (mut left_out, mut colors) = (0, Vec::new());
        let mut corners = Vec::new();
        rows.read(element, context, |row, number| {
            opacity.see(row);
            corners.clear();
            for &value in row.list(vertices) {
                corners.push(vertex(value, "face", number)?);
            }
            if let Some((color, _)) = color {
                colors.push(row.scalars(color).map(|x| x as f32));
            }
            if corners.len() < 3 {
                left_out += 1;
                return Ok(());
            }
            if let Some(value) = material.map(|material| row.scalars(material)[0]) {
                let value = match value {
                    -1.0 => NO_MATERIAL,
                    value => vertex(value, "face", number).map_err(|_| {
                        let rule = "the number of a material is a whole number from 0 on, or -1";
                        format!("{number}: {rule}, and this is {value}")
                    })?,
                };
                // Faces of another element before have none.
                self.materials.resize(self.faces.len(), NO_MATERIAL);
                self.materials.resize(self.faces.len() + corners.len() - 2, value);
            }
            self.polygons.add(self.faces.len(), corners.len());
            for pair in corners[1..].windows(2) {
                self.faces.push([corners[0], pair[0], pair[1]]);
                if color.is_some() {
                    self.polygon_faces.push([number as u32; 3]);
                }
            }
            let coordinates = coordinates.map_or(&[][..], |property| row.list(property));
            self.add_coordinates(coordinates, corners.len(), number)
        })?;
        self.polygon_colors = color.map(|(_, written)| (written, colors));
        opacity.note("faces", context);
        context.notes.count("a face with fewer than three corners was left out", left_out);
        Ok(())
    }

    /// Adds the coordinates at the corners of a face, if it has some.
    ///
    /// # Errors
    /// The rule that they break.
    fn add_coordinates(
        &mut self,
        coordinates: &[f64],
        corners: usize,
        face: usize,
    ) -> Result<(), String> {
        if coordinates.is_empty() {
            self.has_bare_faces = true;
            return Ok(());
        }
        if coordinates.len() != 2 * corners {
            let rule = format!("face {face} has two coordinates at each of {corners} corners");
            return Err(format!("{rule}, and these are {}", coordinates.len()));
        }
        let row = self.corner_coordinates.len() as u32;
        let rows = coordinates.as_chunks().0.iter();
        self.corner_coordinates.extend(rows.map(|&[u, v]| [u as f32, 1.0 - v as f32]));
        self.corner_faces.extend((1..corners as u32 - 1).map(|k| [row, row + k, row + k + 1]));
        Ok(())
    }

    fn read_strips(
        &mut self,
        element: &Element,
        rows: &mut Rows<'_>,
        context: &mut MeshContext<'_>,
    ) -> Result<(), SceneError> {
        let mut named = Named::new(element);
        let Some(vertices) = named.list(&VERTICES) else {
            let message = "a strip has the property vertex_indices, and these have none";
            return Err(context.error(message));
        };
        named.note_others(context);
        self.has_bare_faces |= element.count > 0;
        rows.read(element, context, |row, number| {
            for strip in row.list(vertices).split(|&vertex| vertex == -1.0) {
                let mut last = [0; 2];
                for (k, &value) in strip.iter().enumerate() {
                    let value = vertex(value, "strip", number)?;
                    let [a, b] = last;
                    // A vertex twice in a row turns a strip or leads on, and is no face.
                    if k >= 2 && a != b && b != value && value != a {
                        self.faces.push(if k % 2 == 0 { [a, b, value] } else { [b, a, value] });
                    }
                    last = [b, value];
                }
            }
            Ok(())
        })
    }

    /// Refuses faces that name vertices beyond the last, cuts polygons, and brings numbers into their form.
    fn finish(&mut self, context: &mut MeshContext<'_>) -> Result<(), SceneError> {
        let count = self.positions.len();
        if let Some(vertex) = self.faces.iter().flatten().find(|&&vertex| vertex as usize >= count)
        {
            let message =
                format!("the file has {count} vertices, and a face names vertex {vertex}");
            return Err(context.error(message));
        }
        if self.has_bare_faces && !self.corner_coordinates.is_empty() {
            context.notes.add("coordinates at corners were left out: not all faces have some");
            self.corner_coordinates.clear();
        }
        let mut faces = vec![&mut self.faces];
        if !self.corner_coordinates.is_empty() {
            faces.push(&mut self.corner_faces);
        }
        self.polygons.cut(&self.positions, &mut faces, &mut context.notes);
        let named = self.faces.iter().flatten().copied();
        self.near = Near::new(&mem::take(&mut self.positions), named, &mut context.notes);

        // Colours at vertices come before those of faces.
        if self.polygon_colors.is_some()
            && (self.colors.is_some() || self.polygon_faces.len() < self.faces.len())
        {
            context
                .notes
                .add("colours of faces were left out: vertices have some, or strips have none");
            self.polygon_colors = None;
        }
        let space = context.options.vertex_color_space.unwrap_or(ColorSpace::Srgb);
        for colors in [&mut self.colors, &mut self.polygon_colors] {
            if let Some((written, rows)) = colors.take() {
                let rows = colors::linear(rows, written, space, &mut context.notes);
                *colors = (!rows.is_empty()).then_some((written, rows));
            }
        }
        Ok(())
    }

    /// The submeshes; `count` is the number of materials.
    fn submeshes(&mut self, count: usize) -> Result<Vec<Submesh>, String> {
        if !self.materials.is_empty() {
            self.materials.resize(self.faces.len(), NO_MATERIAL);
        }
        submeshes(&self.materials, self.faces.len(), count)
    }

    fn raw(&self, submeshes: Vec<Submesh>, is_welded: bool) -> Raw<'_> {
        let faces = || Cow::Borrowed(self.faces.as_slice());
        let at_vertices = Corners { rows: &self.coordinates, faces: faces() };
        let corner_faces = Cow::Borrowed(self.corner_faces.as_slice());
        let at_corners = Corners { rows: &self.corner_coordinates, faces: corner_faces };
        let coordinates = match self.corner_coordinates.is_empty() {
            true => Some(at_vertices).filter(|_| !self.coordinates.is_empty()),
            false => Some(at_corners),
        };
        let vectors = |rows| Corners { rows, faces: faces() };
        let polygon_faces = Cow::Borrowed(self.polygon_faces.as_slice());
        let colors = match (&self.colors, &self.polygon_colors) {
            (Some((_, rows)), _) => Some(vectors(rows)),
            (None, Some((_, rows))) => Some(Corners { rows, faces: polygon_faces }),
            (None, None) => None,
        };
        Raw {
            name: String::new(),
            submeshes,
            is_welded,
            positions: vectors(&self.near.positions),
            colors,
            coordinates,
            normals: (!self.normals.is_empty()).then(|| vectors(&self.normals)),
            tangents: None,
        }
    }
}
