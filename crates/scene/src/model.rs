//! What a mesh file holds, whatever its format.

use std::ops::Range;

use bokashi_render_ops::TextureBorder;
use glam::{DMat4, DVec3};

use crate::picture::Picture;

/// Stands in the place of a row at the corners of a submesh that lacks the attribute.
pub const NO_ROW: u32 = u32::MAX;

/// Positions are far from the origin where the largest coordinate is so many times their extent: `f32` would lose
/// 4 bits.
const FAR: f64 = 16.0;

/// What is taken off positions between these bounds, so that `f32` holds them: nothing where they are near the
/// origin, else their middle, rounded to whole numbers that `f32` has. Formats with matrices of `f32` then have it,
/// too.
pub(crate) fn far_offset([least, most]: [DVec3; 2]) -> DVec3 {
    let middle = (0.5 * (least + most)).as_vec3().round().as_dvec3();
    // What is not finite is refused later.
    let is_finite = [least, most, middle].iter().all(|row| row.is_finite());
    if is_finite && is_far([least, most]) { middle } else { DVec3::ZERO }
}

/// Whether `f32` would lose bits of positions between these bounds.
pub(crate) fn is_far([least, most]: [DVec3; 2]) -> bool {
    let largest = least.abs().max(most.abs()).max_element();
    largest > FAR * (most - least).max_element()
}

/// How an image goes on beyond its edges: along u and along v.
pub type Borders = [TextureBorder; 2];

/// Numbers at the corners of faces, with an index buffer of their own: where a texture has a seam, a
/// vertex has several. The corners of a submesh have all of them a row, or all of them [`NO_ROW`].
#[derive(Debug, Clone, PartialEq)]
pub struct Indexed<const N: usize> {
    /// The numbers, each once.
    pub rows: Vec<[f32; N]>,
    /// For each face the rows at its corners.
    pub faces: Vec<[u32; 3]>,
}

/// Faces of a geometry with one material.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Submesh {
    /// Its number among the materials of the model.
    pub material: Option<usize>,
    /// The faces: they follow those of the submesh before.
    pub faces: Range<usize>,
}

/// A surface with one set of vertices, of one material or several.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Its name in the file; may be empty.
    pub name: String,
    /// Positions, in its own coordinates.
    pub positions: Vec<[f32; 3]>,
    /// What was taken off the positions of a file, since `f32` would lose bits of them far from the origin.
    /// [`Placed::transform`] has it, too.
    pub offset: DVec3,
    /// Vertices of each face, counter-clockwise seen from outside.
    pub faces: Vec<[u32; 3]>,
    /// Linear colours.
    pub colors: Option<Indexed<3>>,
    /// Texture coordinates, v **down** from row 0 of the texture, as in glTF.
    pub coordinates: Option<Indexed<2>>,
    /// Unit normals.
    pub normals: Option<Indexed<3>>,
    /// Unit tangents, along which u grows, and the sign of the bitangent, 1 or -1, as in glTF.
    pub tangents: Option<Indexed<4>>,
    /// Which faces have which material: all of them, in their order.
    pub submeshes: Vec<Submesh>,
}

impl<const N: usize> Indexed<N> {
    /// Whether the corners of these faces have a row.
    pub fn covers(&self, faces: &Range<usize>) -> bool {
        self.faces.get(faces.start).is_some_and(|face| face[0] != NO_ROW)
    }
}

/// Whether the corners of these faces have a row of an attribute that a geometry may lack.
pub(crate) fn covers<const N: usize>(attribute: &Option<Indexed<N>>, faces: &Range<usize>) -> bool {
    attribute.as_ref().is_some_and(|indexed| indexed.covers(faces))
}

impl Geometry {
    /// The materials of its faces, in their order; `None` where faces have none.
    pub fn materials(&self) -> impl Iterator<Item = Option<usize>> {
        self.submeshes.iter().map(|submesh| submesh.material)
    }

    /// The submesh of a face.
    pub fn submesh(&self, face: usize) -> Option<&Submesh> {
        let next = self.submeshes.partition_point(|submesh| submesh.faces.end <= face);
        self.submeshes.get(next).filter(|submesh| submesh.faces.contains(&face))
    }
}

/// An image of a material, and how it goes on.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct MaterialMap {
    /// The image's number.
    pub image: Option<usize>,
    /// How it goes on.
    pub borders: Borders,
    /// Whether the file names an image that was left out: it is missing, or can't be read.
    pub is_missing: bool,
}

impl MaterialMap {
    /// The map of an image.
    pub fn new(image: usize, borders: Borders) -> Self {
        Self { image: Some(image), borders, is_missing: false }
    }
}

/// What a surface is made of, as in glTF.
#[derive(Debug, Clone, PartialEq)]
pub struct MaterialFile {
    /// Its name in the file; may be empty.
    pub name: String,
    /// Linear colour and opacity, times the image.
    pub base_color: [f32; 4],
    /// sRGB colours.
    pub base_color_map: MaterialMap,
    /// 0 for dielectrics, 1 for metals.
    pub metallic: f32,
    /// Perceptual roughness from 0 to 1.
    pub roughness: f32,
    /// Roughness in green and metallic in blue.
    pub metallic_roughness_map: MaterialMap,
    /// A normal map.
    pub normal_map: MaterialMap,
    /// What x and y of the normal map are multiplied by.
    pub normal_scale: f32,
}

impl MaterialFile {
    /// The images that are looked up by texture coordinates.
    pub fn images(&self) -> impl Iterator<Item = usize> {
        let maps = [self.base_color_map, self.metallic_roughness_map, self.normal_map];
        maps.into_iter().filter_map(|map| map.image)
    }
}

impl Default for MaterialFile {
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: [1.0; 4],
            base_color_map: MaterialMap::default(),
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_map: MaterialMap::default(),
            normal_map: MaterialMap::default(),
            normal_scale: 1.0,
        }
    }
}

/// A geometry in the world. Several may share the geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    /// Its name in the file; may be empty.
    pub name: String,
    /// The geometry's number.
    pub geometry: usize,
    /// From its own coordinates to the world's. Where its determinant is negative it mirrors, and faces are
    /// clockwise seen from outside.
    pub transform: DMat4,
}

/// All that a mesh file holds and a scene can use.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Model {
    /// Meshes, each once.
    pub geometries: Vec<Geometry>,
    /// Materials.
    pub materials: Vec<MaterialFile>,
    /// The materials' images, each once, as their files have them: nothing is decoded.
    pub images: Vec<Picture>,
    /// Where the meshes stand.
    pub placed: Vec<Placed>,
    /// What the file holds that was left out or mended, in words.
    pub notes: Vec<String>,
}

impl Model {
    /// For each geometry the matrices that lead from its coordinates to the world's, in the order of
    /// [`Model::placed`].
    pub fn places(&self) -> Vec<Vec<DMat4>> {
        let mut places = vec![Vec::new(); self.geometries.len()];
        for placed in &self.placed {
            if let Some(transforms) = places.get_mut(placed.geometry) {
                transforms.push(placed.transform);
            }
        }
        places
    }
}
