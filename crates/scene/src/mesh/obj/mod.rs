//! Wavefront OBJ.
//!
//! # What is read
//! - `v` with three numbers, with a fourth that divides them, or with a colour: `v x y z r g b`, which becomes
//!   light as in [`colors`](crate::mesh::colors).
//! - `vt u v`. v is **up** in OBJ: 1 - v is the coordinate here.
//! - `vn`, and `f` with `v`, `v/t`, `v//n` or `v/t/n` at each corner. Numbers count from 1, and negative
//!   ones back from the latest. A polygon becomes triangles as in [`polygons`](crate::mesh::polygons).
//! - `o`, `usemtl` and `mtllib`. The faces of an object are a mesh, of one material or several. Objects that
//!   share vertices are one mesh, since some programs write an object per material. Groups (`g`) are not told
//!   apart: they would tear a surface into parts that move by themselves.
//! - A backslash at the end of a line continues it.
//!
//! Colours, coordinates or normals that some corners of a mesh lack are left out, and so are points, lines,
//! curves, surfaces, smoothing groups and statements that are unknown: a note says so. Materials are those
//! of [`materials`].
//!
//! # Why no library reads it
//! tobj 4.0 has no line numbers in errors, gives a corner without a coordinate its neighbour's, shifts
//! colours where only some vertices have one, and panics for some numbers of corners. All of that would have
//! to be read once more before. The tests compare with it.
//!
//! # Source
//! Wavefront Technologies, Advanced Visualizer, appendix B1, Object files.

mod maps;
mod materials;
mod parts;
mod statements;

use glam::DMat4;

pub(super) use self::materials::NO_MATERIAL;
use self::parts::Parts;
use self::statements::text;
use crate::error::SceneError;
use crate::mesh::context::MeshContext;
use crate::mesh::weld::Welder;
use crate::model::{Geometry, MaterialFile, Model, Placed};
use crate::picture::Picture;

/// The model of an OBJ file with these bytes.
pub(super) fn read(bytes: &[u8], context: &mut MeshContext<'_>) -> Result<Model, SceneError> {
    let parts = Parts::read(&text(bytes, &context.location())?, context)?;
    let (materials, numbers) = materials::read(&parts.libraries, &parts.materials, context)?;
    let (mut welder, mut model) = (Welder::default(), Model { materials, ..Model::default() });
    let location = context.location();
    // Vertices have numbers, so that no seam needs several of them.
    let is_welded = context.options.weld.unwrap_or(false);
    for surface in parts.surfaces(&mut context.notes) {
        let raw = parts.raw(&surface, &numbers, is_welded, &mut context.notes);
        if let Some(geometry) = welder.weld(raw, &location, &mut context.notes)? {
            let offset = parts.near.offset;
            let (name, transform) = (geometry.name.clone(), DMat4::from_translation(offset));
            model.placed.push(Placed { name, geometry: model.geometries.len(), transform });
            model.geometries.push(Geometry { offset, ..geometry });
        }
    }
    keep_used_images(&mut model, std::mem::take(&mut context.images));
    model.notes = std::mem::take(&mut context.notes).finish();
    Ok(model)
}

/// Gives the model those of these images that its materials use: of images that became a part of another
/// one nothing is left.
fn keep_used_images(model: &mut Model, images: Vec<Picture>) {
    let mut numbers = vec![None; images.len()];
    let used = model.materials.iter().flat_map(MaterialFile::images);
    used.for_each(|number| numbers[number] = Some(0));
    for (number, image) in images.into_iter().enumerate() {
        if numbers[number].is_some() {
            numbers[number] = Some(model.images.len());
            model.images.push(image);
        }
    }
    for material in &mut model.materials {
        let MaterialFile { base_color_map, metallic_roughness_map, normal_map, .. } = material;
        for map in [base_color_map, metallic_roughness_map, normal_map] {
            map.image = map.image.and_then(|number| numbers[number]);
        }
    }
}
