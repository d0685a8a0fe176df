//! Meshes that get other vertices and faces in the middle of a fit.
//!
//! Numbers at vertices, and their moments of the optimizer, are carried over to the new vertices. Measures of the scene
//! stay those of its start, so that learnt motions keep their meaning.

use std::collections::HashMap;
use std::sync::Arc;

use bokashi_core::Tensor;
use bokashi_mesh::{DerivedMesh, MeshError, RemeshOptions, remesh, surface_area};

use crate::description::{Remesh, Stage};
use crate::error::{Location, SceneError};
use crate::learnables::{COLORS, Learnable, VERTICES};
use crate::memory::OF_FACE;
use crate::object::Object;
use crate::scene::Scene;

/// The carries to new vertices, by the names of parameters.
pub(super) type Carried = HashMap<String, Carry>;

/// A map from numbers at the old vertices of an object to its new vertices.
pub(super) struct Carry {
    derived: Arc<DerivedMesh<f32>>,
    /// The row of each old vertex, for numbers that several vertices share.
    rows: Option<Vec<u32>>,
}

impl Carry {
    /// The numbers at the new vertices, `[W, C]`.
    ///
    /// # Errors
    /// [`MeshError`] for another number of rows than of old vertices.
    pub(super) fn carried(&self, old: &Tensor<f32>) -> Result<Tensor<f32>, MeshError> {
        let Some(rows) = &self.rows else { return self.derived.carry(old) };
        let columns = old.shape()[1];
        let at_vertices = Tensor::from_fn([rows.len(), columns], |[vertex, column]| {
            old[[rows[vertex] as usize, column]]
        });
        self.derived.carry(&at_vertices)
    }
}

/// The most faces over the number with equal edges: splits shorten edges to two thirds of their target.
const MOST_SPLIT: f64 = 4.0;

/// The indices and names of the objects whose vertices are learnt.
pub(super) fn learnt_objects(scene: &Scene) -> Result<Vec<(usize, String)>, SceneError> {
    let Some(entry) = &scene.description.learn.vertices else { return Ok(Vec::new()) };
    VERTICES.chosen(scene, entry.meshes.as_deref())
}

/// Checks that the meshes of a scene can be remeshed, if one of `stages` asks for it.
///
/// # Errors
/// [`SceneError::Content`] otherwise.
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

/// Remeshes all objects whose vertices are learnt. `value` returns the value of a parameter, if it is learnt. Returns
/// the scene, and the carries by the names of parameters at vertices.
///
/// # Errors
/// [`SceneError::Content`] for a length that makes too many faces; [`SceneError::Memory`] for more faces than there is
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

/// Checks that there is memory for faces with edges of this length. Returns the most faces that there may be.
fn check_count(scene: &Scene, object: &Object, length: f64) -> Result<usize, SceneError> {
    let area = surface_area(&object.positions, &object.mesh)?;
    // The area of a face with equal edges is `sqrt(3) / 4 length^2`.
    let count = area / (0.25 * 3.0_f64.sqrt() * length * length);
    let what = || format!("{:?} of {count:.0} faces", object.name);
    let bytes = (count * OF_FACE as f64) as u64;
    scene.folder.memory().check(bytes, &Location::new(&scene.path), what)?;
    Ok(((MOST_SPLIT * count) as usize).saturating_add(object.mesh.faces().len()))
}
