//! Meshes that get other vertices and faces in the middle of a fit.
//!
//! What is learnt at vertices, and the optimizer's moments of it, is carried over to the new ones. Measures of the
//! scene stay those of its start, so that learnt motions mean the same.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_mesh::{DerivedMesh, MeshError, RemeshOptions, remesh, surface_area};
use bokashi_render_ops::Mesh;

use crate::description::{Remesh, Stage};
use crate::error::{Location, SceneError};
use crate::learnables::{COLORS, FIELD, Learnable, VERTICES};
use crate::memory::OF_FACE;
use crate::object::Object;
use crate::saved_fit::Surface;
use crate::scene::Scene;

/// New vertices of objects, by the names of their parameters.
pub(super) type Carried = HashMap<String, Carry>;

/// What carries numbers over to the new vertices of an object.
pub(super) struct Carry {
    derived: Arc<DerivedMesh<f32>>,
    /// Where the numbers are not at vertices: the row that each vertex has.
    rows: Option<Vec<u32>>,
}

impl Carry {
    /// The numbers at the new vertices, `[W, C]`.
    ///
    /// # Errors
    /// [`MeshError`] for another number of rows than there were.
    pub(super) fn carried(&self, old: &Tensor<f32>) -> Result<Tensor<f32>, MeshError> {
        let Some(rows) = &self.rows else { return self.derived.carry(old) };
        let columns = old.shape()[1];
        let at_vertices = Tensor::from_fn([rows.len(), columns], |[vertex, column]| {
            old[[rows[vertex] as usize, column]]
        });
        self.derived.carry(&at_vertices)
    }
}

/// How many times more faces than equal edges make there are at most: edges are split down to two thirds of their length.
const MOST_SPLIT: f64 = 4.0;

/// The objects whose vertices are learnt: their indices and names.
pub(super) fn learnt_objects(scene: &Scene) -> Result<Vec<(usize, String)>, SceneError> {
    let Some(entry) = &scene.description.learn.vertices else { return Ok(Vec::new()) };
    VERTICES.chosen(scene, entry.meshes.as_deref())
}

/// Checks that the meshes of a scene can get other vertices, if one of `stages` asks for it.
///
/// # Errors
/// [`SceneError::Content`].
pub(super) fn check_remeshing(scene: &Scene, stages: &[Stage]) -> Result<(), SceneError> {
    if stages.iter().all(|stage| stage.remesh.is_none()) {
        return Ok(());
    }
    let wrong = |message: String| Err(SceneError::content(Location::new(&scene.path), message));
    let objects = learnt_objects(scene)?;
    if objects.is_empty() {
        return wrong("`remesh` needs `learn.vertices`, and there is none".to_owned());
    }
    let vertices = scene.description.learn.vertices.as_ref();
    if let Some(weight) = vertices.and_then(|vertices| vertices.rigid) {
        let rule =
            "`remesh` goes without `learn.vertices.rigid`, which is of the faces as they were";
        return wrong(format!("{rule}, and it is {}", weight.0));
    }
    for (index, name) in objects {
        if let Some(reason) = scene.objects[index].fixed() {
            let rule = "a mesh that is remeshed has one material, no textures, and one colour at a vertex if any";
            return wrong(format!("{rule}, and {name:?} {reason}"));
        }
        let object = &scene.objects[index];
        for remesh in stages.iter().filter_map(|stage| stage.remesh.as_ref()) {
            check_count(scene, object, remesh.length.0 * object.radius())?;
        }
    }
    Ok(())
}

