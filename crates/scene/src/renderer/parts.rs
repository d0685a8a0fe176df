//! The objects of a scene as one mesh.

use bokashi_core::{Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::camera::to_tensor;
use bokashi_render_ops::{Assembly, Mesh, transform_points};
use glam::{DMat4, DVec3};

use crate::error::SceneError;
use crate::learnables::{Frame, POSE, Recorded, VERTICES, Values};
use crate::object::{Attribute, Object};

/// Instances of an object: those that are mirrored, whose faces are turned around, or those that are not.
pub(super) struct Part {
    /// Its index in the scene.
    pub(super) object: usize,
    pub(super) is_mirrored: bool,
    pub(super) mesh: Mesh,
    /// To the world without its origin.
    pub(super) places: Vec<DMat4>,
}

/// All instances of all objects, one mesh.
pub(super) struct Parts {
    pub(super) all: Vec<Part>,
    pub(super) assembly: Assembly,
}

impl Part {
    /// This index buffer of the part's object, wound as the part's faces are.
    pub(super) fn wound(&self, indices: &Mesh) -> Result<Mesh, SceneError> {
        wound(indices, self.is_mirrored)
    }
}

impl Parts {
    /// All of `objects` in a world whose `origin` was taken off.
    pub(super) fn new(objects: &[Object], origin: DVec3) -> Result<Self, SceneError> {
        let moved = DMat4::from_translation(-origin);
        let mut all = Vec::new();
        for (index, object) in objects.iter().enumerate() {
            for is_mirrored in [false, true] {
                let places = object.places.iter().copied();
                let places: Vec<_> = places
                    .filter(|transform| (transform.determinant() < 0.0) == is_mirrored)
                    .collect();
                if !places.is_empty() {
                    let mesh = wound(&object.mesh, is_mirrored)?;
                    let places = places.into_iter().map(|transform| moved * transform).collect();
                    all.push(Part { object: index, is_mirrored, mesh, places });
                }
            }
        }
        let parts: Vec<_> = all.iter().map(|part| (&part.mesh, part.places.len())).collect();
        Ok(Self { assembly: Assembly::new(&parts)?, all })
    }

    /// The index buffer of attributes of all parts, one part's after another's; a part whose object has none
    /// has one row for all corners. `None` where no object has them.
    pub(super) fn indices(
        &self,
        objects: &[Object],
        pick: impl Fn(&Object) -> Option<&Attribute>,
    ) -> Result<Option<Mesh>, SceneError> {
        if objects.iter().all(|object| pick(object).is_none()) {
            return Ok(None);
        }
        let meshes = self.all.iter().map(|part| match pick(&objects[part.object]) {
            Some(attribute) => part.wound(&attribute.indices),
            // One row for all corners.
            None => Ok(Mesh::new(vec![[0; 3]; part.mesh.faces().len()], 1)?),
        });
        let meshes = meshes.collect::<Result<Vec<_>, _>>()?;
        Ok(Some(self.assembly.attributes(&meshes.iter().collect::<Vec<_>>())?))
    }

    /// The attributes that [`Parts::indices`] names: for each part those of its object, which `pick` gives
    /// with their rows, and `none`, `[1, C]`, where the object or some of its faces have none.
    pub(super) fn rows<'t, 'o>(
        &self,
        objects: &'o [Object],
        pick: impl Fn(&'o Object) -> Option<(&'o Attribute, Var<'t, f32>)>,
        none: Var<'t, f32>,
    ) -> Recorded<'t> {
        let mut all = Vec::with_capacity(self.all.len());
        for part in &self.all {
            let attribute = pick(&objects[part.object]);
            all.extend(attribute.map(|(_, rows)| rows));
            if attribute.is_none_or(|(attribute, _)| attribute.has_gaps()) {
                all.push(none);
            }
        }
        Ok(match all.as_slice() {
            [only] => *only,
            _ => Var::concat(&all, 0)?,
        })
    }

    /// The object that a face belongs to, and the face's number there.
    pub(super) fn face_of_object(&self, face: usize) -> [usize; 2] {
        self.assembly
            .place(face)
            .map_or([0; 2], |source| [self.all[source.part].object, source.face])
    }

    /// Which of all instances a face belongs to.
    pub(super) fn instance(&self, face: usize) -> Option<usize> {
        let source = self.assembly.place(face)?;
        let before = self.all[..source.part].iter().map(|part| part.places.len());
        Some(before.sum::<usize>() + source.instance)
    }

    /// The vertices of all instances in the world, `[V, 3]`.
    pub(super) fn world<'t>(
        &self,
        objects: &[Object],
        frame: &Frame,
        values: &Values<'t, '_>,
    ) -> Recorded<'t> {
        let tape = values.tape;
        let mut all = Vec::new();
        for part in &self.all {
            let (object, pivot) = (&objects[part.object], frame.object_pivot(part.object));
            let positions = values.tensor(&VERTICES, &object.name, &object.positions);
            let pose = values.learnt(&POSE, &object.name);
            for transform in &part.places {
                all.push(match pose {
                    Some(pose) => transform_points(positions, pivot.moved(pose, transform)?)?,
                    None if *transform == DMat4::IDENTITY => positions,
                    None => transform_points(positions, tape.constant(&to_tensor(transform)))?,
                });
            }
        }
        match all.as_slice() {
            [] => Ok(tape.constant(&Tensor::zeros([0, 3]))),
            [only] => Ok(*only),
            _ => Ok(Var::concat(&all, 0).map_err(FitError::from)?),
        }
    }
}

/// Faces as they are seen from outside: a mirror turns them around.
fn wound(mesh: &Mesh, is_mirrored: bool) -> Result<Mesh, SceneError> {
    if !is_mirrored {
        return Ok(mesh.clone());
    }
    let faces = mesh.faces().iter().map(|&[a, b, c]| [a, c, b]).collect();
    Ok(Mesh::new(faces, mesh.vertex_count())?)
}
