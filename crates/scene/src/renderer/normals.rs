//! Normals of the surface, and what a normal map makes of them.

use std::collections::HashMap;
use std::sync::Arc;

use bokashi_core::{Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Fragments, Mesh, Weighting, interpolate_indexed, perturbed_normals, tangents, vertex_normals,
};

use super::looks::Indexed;
use super::parts::{Part, Parts};
use crate::error::SceneError;
use crate::object::{Attribute, Object, SurfaceLook};
use crate::values::Recorded;

/// How corners share normals, and tangents where some object has a normal map.
pub(super) struct Normals {
    /// All corners at a vertex share a normal, or those that share a normal in the object's file.
    mesh: Mesh,
    /// The vertex of each normal, where these are not the vertices themselves.
    vertices: Option<Arc<[u32]>>,
    tangents: Option<Tangents>,
}

/// Normals, `[A, 3]`, and the positions of the corners that have them, `[A, 3]`.
#[derive(Clone, Copy)]
pub(super) struct NormalsAtVertices<'t, 'a> {
    corners: Var<'t, f32>,
    pub(super) normals: Indexed<'t, 'a>,
}

/// Tangents of the objects with a normal map, and an empty tangent for all others.
struct Tangents {
    /// Texture coordinates, `[A, 2]`, none of them at two normals.
    coordinates: Tensor<f32>,
    /// The faces of objects with a normal map, with the corners of [`Normals::mesh`].
    mesh: Mesh,
    /// The coordinates of these faces.
    indices: Mesh,
    /// The tangents of all faces that are drawn: row A is empty.
    shown: Mesh,
}

impl Normals {
    pub(super) fn of(parts: &Parts, objects: &[Object]) -> Result<Self, SceneError> {
        let mut all = Self { mesh: parts.assembly.mesh().clone(), vertices: None, tangents: None };
        if objects.iter().any(|object| object.normals.is_some()) {
            all.split(parts, objects)?;
        }
        if objects.iter().any(has_map) {
            all.tangents = Some(Tangents::of(parts, objects, &all.mesh)?);
        }
        Ok(all)
    }

    /// Gives each pair of a vertex and a normal of its file a normal of its own.
    fn split(&mut self, parts: &Parts, objects: &[Object]) -> Result<(), SceneError> {
        let (mut faces, mut vertices) = (Vec::new(), Vec::new());
        let mut first = 0;
        for part in &parts.all {
            let corners = corners(part, &objects[part.object])?;
            for _ in &part.places {
                let mut seen = HashMap::new();
                faces.extend(part.mesh.faces().iter().zip(corners.faces()).map(
                    |(vertex, normal)| {
                        [0, 1, 2].map(|k| {
                            *seen.entry((vertex[k], normal[k])).or_insert_with(|| {
                                vertices.push(first + vertex[k]);
                                vertices.len() as u32 - 1
                            })
                        })
                    },
                ));
                first += part.mesh.vertex_count() as u32;
            }
        }
        self.mesh = Mesh::new(faces, vertices.len())?;
        self.vertices = Some(vertices.into());
        Ok(())
    }

    /// Normals at the vertices in the world.
    pub(super) fn at_vertices<'t>(
        &self,
        world: Var<'t, f32>,
    ) -> Result<NormalsAtVertices<'t, '_>, FitError> {
        let corners = match &self.vertices {
            Some(vertices) => world.gather_rows(vertices)?,
            None => world,
        };
        let rows = vertex_normals(corners, &self.mesh, Weighting::Angle)?;
        Ok(NormalsAtVertices { corners, normals: Indexed { rows, indices: &self.mesh } })
    }

    /// Normals at the fragments in the world, `[N, 3]`, of any length. `map` has what normal maps say at the
    /// fragments, `[N, 3]`.
    pub(super) fn at<'t>(
        &self,
        NormalsAtVertices { corners, normals }: NormalsAtVertices<'t, '_>,
        fragments: &Fragments<'t, f32>,
        map: Option<Var<'t, f32>>,
    ) -> Recorded<'t> {
        let smooth = interpolate_indexed(normals.rows, normals.indices, fragments)?;
        match (map, &self.tangents) {
            (Some(map), Some(own)) => {
                let tangents = own.at(corners, normals.rows, fragments)?;
                Ok(perturbed_normals(smooth, tangents, map)?)
            }
            _ => Ok(smooth),
        }
    }
}

