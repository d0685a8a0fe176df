//! Several meshes drawn as one, some of them several times.
//!
//! The faces of all instances stand one after another, part by part and within a part instance by
//! instance, and so do their vertices. So one visibility decides what is in front, and seams and
//! adjacency are those of the parts: instances share no vertex.

use std::ops::Range;

use bokashi_core::TensorError;

use crate::error::RenderError;
use crate::mesh::Mesh;

/// Several meshes as one, some of them several times.
///
/// ```
/// use bokashi_render_ops::{Assembly, Mesh};
///
/// let triangle = Mesh::new(vec![[0, 1, 2]], 3)?;
/// let square = Mesh::new(vec![[0, 1, 2], [2, 1, 3]], 4)?;
/// // One triangle, and three squares.
/// let scene = Assembly::new(&[(&triangle, 1), (&square, 3)])?;
/// assert_eq!(scene.mesh().faces().len(), 7);
/// // The fourth face is the first of the second square.
/// let place = scene.place(3).unwrap();
/// assert_eq!((place.part, place.instance, place.face), (1, 1, 0));
/// assert_eq!(scene.vertices(1, 1), Some(7..11));
/// # Ok::<(), bokashi_render_ops::RenderError>(())
/// ```
///
/// Clip positions are the parts' own, one after another:
/// [`project_instances`](crate::project_instances()) gives a part's, and `Var::concat` joins them. Attributes of
/// vertices are not repeated: [`Assembly::attributes`] is the index buffer for
/// [`interpolate_indexed`](crate::interpolate_indexed()).
#[derive(Debug, Clone)]
pub struct Assembly {
    mesh: Mesh,
    parts: Vec<Part>,
}

#[derive(Debug, Clone)]
struct Part {
    mesh: Mesh,
    instances: usize,
    first_face: usize,
    first_vertex: usize,
}

/// Where a face of an [`Assembly`] comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// The part.
    pub part: usize,
    /// Which of the part's instances.
    pub instance: usize,
    /// The face of the part's mesh.
    pub face: usize,
}

impl Assembly {
    /// The mesh of `parts`: each with its mesh, and how many times it is there.
    ///
    /// # Errors
    /// [`RenderError::MeshSize`] for 2^31 faces, vertices or instances and more.
    pub fn new(parts: &[(&Mesh, usize)]) -> Result<Self, RenderError> {
        let (mut first_face, mut first_vertex, mut first_instance) = (0_usize, 0_usize, 0_usize);
        let mut all = Vec::with_capacity(parts.len());
        for &(mesh, instances) in parts {
            all.push(Part { mesh: mesh.clone(), instances, first_face, first_vertex });
            let more = |each: usize| each.saturating_mul(instances);
            first_face = first_face.saturating_add(more(mesh.faces().len()));
            first_vertex = first_vertex.saturating_add(more(mesh.vertex_count()));
            first_instance = first_instance.saturating_add(instances);
            for given in [first_face, first_vertex, first_instance] {
                if given >= 1 << 31 {
                    return Err(RenderError::MeshSize { given });
                }
            }
        }
        // Without faces, any number of instances is nothing.
        let drawn = all.iter().filter(|part| !part.mesh.faces().is_empty());
        let instances = drawn.flat_map(|part| {
            let vertices = part.mesh.vertex_count();
            (0..part.instances).map(move |k| (&part.mesh, part.first_vertex + k * vertices))
        });
        let mesh = Mesh::joined(instances, first_vertex)?;
        Ok(Self { mesh, parts: all })
    }

    /// The mesh of all instances, to be rasterized.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Where a face comes from, an index that [`Coverage::face_at`](crate::Coverage::face_at) or
    /// [`Coverage::faces`](crate::Coverage::faces) gives; `None` beyond the last face.
    pub fn place(&self, face: usize) -> Option<Place> {
        if face >= self.mesh.faces().len() {
            return None;
        }
        // Of parts that start at one face, all but the last have none.
        let part = self.parts.partition_point(|part| part.first_face <= face) - 1;
        let Part { mesh, first_face, .. } = &self.parts[part];
        let (faces, face_in_part) = (mesh.faces().len(), face - first_face);
        Some(Place { part, instance: face_in_part / faces, face: face_in_part % faces })
    }

    /// The vertices of an instance, rows of the clip positions; `None` where there is no such instance.
    pub fn vertices(&self, part: usize, instance: usize) -> Option<Range<usize>> {
        let Part { mesh, instances, first_vertex, .. } = self.parts.get(part)?;
        let first = first_vertex + instance.checked_mul(mesh.vertex_count())?;
        (instance < *instances).then(|| first..first + mesh.vertex_count())
    }

    /// The index buffer of attributes that the instances of a part share, for
    /// [`interpolate_indexed`](crate::interpolate_indexed()).
    ///
    /// `indices` has an index buffer for each part: its own mesh for attributes of its vertices, or another
    /// with as many faces. The attributes `[A, C]` are those of the parts one after another, each part's once.
    ///
    /// # Errors
    /// `TensorError::Inputs` unless there is an index buffer for each part; [`RenderError::FaceCount`] unless
    /// it has as many faces as its part; [`RenderError::MeshSize`] for 2^31 attributes and more.
    pub fn attributes(&self, indices: &[&Mesh]) -> Result<Mesh, RenderError> {
        if indices.len() != self.parts.len() {
            let rule = format!("an index buffer for each of {} parts", self.parts.len()).into();
            let given = indices.len();
            return Err(TensorError::Inputs { operation: "attributes", rule, given }.into());
        }
        let mut firsts = Vec::with_capacity(indices.len());
        let mut count = 0_usize;
        for (part, indices) in self.parts.iter().zip(indices) {
            let (expected, given) = (part.mesh.faces().len(), indices.faces().len());
            if given != expected {
                return Err(RenderError::FaceCount { expected, given });
            }
            firsts.push(count);
            count = count.saturating_add(indices.vertex_count());
        }
        let parts = self.parts.iter().zip(indices).zip(firsts);
        let instances = parts.flat_map(|((part, indices), first)| {
            std::iter::repeat_n((*indices, first), part.instances)
        });
        Mesh::joined(instances, count)
    }

    /// The index buffer of attributes of instances, for
    /// [`interpolate_indexed`](crate::interpolate_indexed()): a colour of its own for each, say. The
    /// attributes are `[I, C]`, I the number of all parts' instances.
    pub fn instances(&self) -> Mesh {
        let mut count = 0;
        let mut faces = Vec::with_capacity(self.mesh.faces().len());
        for part in &self.parts {
            let of_each = part.mesh.faces().len();
            let all = 0..part.instances * of_each;
            faces.extend(all.map(|face| [(count + face / of_each) as u32; 3]));
            count += part.instances;
        }
        Mesh::new(faces, count).expect("there are fewer than 2^31 instances")
    }
}
