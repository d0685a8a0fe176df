//! Wavefront OBJ with MTL: what [`super::read_model`] reads of it.
//!
//! OBJ has an index for each attribute, so a vertex is written once, and so is a material with its images. A
//! placed geometry is an object, in the world. Colours are fractions encoded by sRGB's curve, and v is up.
//! Roughness and metallic are `Pr` and `Pm`, by the extension of Clara.io, and their images two gray ones.
//!
//! A vertex of OBJ has one colour: of several the last is written. Wrap modes and tangents are left out.

use std::collections::HashSet;
use std::fmt::Write as _;

use bokashi_render_ops::TextureBorder;
use glam::DMat4;

use super::check::{check, check_number, location};
use super::colors::share;
use super::in_world::{NormalTurn, corner_order, points};
use super::obj::NO_MATERIAL;
use crate::error::SceneError;
use crate::model::{Geometry, MaterialFile, MaterialMap, Model, NO_ROW, Placed, Submesh};
use crate::picture::Picture;

/// The files of a model, which lie side by side.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjFiles {
    /// The OBJ.
    pub obj: String,
    /// The MTL, which the OBJ names.
    pub mtl: String,
    /// The images that the MTL names, as PNG, but for those that had a file.
    pub images: Vec<(String, Vec<u8>)>,
}

/// The model as OBJ. `name` is that of its files, without an ending: `NAME.mtl`, and `NAME-1.png` and so on.
/// `image` gives the file of a base colour's image, by its number in the model, where there is one. A name that
/// MTL can't tell from options or from two words is not taken.
///
/// # Errors
/// [`SceneError::Content`] where something names what is not there, a number is not finite, or a geometry has no
/// face. So it is for a `name` without letters or with a line feed, and for an image with samples of 32 bits,
/// which PNG does not have.
pub fn obj(
    model: &Model,
    name: &str,
    image: impl Fn(usize) -> Option<String>,
) -> Result<ObjFiles, SceneError> {
    if name.is_empty() || name.contains(char::is_control) {
        let rule = "the name of an OBJ has letters and no line feed";
        return Err(SceneError::content(location(), format!("{rule}, and this is {name:?}")));
    }
    let mut files =
        ObjFiles { obj: format!("mtllib {name}.mtl\n"), mtl: String::new(), images: Vec::new() };
    let materials = names(&model.materials);
    for (material, material_name) in model.materials.iter().zip(&materials) {
        let file = material.base_color_map.image.and_then(&image).filter(|file| is_word(file));
        files.add_material(model, (material, material_name), name, file)?;
    }
    // How many rows of positions, coordinates and normals there are before.
    let mut firsts = [1; 3];
    for (number, placed) in model.placed.iter().enumerate() {
        check_number("geometry", placed.geometry, model.geometries.len())?;
        files.add_object(model, &materials, number, &mut firsts)?;
    }
    Ok(files)
}

/// Whether programs that read MTL take the name of a file for one word, and for no option.
pub(crate) fn is_word(file: &str) -> bool {
    let is_odd = |c: char| c.is_whitespace() || c.is_control() || "#\\\"".contains(c);
    !file.is_empty() && !file.starts_with('-') && !file.contains(is_odd)
}

/// A name that fits into a line: its own, or else its number.
fn one_line(name: &str, number: usize) -> String {
    match name.trim().is_empty() || name.contains(char::is_control) {
        true => (number + 1).to_string(),
        false => name.trim().to_owned(),
    }
}

/// Names of materials, each its own.
fn names(materials: &[MaterialFile]) -> Vec<String> {
    let mut seen = HashSet::new();
    let unique = materials.iter().enumerate().map(|(number, material)| {
        let mut name = one_line(&material.name, number);
        while !seen.insert(name.clone()) {
            name = format!("{name}-{}", number + 1);
        }
        name
    });
    unique.collect()
}

impl ObjFiles {
    /// Adds a material, to files that are called `name`. `file` has the image of its base colour already.
    fn add_material(
        &mut self,
        model: &Model,
        (material, material_name): (&MaterialFile, &str),
        name: &str,
        file: Option<String>,
    ) -> Result<(), SceneError> {
        let MaterialFile { base_color: [red, green, blue, opacity], roughness, metallic, .. } =
            material;
        let mut image = |picture: &Picture| {
            let file = format!("{name}-{}.png", self.images.len() + 1);
            self.images.push((file.clone(), picture.encode_png(&location())?));
            Ok::<_, SceneError>(file)
        };
        // The image of a map, and its options. MTL has no mirrored images, and one border for both axes.
        let picture_of = |map: &MaterialMap| {
            let Some(number) = map.image else { return Ok(None) };
            check_number("image", number, model.images.len())?;
            let is_clamped = map.borders == [TextureBorder::Clamp; 2];
            let clamp = if is_clamped { "-clamp on " } else { "" };
            Ok::<_, SceneError>(Some((&model.images[number], clamp)))
        };
        let mut text = format!("newmtl {material_name}\n");
        // Writing to a string cannot fail.
        let _ =
            writeln!(text, "Kd {red} {green} {blue}\nd {opacity}\nPr {roughness}\nPm {metallic}");
        if let Some((picture, clamp)) = picture_of(&material.base_color_map)? {
            let file = file.map_or_else(|| image(picture), Ok)?;
            let _ = writeln!(text, "map_Kd {clamp}{file}");
        }
        if let Some((picture, clamp)) = picture_of(&material.metallic_roughness_map)? {
            for (key, channel) in [("map_Pr", 1), ("map_Pm", 2)] {
                let _ = writeln!(text, "{key} {clamp}{}", image(&gray(picture, channel))?);
            }
        }
        if let Some((picture, clamp)) = picture_of(&material.normal_map)? {
            let _ = writeln!(text, "norm {clamp}-bm {} {}", material.normal_scale, image(picture)?);
        }
        self.mtl.push_str(&text);
        Ok(())
    }

