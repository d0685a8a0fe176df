//! A mesh of a scene as the engine takes it: tensors and index buffers.

use std::collections::HashMap;

use bokashi_core::Tensor;
use bokashi_render_ops::Mesh;
use glam::{DMat4, DVec3};

use crate::error::SceneError;
use crate::model::{Geometry, Indexed, MaterialFile, Model};
use crate::picture::{ColorSpace, Picture};

/// Numbers at corners of faces: `[A, C]`, and which of them each corner has.
#[derive(Debug, Clone)]
pub struct Attribute {
    /// The numbers.
    pub rows: Tensor<f32>,
    /// As many faces as the object's mesh.
    pub indices: Mesh,
}

/// What a surface is made of. A map stands in the place of its number, which it was multiplied by.
#[derive(Debug, Clone)]
pub struct SurfaceLook {
    /// A linear colour.
    pub base_color: [f32; 3],
    /// Base colours `[H, W, 3]`, linear.
    pub texture: Option<Tensor<f32>>,
    /// From 0 to 1.
    pub roughness: f32,
    /// From 0 to 1.
    pub metallic: f32,
    /// Roughness and metallic, `[H, W, 2]`.
    pub roughness_metallic: Option<Tensor<f32>>,
    /// Vectors in tangent space, `[H, W, 3]`.
    pub normal_map: Option<Tensor<f32>>,
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
    /// Linear colours, `[A, 3]`.
    pub colors: Option<Attribute>,
    /// Texture coordinates, `[A, 2]`, each at one vertex.
    pub coordinates: Option<Attribute>,
    /// Unit normals of the file, `[A, 3]`: they hold as long as vertices stay where they are.
    pub normals: Option<Attribute>,
    /// From its own coordinates to the world's, once for each instance.
    pub places: Vec<DMat4>,
    /// What it is made of.
    pub look: SurfaceLook,
}

impl Object {
    /// The texture coordinates, where something is looked up by them.
    pub(crate) fn coordinates_of_maps(&self) -> Option<&Attribute> {
        self.coordinates.as_ref().filter(|_| self.look.has_maps())
    }

    /// The object of a geometry of `model`.
    ///
    /// # Errors
    /// [`SceneError::Render`] for a face that names a vertex that is not there.
    pub(crate) fn of_geometry(
        name: String,
        geometry: &Geometry,
        model: &Model,
        places: Vec<DMat4>,
    ) -> Result<Self, SceneError> {
        let mesh = Mesh::new(geometry.faces.clone(), geometry.positions.len())?;
        let coordinates = geometry.coordinates.as_ref();
        let coordinates = coordinates.map(|own| of_vertices(own, &geometry.faces));
        let material = geometry.material.and_then(|k| model.materials.get(k));
        let look = match material {
            Some(material) => SurfaceLook::of_file(material, &model.images),
            // Colours stand for themselves.
            None if geometry.colors.is_some() => {
                SurfaceLook { base_color: [1.0; 3], ..SurfaceLook::plain() }
            }
            None => SurfaceLook::plain(),
        };
        Ok(Self {
            name,
            positions: rows(&geometry.positions),
            colors: geometry.colors.as_ref().map(attribute).transpose()?,
            coordinates: coordinates.as_ref().map(attribute).transpose()?,
            normals: geometry.normals.as_ref().map(attribute).transpose()?,
            mesh,
            places,
            // Maps are looked up by texture coordinates.
            look: if geometry.coordinates.is_some() { look } else { look.without_maps() },
        })
    }

    /// The least and the largest coordinates in the world; `None` without vertices.
    pub(crate) fn extent(&self) -> Option<[DVec3; 2]> {
        let points = self.positions.data().chunks_exact(3);
        let points = points.map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()));
        let all = self.places.iter().flat_map(|m| points.clone().map(|p| m.transform_point3(p)));
        all.map(|p| [p, p]).reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
    }
}

impl SurfaceLook {
    /// A rough dielectric of half the light.
    pub(crate) fn plain() -> Self {
        Self {
            base_color: [0.5; 3],
            texture: None,
            roughness: 1.0,
            metallic: 0.0,
            roughness_metallic: None,
            normal_map: None,
        }
    }

    /// The numbers without the maps.
    fn without_maps(self) -> Self {
        Self { texture: None, roughness_metallic: None, normal_map: None, ..self }
    }

    /// Whether anything is looked up by texture coordinates.
    fn has_maps(&self) -> bool {
        self.texture.is_some() || self.roughness_metallic.is_some() || self.normal_map.is_some()
    }

    /// The map of roughness, channel 0, or metallic, channel 1: `[H, W, 1]`.
    pub(crate) fn roughness_metallic_map(&self, channel: usize) -> Option<Tensor<f32>> {
        let maps = self.roughness_metallic.as_ref()?;
        let [height, width] = [maps.shape()[0], maps.shape()[1]];
        Some(Tensor::from_flat_fn([height, width, 1], |k| maps.data()[2 * k + channel]))
    }

