//! A mesh of a scene as the engine takes it: tensors and index buffers, where it stands, and what it is made of,
//! one material or several.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

use bokashi_core::{Tape, Tensor, TensorError, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{Mesh, TextureBorder};
use glam::{DMat4, DVec3};

use crate::error::SceneError;
use crate::field::{Field, FieldSurface};
use crate::file_names::is_file_name;
use crate::model::{
    Borders, Geometry, Indexed, MaterialFile, MaterialMap, Model, NO_ROW, Submesh, covers,
};
use crate::picture::{ColorSpace, Picture};

/// Numbers at corners of faces: `[A, C]`, and which of them each corner has.
#[derive(Debug, Clone)]
pub struct Attribute {
    /// The numbers.
    pub rows: Tensor<f32>,
    /// As many faces as the object's mesh. Those of a material that has none name a row beyond the last, row A.
    pub indices: Mesh,
}

/// A map of a material.
#[derive(Debug, Clone, Default)]
pub struct SurfaceMap {
    /// Its texels, `[H, W, C]`.
    pub texels: Option<Tensor<f32>>,
    /// How it goes on beyond its edges.
    pub borders: Borders,
    /// Whether its file names an image that was left out: it is missing, or can't be read.
    pub is_missing: bool,
    /// Where the fit made it: what lies between its charts.
    pub(crate) gutters: Option<Gutters>,
}

/// What lies between the charts of a texture, and how far apart they are.
#[derive(Debug, Clone)]
pub(crate) struct Gutters {
    /// The texel that each is a copy of, row by row: itself, where some face shows it.
    pub(crate) sources: Arc<[u32]>,
    /// The coarsest level of detail that keeps charts apart.
    pub(crate) levels: usize,
}

impl Gutters {
    /// The texels `[S, S, C]`, each a copy of its source.
    ///
    /// # Errors
    /// [`TensorError`] for a texture of another size.
    pub(crate) fn filled<'t>(&self, texels: Var<'t, f32>) -> Result<Var<'t, f32>, TensorError> {
        let shape = texels.shape();
        let rows = texels.reshape([shape[0] * shape[1], shape[2]])?;
        rows.gather_rows(&self.sources)?.reshape(&shape[..])
    }
}

/// What a surface is made of. A map stands in the place of its number, which it was multiplied by.
#[derive(Debug, Clone, Default)]
pub struct SurfaceMaterial {
    /// What parameters and results call it, where its object has several.
    pub name: String,
    /// The faces that have it: they follow those of the material before.
    pub faces: Range<usize>,
    /// A linear colour.
    pub base_color: [f32; 3],
    /// Base colours `[H, W, 3]`, linear.
    pub texture: SurfaceMap,
    /// From 0 to 1.
    pub roughness: f32,
    /// From 0 to 1.
    pub metallic: f32,
    /// Roughness and metallic, `[H, W, 2]`.
    pub roughness_metallic: SurfaceMap,
    /// Vectors in tangent space, `[H, W, 3]`.
    pub normal_map: SurfaceMap,
}

/// A mesh and where it stands.
#[derive(Debug, Clone)]
pub struct Object {
    /// What parameters and results call it.
    pub name: String,
    /// Its faces.
    pub mesh: Mesh,
    /// Vertices `[V, 3]`, in its own coordinates.
    pub positions: Tensor<f32>,
    /// What was taken off the positions of its file. Its places have it.
    pub offset: DVec3,
    /// Linear colours, `[A, 3]`.
    pub colors: Option<Attribute>,
    /// Texture coordinates, `[A, 2]`, each at one vertex.
    pub coordinates: Option<Attribute>,
    /// Unit normals of the file, `[A, 3]`. Where vertices are learnt, normals follow from the faces, and these say
    /// which corners share one.
    pub normals: Option<Attribute>,
    /// Unit tangents of the file and signs of bitangents, `[A, 4]`. Without them, and where vertices are
    /// learnt, tangents follow from the coordinates.
    pub tangents: Option<Attribute>,
    /// From its own coordinates to the world's, once for each instance.
    pub places: Vec<DMat4>,
    /// What its faces are made of: one for each of its materials, or one.
    pub materials: Vec<SurfaceMaterial>,
    /// The field whose surface it is, as long as that is learnt.
    pub(crate) field: Option<Field>,
}

impl Attribute {
    /// Whether these faces have the attribute.
    pub fn covers(&self, faces: &Range<usize>) -> bool {
        let first = self.indices.faces().get(faces.start);
        first.is_some_and(|face| (face[0] as usize) < self.rows.shape()[0])
    }

