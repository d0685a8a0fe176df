//! Normals of the surface, and what a normal map makes of them.
//!
//! Normals and tangents of a file hold as long as the vertices stay where they are. Where vertices are learnt,
//! normals follow from the faces, shared by the corners that share one in the file; tangents follow from texture
//! coordinates.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use bokashi_core::{Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::camera::to_tensor;
use bokashi_render_ops::{
    Fragments, Mesh, Weighting, interpolate_indexed, perturbed_normals, tangents,
    transform_normals, vertex_normals,
};
use glam::DMat4;

use super::materials::Indexed;
use super::parts::{Part, Parts};
use crate::error::SceneError;
use crate::learnables::{Frame, POSE, Recorded, Values};
use crate::object::{Attribute, Object, SurfaceMaterial};
use crate::scene::Scene;

/// How corners share normals, and tangents where some object has a normal map.
pub(super) struct Normals {
    /// All corners at a vertex share a normal, or those that share a normal in the object's file.
    mesh: Mesh,
    /// The vertex of each normal, where these are not the vertices themselves.
    vertices: Option<Arc<[u32]>>,
    /// The normals of each instance, one after another, and those of them that are of a file.
    pieces: Vec<(Range<usize>, Option<FileDirections>)>,
    tangents: Option<Tangents>,
}

/// Normals, `[A, 3]`, and the positions of the corners that have them, `[A, 3]`.
#[derive(Clone, Copy)]
pub(super) struct VertexNormals<'t, 'a> {
    corners: Var<'t, f32>,
    pub(super) normals: Indexed<'t, 'a>,
    /// Tangents of files, `[A, 4]`.
    tangents: Option<Var<'t, f32>>,
}

/// What moves directions of files into the world.
#[derive(Clone, Copy)]
pub(super) struct MotionContext<'t, 'a> {
    pub(super) objects: &'a [Object],
    pub(super) frame: &'a Frame,
    pub(super) values: &'a Values<'t, 'a>,
}

/// Tangents of the objects with a normal map, and an empty tangent for all others. Row A is empty; the rows
/// before it follow from coordinates, those after it are of files.
struct Tangents {
    /// Texture coordinates, `[A, 2]`, none of them at two normals.
    coordinates: Tensor<f32>,
    /// The faces of objects with a normal map, with the corners of [`Normals::mesh`].
    mesh: Mesh,
    /// The coordinates of these faces.
    indices: Mesh,
    /// The tangents of all faces that are drawn.
    shown: Mesh,
    given: Vec<FileDirections>,
}

/// Directions of an object's file, as an instance has them.
struct FileDirections {
    object: usize,
    transform: DMat4,
    is_mirrored: bool,
    /// Normals `[A, 3]` or tangents `[A, 4]`, in the object's own coordinates.
    rows: Tensor<f32>,
}

impl Normals {
    pub(super) fn new(parts: &Parts, scene: &Scene) -> Result<Self, SceneError> {
        let objects = &scene.objects;
        let mesh = parts.assembly.mesh().clone();
        let mut all = Self { mesh, vertices: None, pieces: Vec::new(), tangents: None };
        if objects.iter().any(|object| object.normals.is_some()) {
            all.split(parts, scene)?;
        }
        if objects.iter().any(has_map) {
            all.tangents = Some(Tangents::new(parts, scene, &all.mesh)?);
        }
        Ok(all)
    }

    /// Gives each pair of a vertex and a normal of its file a normal of its own.
    fn split(&mut self, parts: &Parts, scene: &Scene) -> Result<(), SceneError> {
        let (mut faces, mut vertices) = (Vec::new(), Vec::new());
        let mut first = 0;
        for part in &parts.all {
            let object = &scene.objects[part.object];
            let corners = corners(part, object)?;
            let of_file = object.normals.as_ref().filter(|_| !scene.learns_vertices(object));
            // Faces of a material without normals have the row beyond the last at their corners.
            let count = object.normals.as_ref().map_or(0, |normals| normals.rows.shape()[0]);
            let pairs = || {
                let faces = part.mesh.faces().iter().zip(corners.faces());
                faces.flat_map(|(vertex, normal)| [0, 1, 2].map(|k| (vertex[k], normal[k])))
            };
            for transform in &part.places {
                let mut seen = HashMap::new();
                let (start, mut rows) = (vertices.len(), Vec::new());
                // Those that the file has first, then those that follow from faces.
                let mut number = |is_given: bool, rows: &mut Vec<usize>| {
                    for pair in pairs().filter(|pair| ((pair.1 as usize) < count) == is_given) {
                        seen.entry(pair).or_insert_with(|| {
                            vertices.push(first + pair.0);
                            rows.push(pair.1 as usize);
                            vertices.len() as u32 - 1
                        });
                    }
                    vertices.len()
                };
                let middle = number(true, &mut rows);
                let end = number(false, &mut Vec::new());
                let all: Vec<u32> = pairs().map(|pair| seen[&pair]).collect();
                faces.extend_from_slice(all.as_chunks::<3>().0);
                first += part.mesh.vertex_count() as u32;
                let given = of_file.map(|normals| {
                    let number = |k: usize| normals.rows.data()[3 * rows[k / 3] + k % 3];
                    FileDirections::new(
                        part,
                        *transform,
                        Tensor::from_flat_fn([rows.len(), 3], number),
                    )
                });
                self.pieces.push((start..middle, given));
                if middle < end {
                    self.pieces.push((middle..end, None));
                }
            }
        }
        self.mesh = Mesh::new(faces, vertices.len())?;
        self.vertices = Some(vertices.into());
        Ok(())
    }