    fn of_file(material: &MaterialFile, images: &[Picture]) -> Self {
        let image = |k: Option<usize>| k.and_then(|k| images.get(k));
        let [red, green, blue, _] = material.base_color;
        let base_color = [red, green, blue];
        let color = image(material.base_color_image).map(|image| {
            // Texels of light: factors are linear, and so are means of texels.
            let texels = image.color(ColorSpace::Srgb);
            Tensor::from_flat_fn(texels.shape(), |k| texels.data()[k] * base_color[k % 3])
        });
        let roughness_metallic = image(material.metallic_roughness_image).and_then(|image| {
            let [green, blue] = [image.channel(1)?, image.channel(2)?];
            let factors = [material.roughness, material.metallic];
            let maps = [green, blue];
            Some(Tensor::from_flat_fn([image.height, image.width, 2], |k| {
                maps[k % 2].data()[k / 2] * factors[k % 2]
            }))
        });
        let normal_map = image(material.normal_image);
        let normal_map = normal_map.map(|image| vectors(image, material.normal_scale));
        Self {
            base_color,
            texture: color,
            roughness: material.roughness,
            metallic: material.metallic,
            roughness_metallic,
            normal_map,
        }
    }
}

/// The vectors of a normal map `[H, W, 3]`, x and y times `scale`.
pub(crate) fn vectors(image: &Picture, scale: f32) -> Tensor<f32> {
    let texels = image.color(ColorSpace::Linear);
    let factors = [scale, scale, 1.0];
    Tensor::from_flat_fn(texels.shape(), |k| (2.0 * texels.data()[k] - 1.0) * factors[k % 3])
}

fn rows<const N: usize>(rows: &[[f32; N]]) -> Tensor<f32> {
    let flat = rows.as_flattened();
    Tensor::from_flat_fn([rows.len(), N], |k| flat[k])
}

fn attribute<const N: usize>(own: &Indexed<N>) -> Result<Attribute, SceneError> {
    Ok(Attribute { rows: rows(&own.rows), indices: Mesh::new(own.faces.clone(), own.rows.len())? })
}

/// The same numbers, none of them at two vertices: tangents of a vertex need coordinates of its own.
fn of_vertices<const N: usize>(own: &Indexed<N>, faces: &[[u32; 3]]) -> Indexed<N> {
    let (mut seen, mut rows) = (HashMap::new(), Vec::new());
    let corners = faces.iter().zip(&own.faces).map(|(vertices, indices)| {
        [0, 1, 2].map(|corner| {
            *seen.entry((vertices[corner], indices[corner])).or_insert_with(|| {
                rows.push(own.rows[indices[corner] as usize]);
                rows.len() as u32 - 1
            })
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

    #[test]
    fn coordinates_at_two_vertices_become_two() {
        let own = Indexed { rows: vec![[0.0, 0.0], [1.0, 1.0]], faces: vec![[0, 0, 1], [1, 0, 0]] };
        let found = of_vertices(&own, &[[0, 1, 2], [2, 1, 3]]);
        assert_eq!(found.rows.len(), 4);
        assert_eq!(found.faces, [[0, 1, 2], [2, 1, 3]]);
    }

    #[test]
    fn maps_are_multiplied_by_their_factors_as_light() {
        let images = vec![picture([255, 0, 188]), picture([0, 128, 255])];
        let material = MaterialFile {
            base_color: [0.5, 1.0, 1.0, 1.0],
            base_color_image: Some(0),
            metallic: 0.5,
            roughness: 1.0,
            metallic_roughness_image: Some(1),
            normal_image: Some(1),
            normal_scale: 2.0,
            ..MaterialFile::default()
        };
        let model = Model { images, materials: vec![material], ..Model::default() };
        let geometry = Geometry { material: Some(0), ..shapes::plane(2) };
        let object = Object::of_geometry("a".to_owned(), &geometry, &model, vec![]).unwrap();
        let look = object.look;
        let texture = look.texture.unwrap();
        approx::assert_abs_diff_eq!(texture.data(), &[0.5, 0.0, 0.5029][..], epsilon = 1e-4);
        let map = look.roughness_metallic.unwrap();
        approx::assert_abs_diff_eq!(map.data(), &[0.50196, 0.5][..], epsilon = 1e-5);
        let normals = look.normal_map.unwrap();
        approx::assert_abs_diff_eq!(normals.data(), &[-2.0, 0.00784, 1.0][..], epsilon = 1e-4);
    }

    #[test]
    fn the_extent_is_that_of_all_instances() {
        let places = [0.0, 3.0].map(|x| DMat4::from_translation(DVec3::new(x, 0.0, 0.0)));
        let (name, model) = ("a".to_owned(), Model::default());
        let object = Object::of_geometry(name, &shapes::cube(12), &model, places.to_vec()).unwrap();
        assert_eq!(object.extent(), Some([DVec3::NEG_ONE, DVec3::new(4.0, 1.0, 1.0)]));
    }
}
