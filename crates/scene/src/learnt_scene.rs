//! What a fit has learnt, put back into its scene; and a scene's objects as a model for a file.

use std::collections::HashMap;

use bokashi_core::Tensor;
use bokashi_fit::Parameters;

use crate::cameras::NamedView;
use crate::error::SceneError;
use crate::learnables::TABLE;
use crate::model::{Geometry, Indexed, MaterialFile, MaterialMap, Model, NO_ROW, Placed, Submesh};
use crate::object::{Attribute, Object, SurfaceMap, SurfaceMaterial};
use crate::picture::{ColorSpace, Picture, Samples};
use crate::renderer::Renderer;
use crate::scene::Scene;

impl Renderer {
    /// The scene with the values of `parameters` in the place of its own.
    ///
    /// # Errors
    /// Those of a parameter that is no number of the scene: none, where a fit of the scene made them.
    pub(crate) fn with_values(&self, parameters: &Parameters<f32>) -> Result<Scene, SceneError> {
        let mut scene = self.scene().clone();
        let value = |name: &str| parameters.value(name).ok();
        for row in TABLE {
            row.put(&mut scene, self.frame(), value)?;
        }
        Ok(scene)
    }
}

impl Scene {
    /// The objects with their materials, for [`glb`](crate::glb), [`obj`](crate::obj()) and [`ply`](crate::ply).
    /// Where vertices are learnt, normals and tangents are left out: whoever shows the mesh makes them of its faces.
    ///
    /// # Errors
    /// None: those of images without pixels.
    pub fn model(&self) -> Result<Model, SceneError> {
        let mut model = Model::default();
        for (index, object) in self.objects.iter().enumerate() {
            // Materials of one name are one.
            let mut numbers = HashMap::new();
            for material in &object.materials {
                if !numbers.contains_key(material.name.as_str()) {
                    numbers.insert(material.name.as_str(), model.materials.len());
                    let name =
                        if object.materials.len() > 1 { &material.name } else { &object.name };
                    model.materials.push(material.to_file(name, &mut model.images)?);
                }
            }
            // Those of the file were of the surface as it was.
            let keeps = !self.learns_vertices(object);
            model.geometries.push(object.geometry(&numbers, keeps));
            model.placed.extend(object.places.iter().map(|&transform| Placed {
                name: object.name.clone(),
                geometry: index,
                transform,
            }));
        }
        Ok(model)
    }

    /// The views that have an image, with their cameras, for
    /// [`transforms_json`](crate::transforms_json).
    pub fn cameras(&self) -> Vec<NamedView> {
        let views = self.views.iter().filter_map(|view| {
            let image = view.image.clone()?;
            let (name, mask) = (view.name.clone(), view.mask.clone());
            Some(NamedView { name, image, mask, camera: view.camera })
        });
        views.collect()
    }
}

impl Object {
    /// The geometry; `materials` has the numbers of its materials by name. `keeps_normals` keeps normals and tangents.
    fn geometry(&self, materials: &HashMap<&str, usize>, keeps_normals: bool) -> Geometry {
        let submeshes = self.materials.iter().map(|material| Submesh {
            material: materials.get(material.name.as_str()).copied(),
            faces: material.faces.clone(),
        });
        Geometry {
            name: self.name.clone(),
            positions: rows(&self.positions),
            offset: self.offset,
            faces: self.mesh.faces().to_vec(),
            colors: self.colors.as_ref().map(indexed),
            coordinates: self.coordinates.as_ref().map(indexed),
            normals: self.normals.as_ref().filter(|_| keeps_normals).map(indexed),
            tangents: self.tangents.as_ref().filter(|_| keeps_normals).map(indexed),
            submeshes: submeshes.collect(),
        }
    }
}

impl SurfaceMaterial {
    fn to_file(&self, name: &str, images: &mut Vec<Picture>) -> Result<MaterialFile, SceneError> {
        let mut add = |map: &SurfaceMap, picture: Option<Picture>| {
            let image = picture.map(|picture| {
                images.push(picture);
                images.len() - 1
            });
            MaterialMap { image, borders: map.borders, is_missing: false }
        };
        let bytes = |texels: &Tensor<f32>, samples: Vec<u8>| {
            let [height, width] = [texels.shape()[0], texels.shape()[1]];
            Picture { width, height, channels: 3, samples: Samples::U8(samples) }
        };
        let Self { texture, roughness_metallic, normal_map, .. } = self;
        let color = texture.texels.as_ref();
        let [red, green, blue] = if color.is_some() { [1.0; 3] } else { self.base_color };
        let color =
            color.map(|texels| Picture::from_color(texels, ColorSpace::Srgb)).transpose()?;
        let base_color_map = add(texture, color);
        let maps = roughness_metallic.texels.as_ref().map(|maps| {
            let byte = |x: f32| (255.0 * x.clamp(0.0, 1.0)).round() as u8;
            let texels = maps.data().chunks_exact(2);
            bytes(maps, texels.flat_map(|texel| [0, byte(texel[0]), byte(texel[1])]).collect())
        });
        let [metallic, roughness] =
            if maps.is_some() { [1.0; 2] } else { [self.metallic, self.roughness] };
        let metallic_roughness_map = add(roughness_metallic, maps);
        let normals = normal_map.texels.as_ref().map(|map| {
            let byte = |x: f32| (127.5 * (x.clamp(-1.0, 1.0) + 1.0)).round() as u8;
            bytes(map, map.data().iter().map(|&x| byte(x)).collect())
        });
        Ok(MaterialFile {
            name: name.to_owned(),
            base_color: [red, green, blue, 1.0],
            base_color_map,
            metallic,
            roughness,
            metallic_roughness_map,
            normal_map: add(normal_map, normals),
            normal_scale: 1.0,
        })
    }
}

fn rows<const N: usize>(rows: &Tensor<f32>) -> Vec<[f32; N]> {
    rows.data().chunks_exact(N).map(|row| std::array::from_fn(|k| row[k])).collect()
}

fn indexed<const N: usize>(attribute: &Attribute) -> Indexed<N> {
    let rows = rows(&attribute.rows);
    let row = |row: u32| if row as usize == rows.len() { NO_ROW } else { row };
    let faces = attribute.indices.faces().iter().map(|face| face.map(row)).collect();
    Indexed { rows, faces }
}
