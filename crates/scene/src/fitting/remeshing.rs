//! Meshes that get other vertices and faces in the middle of a fit.
//!
//! What is learnt at vertices, and the optimizer's moments of it, is carried over to the new ones. Measures of the
//! scene stay those of its start, so that learnt motions mean the same.

use std::collections::HashMap;

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_mesh::{DerivedMesh, RemeshOptions, remesh, surface_area};
use bokashi_render_ops::Mesh;

use crate::description::{Remesh, Stage};
use crate::error::{Location, SceneError};
use crate::learnables::{COLORS, Learnable, VERTICES};
use crate::memory::OF_FACE;
use crate::object::Object;
use crate::saved_fit::Surface;
use crate::scene::Scene;

/// New vertices of objects, by the names of their parameters.
pub(super) type Carried = HashMap<String, DerivedMesh<f32>>;

/// The objects whose vertices are learnt: their indices and names.
fn learnt_objects(scene: &Scene) -> Result<Vec<(usize, String)>, SceneError> {
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
            let rule = "a mesh that is remeshed has one material, no textures, and colours at vertices if any";
            return wrong(format!("{rule}, and {name:?} {reason}"));
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
        let colors = of(&COLORS).or(object.colors.take().map(|colors| colors.rows));
        let length = to.length.0 * object.radius();
        check_count(&scene, &object, length)?;
        let options = RemeshOptions::uniform(length);
        let derived = remesh(&object.positions, &object.mesh, &options)?;
        let colors = colors.map(|colors| derived.carry(&colors)).transpose()?;
        object.set_surface(derived.mesh.clone(), derived.positions.clone(), colors);
        scene.objects[index] = object;
        all.insert(COLORS.parameter_name(&name), derived.clone());
        all.insert(VERTICES.parameter_name(&name), derived);
    }
    Ok((scene, all))
}

/// Checks that there is memory for faces of such edges.
fn check_count(scene: &Scene, object: &Object, length: f64) -> Result<(), SceneError> {
    let area = surface_area(&object.positions, &object.mesh)?;
    // A face of equal edges.
    let count = area / (0.25 * 3.0_f64.sqrt() * length * length);
    let what = || format!("{:?} of {count:.0} faces", object.name);
    let bytes = (count * OF_FACE as f64) as u64;
    scene.folder.memory().check(bytes, &Location::new(&scene.path), what)
}

impl Surface {
    /// The surfaces of all objects whose vertices are learnt.
    pub(super) fn all(scene: &Scene) -> Result<Vec<Self>, SceneError> {
        let rows = |tensor: &Tensor<f32>| tensor.data().as_chunks::<3>().0.to_vec();
        let surface = |(object, _)| {
            let Object { mesh, positions, colors, .. } = &scene.objects[object];
            let colors = colors.as_ref().map_or(Vec::new(), |colors| rows(&colors.rows));
            Self { object, faces: mesh.faces().to_vec(), positions: rows(positions), colors }
        };
        Ok(learnt_objects(scene)?.into_iter().map(surface).collect())
    }

    /// Puts the surface into a scene.
    ///
    /// # Errors
    /// [`FitError::Saved`] for an object that is not there, or for faces, positions and colours that do not fit.
    pub(super) fn put(&self, scene: &mut Scene) -> Result<(), SceneError> {
        let Self { object, faces, positions, colors } = self;
        let count = positions.len();
        let wrong = |rule: &str, value: String| FitError::saved(rule.to_owned(), value);
        let number = *object + 1;
        let Some(object) = scene.objects.get_mut(*object) else {
            let rule = format!("surfaces of the scene's {} objects", scene.objects.len());
            return Err(wrong(&rule, format!("that of number {number}")).into());
        };
        if !colors.is_empty() && colors.len() != count {
            let rule = format!("a colour for each of {count} vertices");
            return Err(wrong(&rule, colors.len().to_string()).into());
        }
        let tensor = |rows: &[[f32; 3]]| Tensor::from(rows);
        let colors = (!colors.is_empty()).then(|| tensor(colors));
        object.set_surface(Mesh::new(faces.clone(), count)?, tensor(positions), colors);
        Ok(())
    }
}
