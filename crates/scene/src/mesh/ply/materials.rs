//! Materials of PLY files, and which faces have which.
//!
//! - The comments `TextureFile` name images of base colours, as MeshLab writes them. Where there is no element
//!   `material`, each is a material, and `texnumber` of a face is its number.
//! - Rows of the element `material` are materials: `diffuse_red`, `diffuse_green` and `diffuse_blue`, or the same
//!   without `diffuse_`, as colours at vertices; `roughness` and `metallic`; and `texnumber`, the number of a
//!   comment's image, or -1. `material_index` of a face is the number of a row, or -1. Our own files are so; the
//!   names are Turk's, beside the two of glTF.

use super::header::{Element, Header};
use super::rows::{Named, Rows};
use crate::error::SceneError;
use crate::mesh::colors;
use crate::mesh::context::MeshContext;
use crate::model::{MaterialFile, MaterialMap, Submesh};
use crate::picture::ColorSpace;

/// Stands for a face without a material.
pub(super) const NO_MATERIAL: u32 = u32::MAX;

/// The names of what says which material a face has.
pub(super) const NUMBERS: [[&str; 1]; 2] = [["material_index"], ["texnumber"]];

/// A row of the element `material`.
#[derive(Debug, Clone, Copy)]
struct Described {
    color: [f32; 3],
    roughness: f32,
    metallic: f32,
    image: Option<usize>,
}

/// The materials of a file.
#[derive(Debug, Default)]
pub(super) struct Materials {
    rows: Option<Vec<Described>>,
}

impl Materials {
    /// Reads the element `material`.
    pub(super) fn read(
        &mut self,
        element: &Element,
        rows: &mut Rows<'_>,
        context: &mut MeshContext<'_>,
    ) -> Result<(), SceneError> {
        let mut named = Named::new(element);
        let color = named.colors(context);
        let [roughness, metallic, image] =
            ["roughness", "metallic", "texnumber"].map(|value| named.scalars(&[[value]]));
        named.note_others(context);
        let (mut rows_read, mut colors) = (Vec::new(), Vec::new());
        rows.read(element, context, |row, number| {
            let share =
                |value: Option<[usize; 1]>, what, usual| match value.map(|k| row.scalars(k)[0]) {
                    None => Ok(usual),
                    Some(value) if (0.0..=1.0).contains(&value) => Ok(value as f32),
                    Some(value) => Err(format!(
                        "material {number} has {what} from 0 to 1, and this is {value}"
                    )),
                };
            colors.extend(color.map(|(value, _)| row.scalars(value).map(|x| x as f32)));
            rows_read.push(Described {
                color: [1.0; 3],
                roughness: share(roughness, "roughness", 1.0)?,
                metallic: share(metallic, "metallic", 0.0)?,
                image: image
                    .map(|k| row.scalars(k)[0])
                    .filter(|&value| value >= 0.0)
                    .map(|k| k as usize),
            });
            Ok(())
        })?;
        if let Some((_, written)) = color {
            let linear = colors::linear(colors, written, ColorSpace::Srgb, &mut context.notes);
            for (value, color) in rows_read.iter_mut().zip(linear) {
                value.color = color;
            }
        }
        self.rows = Some(rows_read);
        Ok(())
    }

    /// The materials for a model, with the images that the header names.
    pub(super) fn finish(
        self,
        header: &Header,
        context: &mut MeshContext<'_>,
    ) -> Result<Vec<MaterialFile>, SceneError> {
        let mut images = Vec::with_capacity(header.images.len());
        for file in &header.images {
            images.push(context.image(file)?);
        }
        let Some(rows) = self.rows else {
            let material = |image| MaterialFile {
                base_color_map: base_color_map(image, true),
                metallic: 0.0,
                ..MaterialFile::default()
            };
            return Ok(images.into_iter().map(material).collect());
        };
        let material = |(number, row): (usize, Described)| {
            let Described { color: [red, green, blue], roughness, metallic, image } = row;
            let map = match image.map(|image| images.get(image)) {
                None => None,
                Some(Some(map)) => *map,
                Some(None) => {
                    let count = images.len();
                    let rule = format!("the file names {count} images, and material {number} has");
                    let message = format!("{rule} number {}", image.unwrap_or_default());
                    return Err(context.error(message));
                }
            };
            Ok(MaterialFile {
                base_color: [red, green, blue, 1.0],
                base_color_map: base_color_map(map, image.is_some()),
                metallic,
                roughness,
                ..MaterialFile::default()
            })
        };
        rows.into_iter().enumerate().map(material).collect()
    }
}

/// A base colour's map, whose image the file names or not.
fn base_color_map(image: Option<usize>, is_named: bool) -> MaterialMap {
    MaterialMap { image, is_missing: is_named && image.is_none(), ..MaterialMap::default() }
}

/// The submeshes of faces: those of one material in a row. `numbers` has the material of each face; where it is empty
/// all faces have the first of `count` materials.
///
/// # Errors
/// The rule that a number breaks.
pub(super) fn submeshes(
    numbers: &[u32],
    faces: usize,
    count: usize,
) -> Result<Vec<Submesh>, String> {
    if numbers.is_empty() {
        return Ok(vec![Submesh { material: (count > 0).then_some(0), faces: 0..faces }]);
    }
    let is_beyond = |&&number: &&u32| number != NO_MATERIAL && number as usize >= count;
    if let Some(number) = numbers.iter().find(is_beyond) {
        let rule = format!("the file has {count} materials, numbered from 0 on");
        return Err(format!("{rule}, and a face names number {number}"));
    }
    let mut end = 0;
    let runs = numbers.chunk_by(|a, b| a == b).map(|faces| {
        let begin = end;
        end += faces.len();
        let material = (faces[0] != NO_MATERIAL).then_some(faces[0] as usize);
        Submesh { material, faces: begin..end }
    });
    Ok(runs.collect())
}