    /// Whether some faces have none.
    pub(crate) fn has_gaps(&self) -> bool {
        self.indices.vertex_count() > self.rows.shape()[0]
    }
}

impl Object {
    /// The texture coordinates, where something is looked up by them.
    pub(crate) fn coordinates_of_maps(&self) -> Option<&Attribute> {
        self.coordinates.as_ref().filter(|_| self.materials.iter().any(SurfaceMaterial::has_maps))
    }

    /// The number of a face's material.
    pub(crate) fn material_of(&self, face: usize) -> usize {
        self.materials.partition_point(|material| material.faces.end <= face)
    }

    /// What parameters and results call a material: the object, and where it has several the material's name, too.
    pub(crate) fn material_name(&self, material: &SurfaceMaterial) -> String {
        match self.materials.len() {
            0 | 1 => self.name.clone(),
            _ => format!("{}/{}", self.name, material.name),
        }
    }

    /// The object of a geometry of `model`.
    ///
    /// # Errors
    /// [`SceneError::Render`] for a face that names a vertex that is not there.
    pub(crate) fn from_geometry(
        name: String,
        geometry: &Geometry,
        model: &Model,
        places: Vec<DMat4>,
    ) -> Result<Self, SceneError> {
        let mesh = Mesh::new(geometry.faces.clone(), geometry.positions.len())?;
        let coordinates = geometry.coordinates.as_ref();
        let coordinates =
            coordinates.map(|coordinates| split_at_vertices(coordinates, &geometry.faces));
        // Faces of one material of the file are one to whoever learns it, whatever else they carry.
        let (mut names, mut of_kinds) = (HashSet::new(), HashMap::new());
        let materials = geometry.submeshes.iter().enumerate().map(|(k, submesh)| {
            let material = SurfaceMaterial::from_submesh(submesh, geometry, model);
            let kind =
                (submesh.material, material.has_maps(), material.base_color.map(f32::to_bits));
            if let Some(name) = of_kinds.get(&kind).cloned() {
                return SurfaceMaterial { name, ..material };
            }
            let number = (k + 1).to_string();
            let mut name =
                if is_file_name(&material.name) { material.name.clone() } else { number.clone() };
            while !names.insert(name.clone()) {
                name = format!("{name}-{number}");
            }
            of_kinds.insert(kind, name.clone());
            SurfaceMaterial { name, ..material }
        });
        Ok(Self {
            name,
            positions: rows(&geometry.positions),
            offset: geometry.offset,
            colors: geometry.colors.as_ref().map(attribute).transpose()?,
            coordinates: coordinates.as_ref().map(attribute).transpose()?,
            normals: geometry.normals.as_ref().map(attribute).transpose()?,
            tangents: geometry.tangents.as_ref().map(attribute).transpose()?,
            mesh,
            places,
            materials: materials.collect(),
            field: None,
        })
    }

    /// Gives each vertex a colour, that of its material: where materials meet, one for each.
    ///
    /// # Errors
    /// [`SceneError::Render`] for too many of them.
    pub(crate) fn color_vertices(&mut self) -> Result<(), SceneError> {
        let (mut colors, mut faces) = (Vec::new(), Vec::with_capacity(self.mesh.faces().len()));
        for material in &mut self.materials {
            // A texture is multiplied by them.
            let color =
                if material.texture.texels.is_some() { [1.0; 3] } else { material.base_color };
            material.base_color = [1.0; 3];
            let corners = &self.mesh.faces()[material.faces.clone()];
            let mut rows = vec![NO_ROW; self.mesh.vertex_count()];
            corners.as_flattened().iter().for_each(|&vertex| rows[vertex as usize] = 0);
            for row in rows.iter_mut().filter(|row| **row != NO_ROW) {
                *row = colors.len() as u32;
                colors.push(color);
            }
            faces.extend(corners.iter().map(|face| face.map(|vertex| rows[vertex as usize])));
        }
        let indices = Mesh::new(faces, colors.len())?;
        self.colors = Some(Attribute { rows: rows(&colors), indices });
        Ok(())
    }

