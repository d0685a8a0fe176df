//! Scenes with meshes that are surfaces of learnt fields: what draws them as the fields are in a step.

use std::sync::Arc;

use bokashi_fit::{FitError, Variables};
use bokashi_render_ops::camera::to_tensor;
use bokashi_render_ops::transform_points;

use super::drawing::Renderer;
use super::parts::Parts;
use crate::error::SceneError;
use crate::field::FieldSurface;
use crate::learnables::{COLORS, FIELD, Learnable, POSE, VERTICES, Values};
use crate::scene::Scene;

/// What the variable of a mesh's field at the points of its grid is called, as its surface has it.
pub(crate) fn field_name(object: &str) -> String {
    format!("smooth_field/{object}")
}

/// What draws surfaces of fields in a step.
pub(crate) struct OnSurfaces<'t> {
    /// Another renderer, where the faces are others than those that the renderer has.
    pub(crate) renderer: Option<Renderer>,
    /// The variables at the vertices of the surfaces, in the place of those at the points of the fields.
    pub(crate) variables: Variables<'t, f32>,
}

/// A point of a field in an image.
pub(crate) struct SeenPoint {
    /// Its index in the grid.
    pub(crate) point: usize,
    /// Its pixel, row-major.
    pub(crate) pixel: usize,
    /// How many pixels long an edge of its cell is.
    pub(crate) extent: f32,
}

impl Renderer {
    /// What draws the surfaces of fields as `values` have them; `None` where nothing is learnt of a field.
    ///
    /// # Errors
    /// Those of a field that has no surface.
    pub(crate) fn on_surfaces<'t>(
        &self,
        values: &Values<'t, '_>,
    ) -> Result<Option<OnSurfaces<'t>>, FitError> {
        let Some(variables) = values.learnt else { return Ok(None) };
        let mut scene: Option<Scene> = None;
        let mut all = None;
        for (index, object) in self.scene().objects.iter().enumerate() {
            let Some(field) = &object.field else { continue };
            let learnt = |row| values.learnt(row, &object.name);
            let is_there = variables.get(&field_name(&object.name)).is_ok();
            if is_there || learnt(&FIELD).or(learnt(&COLORS)).is_none() {
                continue;
            }
            let name = |row: &Learnable| row.parameter_name(&object.name);
            let numbers = values.tensor(&FIELD, &object.name, &field.values);
            let colors = field.colors.as_ref();
            let colors = colors.map(|fixed| values.tensor(&COLORS, &object.name, fixed));
            let surface = field.surface(numbers, colors, &object.name)?;
            let FieldSurface { mesh, positions, colors, field: smooth } = surface;
            let others = all.take().unwrap_or_else(|| variables.clone());
            let others = others.without(&name(&FIELD)).without(&name(&COLORS));
            let others = others.with(name(&VERTICES), positions);
            let others = others.with(field_name(&object.name), smooth);
            all = Some(match colors {
                Some(colors) => others.with(name(&COLORS), colors),
                None => others,
            });
            if mesh.faces() != object.mesh.faces() {
                let scene = scene.get_or_insert_with(|| self.scene().clone());
                let object = &mut scene.objects[index];
                let colors = colors.map(|colors| colors.value());
                object.set_surface(mesh, positions.value(), colors);
            }
        }
        let renderer = scene.map(|scene| self.of_other_meshes(scene));
        let renderer = renderer.transpose().map_err(FitError::operation)?;
        Ok(all.map(|variables| OnSurfaces { renderer, variables }))
    }

    /// Where a view, made smaller `reduce` times, sees the points of an object's field, once for each of its places;
    /// those beyond the image, and those that are too near to be drawn, are left out.
    pub(crate) fn seen_points(
        &self,
        values: &Values<'_, '_>,
        view: usize,
        reduce: usize,
        object: usize,
    ) -> Result<Vec<SeenPoint>, FitError> {
        let Some(field) = &self.scene().objects[object].field else { return Ok(Vec::new()) };
        let camera = self.view_camera(view, reduce);
        let step_camera = camera.in_step(values)?;
        let [width, height] = [camera.camera.size.width, camera.camera.size.height];
        let focal = camera.camera.intrinsics[0].abs() as f32;
        let half = [0.5 * height as f32, 0.5 * width as f32];
        let near = self.frame().near as f32;
        let points = values.tape.constant(&field.grid.positions());
        let pose = values.learnt(&POSE, &self.scene().objects[object].name);
        let mut all = Vec::new();
        for (part, place) in self.parts().places_of(object) {
            let matrix = match pose {
                Some(pose) => self.frame().object_pivot(part).moved(pose, place)?,
                None => values.tape.constant(&to_tensor(place)),
            };
            let spacing = (field.grid.spacing() * place.determinant().abs().cbrt()) as f32;
            let clip = step_camera.clip(transform_points(points, matrix)?)?.value();
            for (point, &[x, y, _, w]) in clip.data().as_chunks::<4>().0.iter().enumerate() {
                let [row, column] = [half[0] * (1.0 - y / w), half[1] * (1.0 + x / w)];
                if w >= near && row >= 0.0 && column >= 0.0 {
                    let (row, column) = (row as usize, column as usize);
                    if row < height && column < width {
                        let extent = focal * spacing / w;
                        all.push(SeenPoint { point, pixel: row * width + column, extent });
                    }
                }
            }
        }
        Ok(all)
    }

    /// What draws the scene, which has other meshes than before.
    fn of_other_meshes(&self, scene: Scene) -> Result<Self, SceneError> {
        Self::with_lighting(Arc::new(scene), self.frame().clone(), self.lighting())
    }
}

impl Parts {
    /// Where an object stands, each of its places with the object's index.
    fn places_of(&self, object: usize) -> impl Iterator<Item = (usize, &glam::DMat4)> {
        let parts = self.all.iter().filter(move |part| part.object == object);
        parts.flat_map(|part| part.places.iter().map(|place| (part.object, place)))
    }
}