    /// Normals at the vertices in the world. `kept` has them once they are known; it is given only where neither vertices
    /// nor poses are learnt.
    pub(super) fn vertex_normals<'t>(
        &self,
        world: Var<'t, f32>,
        context: MotionContext<'t, '_>,
        kept: Option<&OnceLock<Tensor<f32>>>,
    ) -> Result<VertexNormals<'t, '_>, FitError> {
        let known = kept.and_then(OnceLock::get);
        let corners = match &self.vertices {
            // Where normals are known, only tangents follow from them.
            Some(vertices) if known.is_none() || self.tangents.is_some() => {
                world.gather_rows(vertices)?
            }
            _ => world,
        };
        let rows = match known {
            Some(rows) => world.tape().constant(rows),
            None => self.rows(corners, context)?,
        };
        if let Some(kept) = kept {
            // Whoever comes first: all have the same bits.
            kept.get_or_init(|| rows.value());
        }
        let given = self.tangents.iter().flat_map(|tangents| &tangents.given);
        let tangents = given.map(|directions| directions.tangents(context));
        let tangents = tangents.collect::<Result<Vec<_>, _>>()?;
        Ok(VertexNormals {
            corners,
            normals: Indexed { rows, indices: &self.mesh },
            tangents: match tangents.as_slice() {
                [] => None,
                all => Some(Var::concat(all, 0)?),
            },
        })
    }

    /// The normals of the corners, `[A, 3]`.
    fn rows<'t>(&self, corners: Var<'t, f32>, context: MotionContext<'t, '_>) -> Recorded<'t> {
        let of_faces = || vertex_normals(corners, &self.mesh, Weighting::Angle);
        if self.pieces.iter().all(|(_, given)| given.is_none()) {
            return Ok(of_faces()?);
        }
        let mut others = None;
        let rows = self.pieces.iter().map(|(range, given)| match (given, others) {
            (Some(directions), _) => directions.normals(context),
            (None, Some(others)) => Ok(Var::slice(others, 0, range.clone())?),
            (None, None) => Ok(others.insert(of_faces()?).slice(0, range.clone())?),
        });
        Ok(Var::concat(&rows.collect::<Result<Vec<_>, FitError>>()?, 0)?)
    }

    /// Normals at the fragments in the world, `[N, 3]`, of any length. `map` has the vectors of normal maps at
    /// the fragments, `[N, 3]`.
    pub(super) fn at_fragments<'t>(
        &self,
        VertexNormals { corners, normals, tangents }: VertexNormals<'t, '_>,
        fragments: &Fragments<'t, f32>,
        map: Option<Var<'t, f32>>,
    ) -> Recorded<'t> {
        let smooth = interpolate_indexed(normals.rows, normals.indices, fragments)?;
        match (map, &self.tangents) {
            (Some(map), Some(all)) => {
                let tangents = all.at_fragments(corners, normals.rows, tangents, fragments)?;
                Ok(perturbed_normals(smooth, tangents, map)?)
            }
            _ => Ok(smooth),
        }
    }
}