    /// Why it can't have another surface, in words.
    pub(crate) fn fixed(&self) -> Option<&'static str> {
        if self.materials.len() > 1 {
            Some("has several materials")
        } else if self.coordinates_of_maps().is_some() {
            Some("has textures")
        } else if self.colors.is_some() && self.colors_of_vertices().is_none() {
            Some("has vertices with several colours, or with none")
        } else {
            None
        }
    }

    /// Which row of its colours each vertex has; a vertex without a face has the first. `None` where one has several.
    pub(crate) fn colors_of_vertices(&self) -> Option<Vec<u32>> {
        let colors = self.colors.as_ref()?;
        let mut rows = vec![NO_ROW; self.mesh.vertex_count()];
        let corners = self.mesh.faces().as_flattened().iter();
        for (&vertex, &row) in corners.zip(colors.indices.faces().as_flattened()) {
            let own = &mut rows[vertex as usize];
            if ![NO_ROW, row].contains(own) || row as usize >= colors.rows.shape()[0] {
                return None;
            }
            *own = row;
        }
        rows.iter_mut().filter(|row| **row == NO_ROW).for_each(|row| *row = 0);
        (colors.rows.shape()[0] > 0).then_some(rows)
    }

    /// Gives an object that is not [fixed](Self::fixed) another surface: positions `[V, 3]`, and colours `[V, 3]` if
    /// it has some.
    pub(crate) fn set_surface(
        &mut self,
        mesh: Mesh,
        positions: Tensor<f32>,
        colors: Option<Tensor<f32>>,
    ) {
        self.colors = colors.map(|rows| Attribute { rows, indices: mesh.clone() });
        self.materials.iter_mut().for_each(|material| material.faces = 0..mesh.faces().len());
        (self.coordinates, self.normals, self.tangents) = (None, None, None);
        (self.mesh, self.positions) = (mesh, positions);
    }

    /// Gives an object that is not [fixed](Self::fixed) a texture in the place of its colours.
    pub(crate) fn set_texture(
        &mut self,
        coordinates: Attribute,
        texels: Tensor<f32>,
        gutters: Gutters,
    ) {
        (self.colors, self.tangents) = (None, None);
        self.coordinates = Some(coordinates);
        let (borders, gutters) = ([TextureBorder::Clamp; 2], Some(gutters));
        for material in &mut self.materials {
            let gutters = gutters.clone();
            material.base_color = [1.0; 3];
            material.texture =
                SurfaceMap { texels: Some(texels.clone()), borders, is_missing: false, gutters };
        }
    }

    /// Makes the object, which is not [fixed](Self::fixed), the surface of a field that starts from its own surface.
    ///
    /// # Errors
    /// [`SceneError::Mesh`] for a field that has no surface, of a mesh thinner than the cells.
    pub(crate) fn grow_field(&mut self, cells: usize, smoothing: usize) -> Result<(), SceneError> {
        let colors = self.colors_of_vertices().zip(self.colors.as_ref()).map(|(rows, colors)| {
            Tensor::from_fn([rows.len(), 3], |[k, axis]| colors.rows[[rows[k] as usize, axis]])
        });
        let field =
            Field::from_surface(&self.positions, &self.mesh, colors.as_ref(), cells, smoothing)?;
        let values = field.values.clone();
        self.field = Some(field);
        Ok(self.set_field(&values)?)
    }

    /// Gives the object's field other values, and the object the field's surface.
    ///
    /// # Errors
    /// Those of a field without a surface.
    pub(crate) fn set_field(&mut self, values: &Tensor<f32>) -> Result<(), FitError> {
        let Some(mut field) = self.field.take() else { return Ok(()) };
        field.values = values.clone();
        let tape = Tape::new();
        let colors = field.colors.as_ref().map(|colors| tape.constant(colors));
        let surface = field.surface(tape.constant(values), colors, &self.name)?;
        let FieldSurface { mesh, positions, colors, .. } = surface;
        self.set_surface(mesh, positions.value(), colors.map(|colors| colors.value()));
        self.field = Some(field);
        Ok(())
    }

    /// The least and the largest coordinates in the world; `None` without vertices.
    pub(crate) fn extent(&self) -> Option<[DVec3; 2]> {
        bounds(self.places.iter().flat_map(|m| self.points().map(|p| m.transform_point3(p))))
    }

    /// Half the diagonal of its extent in its own coordinates; 1 where that is 0.
    pub(crate) fn radius(&self) -> f64 {
        match bounds(self.points()).map(|[least, largest]| 0.5 * least.distance(largest)) {
            Some(radius) if radius > 0.0 => radius,
            _ => 1.0,
        }
    }

    /// Its vertices, in its own coordinates.
    pub(crate) fn points(&self) -> impl Iterator<Item = DVec3> + Clone {
        let points = self.positions.data().chunks_exact(3);
        points.map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()))
    }
}