impl Tangents {
    fn of(parts: &Parts, objects: &[Object], corners: &Mesh) -> Result<Self, SceneError> {
        let (mut rows, mut faces, mut indices, mut shown) = (vec![], vec![], vec![], vec![]);
        let mut first = 0;
        for part in &parts.all {
            let object = &objects[part.object];
            let count = part.mesh.faces().len();
            let own = object.coordinates_of_maps().filter(|_| has_map(object));
            let own = own.map(|own| Ok::<_, SceneError>((part.wound(&own.indices)?, &own.rows)));
            let own = own.transpose()?;
            for _ in &part.places {
                let at = &corners.faces()[first..first + count];
                first += count;
                let Some((own, values)) = &own else {
                    // No row: filled in below, when their number is known.
                    shown.extend(vec![[u32::MAX; 3]; count]);
                    continue;
                };
                let mut seen = HashMap::new();
                for (face, (corner, coordinate)) in at.iter().zip(own.faces()).enumerate() {
                    if !is_mapped(object, &object.looks[object.look_of(face)]) {
                        shown.push([u32::MAX; 3]);
                        continue;
                    }
                    let split = [0, 1, 2].map(|k| {
                        *seen.entry((corner[k], coordinate[k])).or_insert_with(|| {
                            let at = 2 * coordinate[k] as usize;
                            rows.extend_from_slice(&values.data()[at..at + 2]);
                            rows.len() as u32 / 2 - 1
                        })
                    });
                    faces.push(*corner);
                    shown.push(split);
                    indices.push(split);
                }
            }
        }
        let count = rows.len() / 2;
        for index in shown.as_flattened_mut() {
            *index = (*index).min(count as u32);
        }
        Ok(Self {
            coordinates: Tensor::from_flat_fn([count, 2], |k| rows[k]),
            mesh: Mesh::new(faces, corners.vertex_count())?,
            indices: Mesh::new(indices, count)?,
            shown: Mesh::new(shown, count + 1)?,
        })
    }

    /// At the fragments, `[N, 4]`.
    fn at<'t>(
        &self,
        corners: Var<'t, f32>,
        normals: Var<'t, f32>,
        fragments: &Fragments<'t, f32>,
    ) -> Result<Var<'t, f32>, FitError> {
        let tape = corners.tape();
        let coordinates = tape.constant(&self.coordinates);
        let own = tangents(corners, normals, coordinates, &self.indices, &self.mesh)?;
        let none = tape.constant(&Tensor::zeros([1, 4]));
        let all = Var::concat(&[own, none], 0)?;
        Ok(interpolate_indexed(all, &self.shown, fragments)?)
    }
}

/// Whether a normal map can be looked up anywhere.
fn has_map(object: &Object) -> bool {
    object.looks.iter().any(|look| is_mapped(object, look))
}

/// Whether a look has a normal map that can be looked up.
fn is_mapped(object: &Object, look: &SurfaceLook) -> bool {
    let covers = |own: &Attribute| own.covers(&look.faces);
    look.normal_map.is_some() && object.coordinates.as_ref().is_some_and(covers)
}

/// The normals of a part's corners in its object's file, or its vertices.
fn corners(part: &Part, object: &Object) -> Result<Mesh, SceneError> {
    match &object.normals {
        Some(normals) => part.wound(&normals.indices),
        None => Ok(part.mesh.clone()),
    }
}
