//! Surfaces that a fit has changed: taken from its scene to be saved, and put into the scene when it is resumed.

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_mesh::TexelMap;
use bokashi_render_ops::Mesh;

use super::remeshing::learnt_objects;
use crate::error::SceneError;
use crate::learnables::FIELD;
use crate::object::{Attribute, Gutters, Object};
use crate::saved_fit::{Shape, Surface, TexturedSurface};
use crate::scene::Scene;

fn wrong(rule: &str, value: String) -> SceneError {
    FitError::saved(rule.to_owned(), value).into()
}

fn rows<const N: usize>(tensor: &Tensor<f32>) -> Vec<[f32; N]> {
    tensor.data().as_chunks::<N>().0.to_vec()
}

impl Surface {
    /// The changed surfaces of a scene: of objects whose vertices are learnt if any was `remeshed`, of objects that had
    /// a field, and of those that got a texture.
    ///
    /// # Errors
    /// Those of names of meshes that are not there; no scene of a fit has one.
    pub(super) fn all(scene: &Scene, remeshed: bool) -> Result<Vec<Self>, SceneError> {
        let mut changed = if remeshed { learnt_objects(scene)? } else { Vec::new() };
        if let Some(entry) = &scene.description.learn.field {
            let chosen = FIELD.chosen(scene, entry.meshes.as_deref())?;
            changed.extend(chosen.into_iter().filter(|(k, _)| scene.objects[*k].field.is_none()));
        }
        let surface = |(index, object): (usize, &Object)| {
            let has_shape = changed.iter().any(|(learnt, _)| *learnt == index);
            let shape = has_shape.then(|| Shape::from_object(object));
            let texture = TexturedSurface::from_object(object);
            let is_changed = shape.is_some() || texture.is_some();
            is_changed.then(|| Self { object: object.name.clone(), shape, texture })
        };
        Ok(scene.objects.iter().enumerate().filter_map(surface).collect())
    }

    /// Puts the surface into a scene.
    ///
    /// # Errors
    /// [`FitError::Saved`] for an object that is not there, or for faces, positions, colours and coordinates that do
    /// not fit.
    pub(super) fn put(&self, scene: &mut Scene) -> Result<(), SceneError> {
        let index = scene.objects.iter().position(|own| own.name == self.object);
        let Some(index) = index else {
            let value = format!("that of {:?}", self.object);
            return Err(wrong("surfaces of the scene's meshes", value));
        };
        if let Some(reason) = scene.objects[index].fixed() {
            let rule = format!("the mesh {:?} as it was, which can be changed", self.object);
            return Err(wrong(&rule, format!("one that {reason}")));
        }
        if let Some(shape) = &self.shape {
            shape.put(&mut scene.objects[index])?;
        }
        let Some(texture) = &self.texture else { return Ok(()) };
        if !scene.gives_texture(&scene.objects[index]) {
            let rule = format!("a stage that gives {:?} a texture, as it has one", self.object);
            return Err(wrong(&rule, "none".to_owned()));
        }
        let size = scene.description.stages.iter().find_map(|stage| stage.texture);
        let size = size.map_or(1, |texture| texture.size.0);
        texture.put(&mut scene.objects[index], size)
    }
}

impl Shape {
    fn from_object(Object { mesh, positions, colors, .. }: &Object) -> Self {
        let colors = colors.as_ref().map_or(Vec::new(), |colors| rows(&colors.rows));
        Self { faces: mesh.faces().to_vec(), positions: rows(positions), colors }
    }

    fn put(&self, object: &mut Object) -> Result<(), SceneError> {
        let Self { faces, positions, colors } = self;
        let count = positions.len();
        if !colors.is_empty() && colors.len() != count {
            let rule = format!("a colour for each of {count} vertices");
            return Err(wrong(&rule, colors.len().to_string()));
        }
        let tensor = |rows: &[[f32; 3]]| Tensor::from(rows);
        let colors = (!colors.is_empty()).then(|| tensor(colors));
        object.set_surface(Mesh::new(faces.clone(), count)?, tensor(positions), colors);
        object.field = None;
        Ok(())
    }
}

impl TexturedSurface {
    fn from_object(object: &Object) -> Option<Self> {
        let gutters = object.materials.first()?.texture.gutters.as_ref()?;
        let Attribute { rows: coordinates, indices } = object.coordinates.as_ref()?;
        let corners = indices.faces().to_vec();
        Some(Self { coordinates: rows(coordinates), corners, levels: gutters.levels })
    }

    fn put(&self, object: &mut Object, size: usize) -> Result<(), SceneError> {
        let Self { coordinates, corners, levels } = self;
        if corners.len() != object.mesh.faces().len() {
            let rule = format!("texture coordinates of {} faces", object.mesh.faces().len());
            return Err(wrong(&rule, corners.len().to_string()));
        }
        let coordinates = Attribute {
            rows: Tensor::from(&coordinates[..]),
            indices: Mesh::new(corners.clone(), coordinates.len())?,
        };
        let map = TexelMap::new(&coordinates.rows, &coordinates.indices, size)?;
        let gutters = Gutters { sources: map.sources().clone(), levels: *levels };
        // What was learnt takes their place.
        object.set_texture(coordinates, Tensor::zeros([size, size, 3]), gutters);
        Ok(())
    }
}