impl SurfaceMaterial {
    /// A rough dielectric of half the light.
    pub(crate) fn plain() -> Self {
        Self { base_color: [0.5; 3], roughness: 1.0, ..Self::default() }
    }

    /// Its maps.
    fn maps(&mut self) -> [&mut SurfaceMap; 3] {
        [&mut self.texture, &mut self.roughness_metallic, &mut self.normal_map]
    }

    /// Whether anything is looked up by texture coordinates.
    pub(crate) fn has_maps(&self) -> bool {
        let maps = [&self.texture, &self.roughness_metallic, &self.normal_map];
        maps.iter().any(|map| map.texels.is_some())
    }

    /// The map of roughness, channel 0, or metallic, channel 1: `[H, W, 1]`.
    pub(crate) fn roughness_metallic_map(&self, channel: usize) -> Option<Tensor<f32>> {
        let maps = self.roughness_metallic.texels.as_ref()?;
        let [height, width] = [maps.shape()[0], maps.shape()[1]];
        Some(Tensor::from_flat_fn([height, width, 1], |k| maps.data()[2 * k + channel]))
    }

    fn from_submesh(submesh: &Submesh, geometry: &Geometry, model: &Model) -> Self {
        let faces = submesh.faces.clone();
        let mut material = match submesh.material.and_then(|k| model.materials.get(k)) {
            Some(material) => Self::from_file(material, &model.images),
            // Colours stand for themselves.
            None if covers(&geometry.colors, &faces) => {
                Self { base_color: [1.0; 3], ..Self::plain() }
            }
            None => Self::plain(),
        };
        if !covers(&geometry.coordinates, &faces) {
            // Maps are looked up by texture coordinates.
            material.maps().into_iter().for_each(|map| map.texels = None);
        }
        Self { faces, ..material }
    }

    /// The texels that [`SurfaceMaterial::from_file`] makes.
    pub(crate) fn texels_of_file(material: &MaterialFile, images: &[Picture]) -> u64 {
        let images = material.images().filter_map(|k| images.get(k));
        images.map(|image| image.pixels() as u64).sum()
    }

    fn from_file(material: &MaterialFile, images: &[Picture]) -> Self {
        let map = |map: MaterialMap, texels: &dyn Fn(&Picture) -> Tensor<f32>| {
            let MaterialMap { image, borders, is_missing } = map;
            let texels = image.and_then(|k| images.get(k)).map(texels);
            SurfaceMap { texels, borders, is_missing, gutters: None }
        };
        let [red, green, blue, _] = material.base_color;
        let base_color = [red, green, blue];
        let MaterialFile { roughness, metallic, .. } = *material;
        Self {
            name: material.name.clone(),
            faces: 0..0,
            base_color,
            texture: map(material.base_color_map, &|image| {
                // Texels of light: factors are linear, and so are means of texels.
                let texels = image.color(ColorSpace::Srgb);
                Tensor::from_flat_fn(texels.shape(), |k| texels.data()[k] * base_color[k % 3])
            }),
            roughness,
            metallic,
            roughness_metallic: map(material.metallic_roughness_map, &|image| {
                let (maps, factors) = ([image.primary(1), image.primary(2)], [roughness, metallic]);
                Tensor::from_flat_fn([image.height, image.width, 2], |k| {
                    maps[k % 2].data()[k / 2] * factors[k % 2]
                })
            }),
            normal_map: map(material.normal_map, &|image| vectors(image, material.normal_scale)),
        }
    }
}

/// The least and the largest coordinates of some points.
fn bounds(points: impl Iterator<Item = DVec3>) -> Option<[DVec3; 2]> {
    points.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
}

/// The vectors of a normal map `[H, W, 3]`, x and y times `scale`.
pub(crate) fn vectors(image: &Picture, scale: f32) -> Tensor<f32> {
    let texels = image.color(ColorSpace::Linear);
    let factors = [scale, scale, 1.0];
    Tensor::from_flat_fn(texels.shape(), |k| (2.0 * texels.data()[k] - 1.0) * factors[k % 3])
}

fn rows<const N: usize>(rows: &[[f32; N]]) -> Tensor<f32> {
    Tensor::from(rows)
}

fn attribute<const N: usize>(indexed: &Indexed<N>) -> Result<Attribute, SceneError> {
    let count = indexed.rows.len();
    let mut faces = indexed.faces.clone();
    let gaps = faces.as_flattened_mut().iter_mut().filter(|row| **row == NO_ROW);
    let gaps = gaps.map(|row| *row = count as u32).count();
    let indices = Mesh::new(faces, count + usize::from(gaps > 0))?;
    Ok(Attribute { rows: rows(&indexed.rows), indices })
}