/// The scene with other vertices of all objects whose vertices are learnt; `value` is that of a parameter, if it is
/// learnt. What carries numbers over is by the names of the parameters at vertices.
///
/// # Errors
/// [`SceneError::Content`] for a length that makes too many faces, [`SceneError::Memory`] for more than there is
/// room for.
pub(super) fn remeshed(
    scene: &Scene,
    to: &Remesh,
    value: impl Fn(&str) -> Option<Tensor<f32>>,
) -> Result<(Scene, Carried), SceneError> {
    let (mut scene, mut all) = (scene.clone(), Carried::new());
    for (index, name) in learnt_objects(&scene)? {
        let of = |row: &Learnable| value(&row.parameter_name(&name));
        let mut object = scene.objects[index].clone();
        object.positions = of(&VERTICES).unwrap_or(object.positions);
        let length = to.length.0 * object.radius();
        let most_faces = check_count(&scene, &object, length)?;
        let mut options = RemeshOptions::uniform(length);
        options.most_faces = most_faces;
        let derived = Arc::new(remesh(&object.positions, &object.mesh, &options)?);
        let of_colors = Carry { derived: Arc::clone(&derived), rows: object.colors_of_vertices() };
        let colors = of(&COLORS).or(object.colors.take().map(|colors| colors.rows));
        let colors = colors.map(|colors| of_colors.carried(&colors)).transpose()?;
        object.set_surface(derived.mesh.clone(), derived.positions.clone(), colors);
        scene.objects[index] = object;
        all.insert(COLORS.parameter_name(&name), of_colors);
        all.insert(VERTICES.parameter_name(&name), Carry { derived, rows: None });
    }
    Ok((scene, all))
}

/// Checks that there is memory for faces of such edges, and returns how many there may be at most.
fn check_count(scene: &Scene, object: &Object, length: f64) -> Result<usize, SceneError> {
    let area = surface_area(&object.positions, &object.mesh)?;
    // A face of equal edges.
    let count = area / (0.25 * 3.0_f64.sqrt() * length * length);
    let what = || format!("{:?} of {count:.0} faces", object.name);
    let bytes = (count * OF_FACE as f64) as u64;
    scene.folder.memory().check(bytes, &Location::new(&scene.path), what)?;
    Ok(((MOST_SPLIT * count) as usize).saturating_add(object.mesh.faces().len()))
}

impl Surface {
    /// The surfaces of all objects whose vertices or fields are learnt.
    pub(super) fn all(scene: &Scene) -> Result<Vec<Self>, SceneError> {
        let rows = |tensor: &Tensor<f32>| tensor.data().as_chunks::<3>().0.to_vec();
        let surface = |(index, object)| {
            let Object { mesh, positions, colors, .. }: &Object = &scene.objects[index];
            let colors = colors.as_ref().map_or(Vec::new(), |colors| rows(&colors.rows));
            Self { object, faces: mesh.faces().to_vec(), positions: rows(positions), colors }
        };
        let mut objects = learnt_objects(scene)?;
        if let Some(entry) = &scene.description.learn.field {
            objects.extend(FIELD.chosen(scene, entry.meshes.as_deref())?);
        }
        let mut seen = HashSet::new();
        objects.retain(|(index, _)| seen.insert(*index));
        Ok(objects.into_iter().map(surface).collect())
    }

    /// Puts the surface into a scene.
    ///
    /// # Errors
    /// [`FitError::Saved`] for an object that is not there, or for faces, positions and colours that do not fit.
    pub(super) fn put(&self, scene: &mut Scene) -> Result<(), SceneError> {
        let Self { object, faces, positions, colors } = self;
        let count = positions.len();
        let wrong = |rule: &str, value: String| FitError::saved(rule.to_owned(), value);
        let Some(object) = scene.objects.iter_mut().find(|own| own.name == *object) else {
            return Err(
                wrong("surfaces of the scene's meshes", format!("that of {object:?}")).into()
            );
        };
        if let Some(reason) = object.fixed() {
            let rule = format!("the mesh {:?} as it was, which can be remeshed", object.name);
            return Err(wrong(&rule, format!("one that {reason}")).into());
        }
        if !colors.is_empty() && colors.len() != count {
            let rule = format!("a colour for each of {count} vertices");
            return Err(wrong(&rule, colors.len().to_string()).into());
        }
        let tensor = |rows: &[[f32; 3]]| Tensor::from(rows);
        let colors = (!colors.is_empty()).then(|| tensor(colors));
        object.set_surface(Mesh::new(faces.clone(), count)?, tensor(positions), colors);
        object.field = None;
        Ok(())
    }
}