impl Tangents {
    /// In one piece: one walk over the corners fills all lists.
    fn new(parts: &Parts, scene: &Scene, corners: &Mesh) -> Result<Self, SceneError> {
        let objects = &scene.objects;
        let (mut rows, mut faces, mut indices, mut shown) = (vec![], vec![], vec![], vec![]);
        let (mut given, mut given_rows) = (vec![], 0);
        let mut first = 0;
        for part in &parts.all {
            let object = &objects[part.object];
            let count = part.mesh.faces().len();
            // Those of the file where it has some, else those that follow from coordinates.
            let of_file = object.tangents.as_ref().filter(|_| has_map(object));
            let of_file = of_file.filter(|_| !scene.learns_vertices(object));
            let of_file = of_file
                .map(|tangents| Ok::<_, SceneError>((part.wound(&tangents.indices)?, tangents)));
            let of_file = of_file.transpose()?;
            let mapped = object.coordinates_of_maps().filter(|_| has_map(object));
            let mapped = mapped.map(|uv| Ok::<_, SceneError>((part.wound(&uv.indices)?, &uv.rows)));
            let mapped = mapped.transpose()?;
            for transform in &part.places {
                let faces_of_place = &corners.faces()[first..first + count];
                first += count;
                let mut seen = HashMap::new();
                for (face, corner) in faces_of_place.iter().enumerate() {
                    let material = &object.materials[object.material_of(face)];
                    let of_file =
                        of_file.as_ref().filter(|(_, tangents)| tangents.covers(&material.faces));
                    if let Some((wound, _)) = of_file {
                        // Counted from the end: how many come before is not known yet.
                        let row = |row: u32| u32::MAX - 1 - (given_rows + row);
                        shown.push(wound.faces()[face].map(row));
                        continue;
                    }
                    let Some((wound, values)) =
                        mapped.as_ref().filter(|_| is_mapped(object, material))
                    else {
                        // No row: filled in below, when their number is known.
                        shown.push([u32::MAX; 3]);
                        continue;
                    };
                    let coordinate = wound.faces()[face];
                    let split = [0, 1, 2].map(|k| {
                        *seen.entry((corner[k], coordinate[k])).or_insert_with(|| {
                            let first = 2 * coordinate[k] as usize;
                            rows.extend_from_slice(&values.data()[first..first + 2]);
                            rows.len() as u32 / 2 - 1
                        })
                    });
                    faces.push(*corner);
                    shown.push(split);
                    indices.push(split);
                }
                if let Some((_, tangents)) = &of_file {
                    given_rows += tangents.rows.shape()[0] as u32;
                    given.push(FileDirections::new(part, *transform, tangents.rows.clone()));
                }
            }
        }
        let count = rows.len() / 2;
        for index in shown.as_flattened_mut() {
            *index = match *index as usize {
                row if row < count => row as u32,
                _ => count as u32 + (u32::MAX - *index),
            };
        }
        Ok(Self {
            coordinates: Tensor::from_flat_fn([count, 2], |k| rows[k]),
            mesh: Mesh::new(faces, corners.vertex_count())?,
            indices: Mesh::new(indices, count)?,
            shown: Mesh::new(shown, count + 1 + given_rows as usize)?,
            given,
        })
    }

    /// At the fragments, `[N, 4]`.
    fn at_fragments<'t>(
        &self,
        corners: Var<'t, f32>,
        normals: Var<'t, f32>,
        given: Option<Var<'t, f32>>,
        fragments: &Fragments<'t, f32>,
    ) -> Result<Var<'t, f32>, FitError> {
        let tape = corners.tape();
        let mut all = Vec::new();
        if self.coordinates.shape()[0] > 0 {
            let coordinates = tape.constant(&self.coordinates);
            all.push(tangents(corners, normals, coordinates, &self.indices, &self.mesh)?);
        }
        all.push(tape.constant(&Tensor::zeros([1, 4])));
        all.extend(given);
        let all = Var::concat(&all, 0)?;
        Ok(interpolate_indexed(all, &self.shown, fragments)?)
    }
}

impl FileDirections {
    fn new(part: &Part, transform: DMat4, rows: Tensor<f32>) -> Self {
        Self { object: part.object, transform, is_mirrored: part.is_mirrored, rows }
    }

    /// From the object's own coordinates to the world's.
    fn matrix<'t>(&self, context: MotionContext<'t, '_>) -> Recorded<'t> {
        let MotionContext { objects, frame, values } = context;
        let name = &objects[self.object].name;
        Ok(match values.learnt(&POSE, name) {
            Some(pose) => frame.object_pivot(self.object).moved(pose, &self.transform)?,
            None => values.tape.constant(&to_tensor(&self.transform)),
        })
    }

    /// Normals in the world, `[A, 3]`.
    fn normals<'t>(&self, context: MotionContext<'t, '_>) -> Recorded<'t> {
        let rows = context.values.tape.constant(&self.rows);
        let normals = transform_normals(rows, self.matrix(context)?)?;
        // The operation turns them with the corners of faces, which are turned back here.
        Ok(if self.is_mirrored { -normals } else { normals })
    }

    /// Tangents in the world, `[A, 4]`.
    fn tangents<'t>(&self, context: MotionContext<'t, '_>) -> Recorded<'t> {
        let rows = context.values.tape.constant(&self.rows);
        let linear = self.matrix(context)?.slice(0, 0..3)?.slice(1, 0..3)?.transpose()?;
        let directions = rows.slice(1, 0..3)?.matmul(linear)?;
        let signs = rows.slice(1, 3..4)?;
        // The bitangent goes with the surface, and the cross product the other way in a mirror.
        let signs = if self.is_mirrored { -signs } else { signs };
        Ok(Var::concat(&[directions, signs], 1)?)
    }
}

/// Whether a normal map can be looked up anywhere.
fn has_map(object: &Object) -> bool {
    object.materials.iter().any(|material| is_mapped(object, material))
}

/// Whether a material has a normal map that can be looked up.
fn is_mapped(object: &Object, material: &SurfaceMaterial) -> bool {
    let covers = |attribute: &Attribute| attribute.covers(&material.faces);
    material.normal_map.texels.is_some() && object.coordinates.as_ref().is_some_and(covers)
}

/// The normals of a part's corners in its object's file, or its vertices.
fn corners(part: &Part, object: &Object) -> Result<Mesh, SceneError> {
    match &object.normals {
        Some(normals) => part.wound(&normals.indices),
        None => Ok(part.mesh.clone()),
    }
}