/// The same numbers, none of them at two vertices: tangents of a vertex need coordinates of its own.
fn split_at_vertices<const N: usize>(indexed: &Indexed<N>, faces: &[[u32; 3]]) -> Indexed<N> {
    let (mut seen, mut rows) = (HashMap::new(), Vec::new());
    let corners = faces.iter().zip(&indexed.faces).map(|(vertices, indices)| {
        [0, 1, 2].map(|corner| match indices[corner] {
            NO_ROW => NO_ROW,
            row => *seen.entry((vertices[corner], row)).or_insert_with(|| {
                rows.push(indexed.rows[row as usize]);
                rows.len() as u32 - 1
            }),
        })
    });
    let faces = corners.collect();
    Indexed { rows, faces }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Samples;
    use crate::shapes;

    fn picture(bytes: [u8; 3]) -> Picture {
        Picture { width: 1, height: 1, channels: 3, samples: Samples::U8(bytes.to_vec()) }
    }

    fn map(image: usize) -> MaterialMap {
        MaterialMap { image: Some(image), ..MaterialMap::default() }
    }

    #[test]
    fn coordinates_at_two_vertices_become_two() {
        let indexed =
            Indexed { rows: vec![[0.0, 0.0], [1.0, 1.0]], faces: vec![[0, 0, 1], [1, 0, 0]] };
        let found = split_at_vertices(&indexed, &[[0, 1, 2], [2, 1, 3]]);
        assert_eq!(found.rows.len(), 4);
        assert_eq!(found.faces, [[0, 1, 2], [2, 1, 3]]);
    }

    #[test]
    fn maps_are_multiplied_by_their_factors_as_light() {
        let images = vec![picture([255, 0, 188]), picture([0, 128, 255])];
        let material = MaterialFile {
            base_color: [0.5, 1.0, 1.0, 1.0],
            base_color_map: map(0),
            metallic: 0.5,
            roughness: 1.0,
            metallic_roughness_map: map(1),
            normal_map: map(1),
            normal_scale: 2.0,
            ..MaterialFile::default()
        };
        let model = Model { images, materials: vec![material], ..Model::default() };
        let submeshes = vec![Submesh { material: Some(0), faces: 0..2 }];
        let geometry = Geometry { submeshes, ..shapes::plane(2) };
        let mut object = Object::from_geometry("a".to_owned(), &geometry, &model, vec![]).unwrap();
        let material = object.materials.remove(0);
        let texture = material.texture.texels.unwrap();
        approx::assert_abs_diff_eq!(texture.data(), &[0.5, 0.0, 0.5029][..], epsilon = 1e-4);
        let map = material.roughness_metallic.texels.unwrap();
        approx::assert_abs_diff_eq!(map.data(), &[0.50196, 0.5][..], epsilon = 1e-5);
        let normals = material.normal_map.texels.unwrap();
        approx::assert_abs_diff_eq!(normals.data(), &[-2.0, 0.00784, 1.0][..], epsilon = 1e-4);
    }

    #[test]
    fn gray_is_red_green_and_blue() {
        let material = |channels: usize, bytes: &[u8]| {
            let samples = Samples::U8(bytes.to_vec());
            let images = vec![Picture { width: 1, height: 2, channels, samples }];
            let material =
                MaterialFile { metallic_roughness_map: map(0), ..MaterialFile::default() };
            SurfaceMaterial::from_file(&material, &images).roughness_metallic.texels.unwrap()
        };
        let expected = material(3, &[77, 77, 77, 9, 9, 9]);
        assert_eq!(expected.data(), [77.0, 77.0, 9.0, 9.0].map(|x: f32| x / 255.0));
        assert_eq!(material(1, &[77, 9]), expected);
        assert_eq!(material(2, &[77, 0, 9, 255]), expected);
        assert_eq!(material(4, &[0, 77, 77, 1, 255, 9, 9, 2]), expected);
    }

    #[test]
    fn the_extent_is_that_of_all_instances() {
        let places = [0.0, 3.0].map(|x| DMat4::from_translation(DVec3::new(x, 0.0, 0.0)));
        let (name, model) = ("a".to_owned(), Model::default());
        let object =
            Object::from_geometry(name, &shapes::cube(12), &model, places.to_vec()).unwrap();
        assert_eq!(object.extent(), Some([DVec3::NEG_ONE, DVec3::new(4.0, 1.0, 1.0)]));
    }
}