    /// Adds a placed geometry. `firsts` has the numbers of the next rows of positions, coordinates and normals.
    fn add_object(
        &mut self,
        model: &Model,
        materials: &[String],
        number: usize,
        firsts: &mut [usize; 3],
    ) -> Result<(), SceneError> {
        let Placed { name, geometry, transform } = &model.placed[number];
        let geometry = &model.geometries[*geometry];
        check(geometry)?;
        let _ = writeln!(self.obj, "o {}", one_line(name, number));
        self.add_rows(geometry, transform)?;
        let corners = corner_order(transform);
        for submesh in &geometry.submeshes {
            let name = match submesh.material {
                None => NO_MATERIAL,
                Some(material) => {
                    check_number("material", material, materials.len())?;
                    &materials[material]
                }
            };
            // It holds until the next one, through objects.
            let _ = writeln!(self.obj, "usemtl {name}");
            self.add_faces(geometry, submesh, corners, firsts);
        }
        let counts = [
            geometry.positions.len(),
            geometry.coordinates.as_ref().map_or(0, |indexed| indexed.rows.len()),
            geometry.normals.as_ref().map_or(0, |indexed| indexed.rows.len()),
        ];
        firsts.iter_mut().zip(counts).for_each(|(first, count)| *first += count);
        Ok(())
    }

    /// Adds positions with colours, coordinates and normals, in the world.
    fn add_rows(&mut self, geometry: &Geometry, transform: &DMat4) -> Result<(), SceneError> {
        let points = points(geometry, transform)?;
        let text = &mut self.obj;
        // A vertex of OBJ has one colour.
        let mut colors = vec![None; geometry.positions.len()];
        if let Some(rows) = &geometry.colors {
            let corners = geometry.faces.as_flattened().iter().zip(rows.faces.as_flattened());
            for (&vertex, &row) in corners.filter(|(_, row)| **row != NO_ROW) {
                colors[vertex as usize] = Some(rows.rows[row as usize]);
            }
        }
        for ((near, point), color) in geometry.positions.iter().zip(&points).zip(colors) {
            let _ = match *transform == DMat4::IDENTITY {
                // As many digits as give the same bits again.
                true => write!(text, "v {} {} {}", near[0], near[1], near[2]),
                false => write!(text, "v {} {} {}", point.x, point.y, point.z),
            };
            if let Some(color) = color {
                let [red, green, blue] = color.map(share);
                let _ = write!(text, " {red} {green} {blue}");
            }
            text.push('\n');
        }
        for [u, v] in geometry.coordinates.iter().flat_map(|coordinates| &coordinates.rows) {
            let _ = writeln!(text, "vt {u} {}", 1.0 - v);
        }
        let turn = NormalTurn::new(transform);
        for &normal in geometry.normals.iter().flat_map(|normals| &normals.rows) {
            let [x, y, z] = turn.turned(normal);
            let _ = match turn.is_none() {
                true => writeln!(text, "vn {} {} {}", normal[0], normal[1], normal[2]),
                false => writeln!(text, "vn {x} {y} {z}"),
            };
        }
        Ok(())
    }

    /// Adds the faces of a submesh, their corners in this order.
    fn add_faces(
        &mut self,
        geometry: &Geometry,
        submesh: &Submesh,
        corners: [usize; 3],
        firsts: &[usize; 3],
    ) {
        let coordinates = geometry.coordinates.as_ref().filter(|uv| uv.covers(&submesh.faces));
        let normals = geometry.normals.as_ref().filter(|rows| rows.covers(&submesh.faces));
        let all = [
            Some(&geometry.faces),
            coordinates.map(|indexed| &indexed.faces),
            normals.map(|indexed| &indexed.faces),
        ];
        for face in submesh.faces.clone() {
            self.obj.push('f');
            for corner in corners {
                let number = |kind: usize| {
                    let row = all[kind].map(|faces| faces[face][corner] as usize);
                    row.map_or(String::new(), |row| (firsts[kind] + row).to_string())
                };
                let [vertex, coordinate, normal] = [0, 1, 2].map(number);
                let numbers = format!("{vertex}/{coordinate}/{normal}");
                let _ = write!(self.obj, " {}", numbers.trim_end_matches('/'));
            }
            self.obj.push('\n');
        }
    }
}

/// A channel of a picture as a gray one; of a gray one that channel.
fn gray(picture: &Picture, channel: usize) -> Picture {
    let Picture { width, height, channels, .. } = *picture;
    let channel = if channels < 3 { 0 } else { channel };
    let samples = picture.samples.picked((0..width * height).map(|k| k * channels + channel));
    Picture { width, height, channels: 1, samples }
}
